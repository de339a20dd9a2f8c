"""Command-line options of all MRS clients and servers: address, encoding and certificates."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import wraps
from pathlib import Path
from typing import Any, Final

import click

from adapters.mal import Certificates, Encoding
from adapters.mrs.transport import NAME, PORT, TransportSettings
from executive.values.quantities import QuantityError, read_quantity

ADDRESS: Final = f"maltcp://127.0.0.1:{PORT}/{NAME}"

Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]

json_option: Final = click.option(
    "--json", "as_json", is_flag=True, help="Print JSON, one object a line."
)


def _named(_: click.Context, __: click.Parameter, name: str | None) -> str | None:
    if name == "":
        raise click.BadParameter("the source is empty: give a name")
    return name


class QuantityType(click.ParamType[float]):
    """A number, possibly with a unit; an angle needs one. Its value is in the SI unit.

    Args:
        unit: the SI unit.
        comma: whether a decimal comma is accepted: only if no second number may follow.
    """

    name = "quantity"

    def __init__(self, unit: str, *, comma: bool = True) -> None:
        self._unit = unit
        self._comma = comma

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Return the value in its SI unit."""
        if isinstance(value, float):
            return value
        try:
            bare = not self._unit.startswith("rad")
            return read_quantity(str(value), self._unit, bare=bare, comma=self._comma)
        except QuantityError as error:
            self.fail(str(error), param, ctx)


source_option: Final = click.option(
    "--source",
    callback=_named,
    help="Source of the commands.  [default: name of the certificate, MOE in clear text]",
)


@dataclass(frozen=True, slots=True)
class RoverTarget:
    """A rover, as given by the options.

    Attributes:
        uri: `maltcp://host:port/MRS`, `host:port` or `host`.
    """

    uri: str
    terms: TransportSettings


def to_option(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options for the address of a rover, passed to the function as `to: RoverTarget`."""
    return _add_address(function, multiple=False)


def to_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the same for any number of rovers, as `to: tuple[RoverTarget, ...]`.

    Encoding and certificates are the same for all.
    """
    return _add_address(function, multiple=True)


def _add_address(function: Callable[..., Any], *, multiple: bool) -> Callable[..., Any]:
    @wraps(function)
    def with_target(
        *arguments: Any, to: Any, delay: float, terms: TransportSettings, **others: Any
    ) -> Any:
        if delay < 0.0:
            raise click.BadParameter(f"{delay:g} s is negative", param_hint="--delay")
        terms = replace(terms, round_trip_s=delay)
        found = tuple(RoverTarget(uri, terms) for uri in to) if multiple else RoverTarget(to, terms)
        return function(*arguments, to=found, **others)

    add_terms = _terms_options(
        {
            "certificate": "PEM file with your certificate",
            "key": "PEM file with its private key",
            "authorities": "PEM file with the authorities that sign the rover's certificate",
        },
        "Encoding of message bodies of the rover.",
        click.Path(exists=True, dir_okay=False, readable=True, path_type=Path),
        environment=True,
    )
    where = "Address of the rover: maltcp://host:port/MRS, host:port or host."
    add_address = click.option(
        "--to",
        envvar="ROVER_URI",
        multiple=multiple,
        default=(ADDRESS,) if multiple else ADDRESS,
        show_default=True,
        show_envvar=True,
        metavar="URI",
        help=f"{where} Repeat it for each rover." if multiple else where,
    )
    add_delay = click.option(
        "--delay",
        type=QuantityType("s"),
        envvar="ROVER_DELAY",
        default=0.0,
        show_envvar=True,
        metavar="TIME",
        help="Round-trip time of the link, such as 10s: all timeouts are longer by it.",
    )
    return add_address(add_delay(add_terms(with_target)))


def add_terms_options(peer: str) -> Decorator:
    """Add the options of a server process, passed to it as `clear_text` and `terms`.

    Args:
        peer: owner of the certificate, for the help.
    """
    add_clear_text = click.option(
        "--clear-text",
        is_flag=True,
        help="Serve at an address that other hosts can reach: each of them may read and command.",
    )
    add_terms = _terms_options(
        {
            "certificate": f"certificate of this {peer}, with the name of --host or a name for it",
            "key": "its private key, without a password",
            "authorities": "the authorities that sign the certificates of clients",
        },
        "Encoding of message bodies in both directions.",
        click.Path(path_type=Path),
        metavar="PEM",
    )
    return lambda function: add_clear_text(add_terms(function))


def _terms_options(
    certificates: Mapping[str, str],
    encoding: str,
    pem: click.Path,
    *,
    environment: bool = False,
    metavar: str | None = None,
) -> Decorator:
    """Return a decorator that adds encoding and certificates, passed on as `terms`."""

    def option(name: str, **others: Any) -> Any:
        if environment:
            others |= {"envvar": f"ROVER_{name.upper()}", "show_envvar": True}
        return click.option(f"--{name}", **others)

    options = [
        option(
            "encoding",
            type=click.Choice([encoding.value for encoding in Encoding]),
            default=Encoding.FIXED.value,
            show_default=True,
            help=encoding,
        ),
        *(
            option(name, type=pem, metavar=metavar, help=f"TLS: {meaning}.")
            for name, meaning in certificates.items()
        ),
    ]

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
            match [path for path in (certificate, key, authorities) if path]:
                case []:
                    own = None
                case [first, second, third]:
                    own = Certificates(first, second, third)
                case _:
                    variables = ", ".join(f"ROVER_{name.upper()}" for name in certificates)
                    raise click.UsageError(
                        "TLS needs all three: --certificate, --key and --authorities"
                        + (f" (or {variables})" if environment else "")
                    )
            return function(*arguments, terms=TransportSettings(Encoding(encoding), own), **others)

        for add in reversed(options):
            add(with_terms)
        return with_terms

    return decorate
