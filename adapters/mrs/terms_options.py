"""The terms of a link as options of a process that serves it."""

from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from adapters.mrs.terms import Terms


def add_terms_options(line: ArgumentParser, whom: str) -> None:
    """Add the options to a command line; not by click, which would stay in memory.

    Args:
        line: the command line.
        whom: whose certificate it is.
    """
    line.add_argument(
        "--clear-text",
        action="store_true",
        help="serve where other computers can reach it: anyone there may read and command",
    )
    for name, meaning in (
        ("certificate", f"certificate of this {whom}, which names --host or what leads to it"),
        ("key", "its private key, without a password"),
        ("authorities", "the authorities by which the ground is believed"),
    ):
        line.add_argument(f"--{name}", type=Path, metavar="PEM", help=f"TLS: {meaning}")
    line.add_argument(
        "--encoding",
        choices=["fixed", "variable", "split"],
        default="fixed",
        help="how the bodies of messages are written, both ways [fixed]",
    )


def terms_from_options(line: ArgumentParser, options: Namespace) -> "Terms":
    """Return what the options say; ends the process where they make no sense."""
    from adapters.mal import Certificates, Encoding
    from adapters.mrs.terms import Terms

    certificates = None
    match [path for path in (options.certificate, options.key, options.authorities) if path]:
        case []:
            pass
        case [certificate, key, authorities]:
            certificates = Certificates(certificate, key, authorities)
        case _:
            line.error("TLS needs all three: --certificate, --key and --authorities")
    return Terms(Encoding(options.encoding), certificates)
