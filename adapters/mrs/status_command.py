"""`rover status`: mode, work and parameters of a rover, as a table or as JSON."""

import asyncio
import json
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Final

import click

from adapters.mrs.sending import connect
from adapters.mrs.target import Target, to_option

if TYPE_CHECKING:
    from rich.console import Group
    from rich.table import Table

    from adapters.mrs.client import MrsClient
    from adapters.mrs.types import (
        AssetInfo,
        AssetStatus,
        CameraState,
        ParameterDefinition,
        ParameterValue,
    )

EVERY_S: Final = 0.5


@click.command()
@to_option
@click.option("--watch", is_flag=True, help="Go on showing it until Ctrl-C.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON, one object a line.")
@click.option("--assets", is_flag=True, help="List this rover and all others that it heard of.")
@click.option("--asset", metavar="NAME", help="Show what this rover last heard of another.")
def status(to: Target, watch: bool, as_json: bool, assets: bool, asset: str | None) -> None:
    """Show what a rover is about: mode, commands, and all parameters with their units.

    \b
    Examples:
      rover status
      rover status --watch
      rover status --json | jq .parameters.BATERY_VOLTAGE.value
      rover status --assets
    """
    if assets and asset is not None:
        raise click.UsageError("either --assets or --asset")
    if watch and (assets or asset is not None):
        raise click.UsageError("--watch shows the rover itself")
    if assets or asset is not None:
        asyncio.run(_show_others(to, asset, as_json))
    else:
        asyncio.run(_show(to, watch, as_json))


async def _show_others(to: Target, asset: str | None, as_json: bool) -> None:
    from adapters.mrs.client import MrsClient
    from adapters.mrs.fleet_status import show_asset, show_assets

    async with await connect(MrsClient, to, "MOE") as client:
        if asset is None:
            await show_assets(client, as_json)
        else:
            await show_asset(client, asset, as_json)


async def _show(to: Target, watch: bool, as_json: bool) -> None:
    from adapters.mrs.client import MrsClient

    async with await connect(MrsClient, to, "MOE") as client:
        asset, definitions = await client.get_asset(), await client.list_definition()
        if as_json:
            while True:
                camera = await client.get_camera_state()
                told = _as_json(asset, await client.get_status(), camera, definitions)
                click.echo(json.dumps(told))
                if not watch:
                    return
                await asyncio.sleep(EVERY_S)
        await _show_table(client, asset, definitions, watch)


async def _show_table(
    client: "MrsClient",
    asset: "AssetInfo",
    definitions: "tuple[ParameterDefinition, ...]",
    watch: bool,
) -> None:
    from rich.console import Console
    from rich.live import Live

    console = Console()
    shown = await _look(client, asset, definitions)
    if not watch:
        console.print(shown)
        return
    with Live(shown, console=console, auto_refresh=False) as live:
        while True:
            await asyncio.sleep(EVERY_S)
            live.update(await _look(client, asset, definitions), refresh=True)


async def _look(
    client: "MrsClient", asset: "AssetInfo", definitions: "tuple[ParameterDefinition, ...]"
) -> "Group":
    from rich.console import Group
    from rich.text import Text

    from adapters.mrs.status_lines import place, suspended_plans, ways_out, work

    camera, status = await client.get_camera_state(), await client.get_status()
    values = _by_name(status)
    plans = await suspended_plans(client, status.mode)
    lines = (
        work(status),
        *ways_out(status.mode, plans),
        place(values, camera),
        f"{_time(status):%Y-%m-%d %H:%M:%S} UTC aboard",
    )
    head = Text(f"{asset.asset}  {status.mode.name}", style="bold")
    return Group(head, *map(Text, lines), _table(values, definitions))


def _table(
    values: dict[str, float | None], definitions: "tuple[ParameterDefinition, ...]"
) -> "Table":
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD)
    table.add_column("parameter")
    table.add_column("value", justify="right")
    table.add_column("unit")
    table.add_column("meaning")
    for definition in definitions:
        figure = values.get(definition.name)
        shown = "not known" if figure is None else f"{figure:z.3f}"
        table.add_row(definition.name, shown, definition.unit or "", definition.description)
    return table


def _as_json(
    asset: "AssetInfo",
    status: "AssetStatus",
    camera: "CameraState",
    definitions: "tuple[ParameterDefinition, ...]",
) -> dict[str, Any]:
    values = _by_name(status)
    return {
        "asset": asset.asset,
        "time": _time(status).isoformat(timespec="milliseconds"),
        "mode": status.mode.name,
        "activeCommandId": status.activeCommandId,
        "queuedCommands": status.queuedCommands,
        "activePlan": status.activePlan,
        "videoOn": camera.videoOn,
        "parameters": {
            definition.name: {"value": values.get(definition.name), "unit": definition.unit}
            for definition in definitions
        },
    }


def _by_name(status: "AssetStatus") -> dict[str, float | None]:
    return {value.name: _figure(value) for value in status.values}


def _figure(value: "ParameterValue") -> float | None:
    return None if value.value is None else float(value.value.value)


def _time(status: "AssetStatus") -> datetime:
    return datetime.fromtimestamp(status.timestamp / 1e9, UTC)
