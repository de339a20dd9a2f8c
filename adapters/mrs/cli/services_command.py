"""`rover services`: what a rover is, what it serves, and where, as its directory tells."""

import asyncio
from typing import TYPE_CHECKING

import click

from adapters.mrs.cli.sending import connect
from adapters.mrs.cli.target import Target, to_option

if TYPE_CHECKING:
    from rich.table import Table

    from adapters.mrs.spec import ServiceDescriptor


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
    asyncio.run(_show(to))


async def _show(to: Target) -> None:
    from rich.console import Console

    from adapters.mrs.ground import MrsClient

    console = Console(highlight=False)
    async with await connect(MrsClient, to, "MOE") as client:
        asset, found = await client.get_asset(), await client.get_services()
    console.print(
        f"{asset.asset}  {asset.mode.name}\n{asset.description}\n"
        f"domain {'.'.join(asset.domain)}, software {asset.softwareVersion}\n",
        markup=False,
    )
    for provider in dict.fromkeys(each.providerURI for each in found):
        console.print(provider, markup=False, soft_wrap=True)
        console.print(_table([each for each in found if each.providerURI == provider]))


def _table(found: "list[ServiceDescriptor]") -> "Table":
    """Return the services of one provider, with the broker of those that have one."""
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD)
    table.add_column("service", no_wrap=True)
    table.add_column("operations; broker", overflow="fold")
    for each in found:
        said = [", ".join(_operations(each))]
        if each.brokerURI is not None:
            said.append(f"[dim]{escape(each.brokerURI)}[/]")
        table.add_row(escape(each.name), "\n".join(said))
    return table


def _operations(descriptor: "ServiceDescriptor") -> list[str]:
    """Return the operations by name, those that the interface does not know by number."""
    from adapters.mrs.spec import mrs_specification

    service = descriptor.service
    names = {
        operation.number: operation.name
        for area in mrs_specification().areas
        for each in area.services
        for operation in each.operations
        if (operation.area, operation.area_version, operation.service)
        == (service.keyArea, service.keyAreaVersion, service.keyService)
    }
    return [names.get(number, str(number)) for number in descriptor.operations]
