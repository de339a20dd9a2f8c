"""`rover services`: what a rover is, what it serves, and where, as its directory tells."""

import click

from adapters.mrs.cli.options import Target, to_option
from adapters.mrs.cli.terminal import connect, print_table, run
from adapters.mrs.spec import ServiceDescriptor, find_service


@click.command()
@to_option
def services(to: Target) -> None:
    """List the services of a rover: operations, provider and broker of each.

    The directory is all that a client has to be told of: it finds the rest by what stands here.
    Services of other assets that registered here are named ASSET.SERVICE.

    \b
    Examples:
      rover services
      rover services --to rover.local:21000
    """
    run(_show(to))


async def _show(to: Target) -> None:
    async with await connect(to) as client:
        asset, found = await client.get_asset(), await client.get_services()
    click.echo(
        f"{asset.asset}  {asset.mode.name}\n{asset.description}\n"
        f"domain {'.'.join(asset.domain)}, software {asset.softwareVersion}\n"
    )
    for provider in dict.fromkeys(each.providerURI for each in found):
        click.echo(provider)
        rows = (
            (each.name, "\n".join(filter(None, (", ".join(_operations(each)), each.brokerURI))))
            for each in found
            if each.providerURI == provider
        )
        print_table(rows, "service", "operations; broker")


def _operations(descriptor: ServiceDescriptor) -> list[str]:
    """Return the operations by name, those that the interface does not know by number."""
    service = find_service(descriptor.service)
    names = {each.number: each.name for each in service.operations} if service else {}
    return [names.get(number, str(number)) for number in descriptor.operations]
