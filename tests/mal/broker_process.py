"""`python -m tests.mal.broker_process`: a separate broker for publishers and subscribers."""

import asyncio
import signal
import ssl
from pathlib import Path
from typing import Final

import click

from adapters.mal.attribute_codec import Encoding
from adapters.mal.errors import SpecificationError
from adapters.mal.provider import Provider
from adapters.mal.specification import Pattern
from adapters.mal.specification_xml import load_specification
from adapters.mal.tls import Certificates

_PEM: Final = click.Path(exists=True, dir_okay=False, path_type=Path)


@click.command()
@click.argument("specification", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--name", default="SharedBroker", show_default=True, help="Last part of its URI.")
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen on.")
@click.option("--port", default=0, show_default=True, help="TCP port; 0 takes a free one.")
@click.option("--certificate", type=_PEM, help="TLS: certificate of this broker.")
@click.option("--key", type=_PEM, help="TLS: private key of this broker.")
@click.option("--authorities", type=_PEM, help="TLS: trusted authorities.")
@click.option("--clear-text", is_flag=True, help="Serve without TLS at a non-loopback address.")
@click.option(
    "--encoding",
    type=click.Choice([encoding.name.lower() for encoding in Encoding]),
    default="fixed",
    show_default=True,
    help="Body encoding of all peers.",
)
@click.option(
    "--droppable",
    multiple=True,
    metavar="SERVICE.OPERATION",
    help="Updates that may be dropped, by age, for a slow subscriber. May be repeated.",
)
def main(
    specification: Path,
    name: str,
    host: str,
    port: int,
    certificate: Path | None,
    key: Path | None,
    authorities: Path | None,
    clear_text: bool,
    encoding: str,
    droppable: tuple[str, ...],
) -> None:
    """Serve every PUBSUB operation of a SPECIFICATION (XML) until SIGINT or SIGTERM.

    It prints its URI when it listens.

    \b
    Example:
      python -m tests.mal.broker_process mrs.xml --droppable Monitoring.monitorValue
    """
    try:
        loaded = load_specification(specification)
    except SpecificationError as fault:
        raise click.ClickException(str(fault)) from fault
    provider = Provider(loaded, name, Encoding[encoding.upper()])
    operations = {
        f"{service.name}.{operation.name}": (service.name, operation.name)
        for area in loaded.areas
        for service in area.services
        for operation in service.operations
        if operation.pattern is Pattern.PUBSUB
    }
    for unknown in set(droppable) - set(operations):
        raise click.UsageError(f"{unknown} is none of {', '.join(operations) or 'no operations'}")
    for label, names in operations.items():
        provider.open(*names, droppable=label in droppable)
    try:
        tls = _context(certificate, key, authorities)
        asyncio.run(_serve(provider, host, port, tls, clear_text))
    except ValueError as fault:
        raise click.UsageError(
            f"{fault} (--certificate, --key, --authorities; --clear-text)"
        ) from fault
    except OSError as fault:
        raise click.ClickException(f"{host}:{port}: {fault.strerror or fault}") from fault


def _context(
    certificate: Path | None, key: Path | None, authorities: Path | None
) -> ssl.SSLContext | None:
    match certificate, key, authorities:
        case None, None, None:
            return None
        case Path(), Path(), Path():
            return Certificates(certificate, key, authorities).for_provider()
        case _:
            raise ValueError("TLS needs all three files")


async def _serve(
    provider: Provider, host: str, port: int, tls: ssl.SSLContext | None, clear_text: bool
) -> None:
    closing, loop = asyncio.Event(), asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, closing.set)
    await provider.start(host, port, tls, clear_text)
    click.echo(str(provider.uri))
    await closing.wait()
    await provider.close()


if __name__ == "__main__":
    main()
