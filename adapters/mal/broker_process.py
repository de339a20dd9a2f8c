"""`python -m adapters.mal.broker_process`: a broker of its own for publishers and subscribers."""

import asyncio
import signal
from pathlib import Path

import click

from adapters.mal.encoding import Encoding
from adapters.mal.errors import SpecificationError
from adapters.mal.provider import Provider
from adapters.mal.specification import Pattern
from adapters.mal.specification_xml import load_specification


@click.command()
@click.argument("specification", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--name", default="SharedBroker", show_default=True, help="Last part of its URI.")
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen on.")
@click.option("--port", default=0, show_default=True, help="TCP port; 0 takes a free one.")
@click.option(
    "--encoding",
    type=click.Choice([encoding.name.lower() for encoding in Encoding]),
    default="fixed",
    show_default=True,
    help="Body encoding that all have agreed on.",
)
@click.option(
    "--droppable",
    multiple=True,
    metavar="SERVICE.OPERATION",
    help="Updates that may be dropped, the oldest first, for who is slow. May be given again.",
)
def main(
    specification: Path, name: str, host: str, port: int, encoding: str, droppable: tuple[str, ...]
) -> None:
    """Serve every PUBSUB operation of a SPECIFICATION (XML) until SIGINT or SIGTERM.

    It prints its URI once it listens.

    \b
    Example:
      python -m adapters.mal.broker_process mrs.xml --droppable Monitoring.monitorValue
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
        asyncio.run(_serve(provider, host, port))
    except OSError as fault:
        raise click.ClickException(f"{host}:{port}: {fault.strerror or fault}") from fault


async def _serve(provider: Provider, host: str, port: int) -> None:
    over, loop = asyncio.Event(), asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, over.set)
    await provider.start(host, port)
    click.echo(str(provider.uri))
    await over.wait()
    await provider.close()


if __name__ == "__main__":
    main()
