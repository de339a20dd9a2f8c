"""The terms of a link as options of a process that serves it."""

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, Final

import click

from adapters.mal import Certificates, Encoding
from adapters.mrs.terms import Terms

_PEM: Final = click.Path(path_type=Path)


def add_terms_options(whom: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Add the options; the function gets them as `clear_text` and as `terms`.

    Args:
        whom: whose certificate it is.
    """
    options = (
        click.option(
            "--clear-text",
            is_flag=True,
            help="Serve where other computers can reach it: anyone there may read and command.",
        ),
        *(
            click.option(f"--{name}", type=_PEM, metavar="PEM", help=f"TLS: {meaning}.")
            for name, meaning in (
                ("certificate", f"certificate of this {whom}, which names --host or leads to it"),
                ("key", "its private key, without a password"),
                ("authorities", "the authorities by which the ground is believed"),
            )
        ),
        click.option(
            "--encoding",
            type=click.Choice([encoding.value for encoding in Encoding]),
            default=Encoding.FIXED.value,
            show_default=True,
            help="How the bodies of messages are written, both ways.",
        ),
    )

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(function)
        def with_terms(
            *arguments: Any,
            encoding: str,
            certificate: Path | None,
            key: Path | None,
            authorities: Path | None,
            **others: Any,
        ) -> Any:
            certificates = None
            match [path for path in (certificate, key, authorities) if path]:
                case []:
                    pass
                case [own, own_key, believed]:
                    certificates = Certificates(own, own_key, believed)
                case _:
                    raise click.UsageError(
                        "TLS needs all three: --certificate, --key and --authorities"
                    )
            return function(*arguments, terms=Terms(Encoding(encoding), certificates), **others)

        for option in reversed(options):
            option(with_terms)
        return with_terms

    return decorate
