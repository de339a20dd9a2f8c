"""Where a person's rover is, and on what terms it is spoken to: options for every sub-command."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import Any, Final

import click

from adapters.mal import Certificates, Encoding
from adapters.mrs.terms import NAME, PORT, Terms

ADDRESS: Final = f"maltcp://127.0.0.1:{PORT}/{NAME}"

_PEM: Final = click.Path(exists=True, dir_okay=False, readable=True, path_type=Path)


@dataclass(frozen=True, slots=True)
class Target:
    """A rover, as the options say.

    Attributes:
        uri: `maltcp://host:port/MRS`, `host:port` or `host`.
    """

    uri: str
    terms: Terms


def _tls_option(name: str, meaning: str) -> Callable[..., Any]:
    return click.option(
        f"--{name}", type=_PEM, envvar=f"ROVER_{name.upper()}", show_envvar=True, help=meaning
    )


_OPTIONS: Final = (
    click.option(
        "--to",
        envvar="ROVER_URI",
        default=ADDRESS,
        show_default=True,
        show_envvar=True,
        metavar="URI",
        help="Where the rover is: maltcp://host:port/MRS, host:port or host.",
    ),
    click.option(
        "--encoding",
        type=click.Choice([encoding.value for encoding in Encoding]),
        envvar="ROVER_ENCODING",
        default=Encoding.FIXED.value,
        show_default=True,
        show_envvar=True,
        help="How the rover writes message bodies.",
    ),
    _tls_option("certificate", "TLS: PEM file with your certificate."),
    _tls_option("key", "TLS: PEM file with its private key."),
    _tls_option("authorities", "TLS: PEM file with the authorities that the rover is believed by."),
)


def to_option(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options that say where a rover is; the function gets them as `to`, a `Target`."""

    @wraps(function)
    def with_target(
        *arguments: Any,
        to: str,
        encoding: str,
        certificate: Path | None,
        key: Path | None,
        authorities: Path | None,
        **options: Any,
    ) -> Any:
        terms = Terms(Encoding(encoding), _certificates(certificate, key, authorities))
        return function(*arguments, to=Target(to, terms), **options)

    for option in reversed(_OPTIONS):
        option(with_target)
    return with_target


def _certificates(
    certificate: Path | None, key: Path | None, authorities: Path | None
) -> Certificates | None:
    match certificate, key, authorities:
        case None, None, None:
            return None
        case Path(), Path(), Path():
            return Certificates(certificate, key, authorities)
        case _:
            raise click.UsageError(
                "TLS needs all three: --certificate, --key and --authorities"
                " (or ROVER_CERTIFICATE, ROVER_KEY and ROVER_AUTHORITIES)"
            )
