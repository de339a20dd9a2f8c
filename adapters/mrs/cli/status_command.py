"""`rover status`: mode, work and parameters of a rover, or what it heard of others."""

import asyncio
import json
from datetime import UTC, datetime
from itertools import chain
from math import degrees
from typing import TYPE_CHECKING, Any, Final

import click

from adapters.mrs.cli.sending import connect
from adapters.mrs.cli.target import Target, to_option

if TYPE_CHECKING:
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    from adapters.mrs.ground import MrsClient
    from adapters.mrs.spec import (
        AssetInfo,
        AssetMode,
        AssetStatus,
        CameraState,
        ParameterDefinition,
        ParameterValue,
        PlanUpdate,
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
    from adapters.mrs.ground import MrsClient

    async with await connect(MrsClient, to, "MOE") as client:
        if asset is None:
            await show_assets(client, as_json)
        else:
            await show_asset(client, asset, as_json)


async def _show(to: Target, watch: bool, as_json: bool) -> None:
    from adapters.mrs.ground import MrsClient

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

    camera, status = await client.get_camera_state(), await client.get_status()
    values = _by_name(status)
    plans = await _suspended_plans(client, status.mode)
    lines = (
        _work(status),
        *_ways_out(status.mode, plans),
        _place(values, camera),
        f"{_time(status):%Y-%m-%d %H:%M:%S} UTC aboard",
    )
    head = Text(f"{asset.asset}  {status.mode.name}", style="bold")
    return Group(head, *map(Text, lines), _parameter_table(values, definitions))


def _parameter_table(
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


async def _suspended_plans(client: "MrsClient", mode: "AssetMode") -> "tuple[PlanUpdate, ...]":
    """Return the plans that wait to be resumed, if the rover stands; none where none are told."""
    from adapters.mal import MalError
    from adapters.mrs.spec import AssetMode, PlanStatus

    if mode not in {AssetMode.PAUSED, AssetMode.SAFE, AssetMode.STOPPED}:
        return ()
    try:
        plans = await client.get_plan_status()
    except MalError:  # of a rover that serves no plans; the rest of its status stands
        return ()
    return tuple(plan for plan in plans if plan.status is PlanStatus.SUSPENDED)


def _work(status: "AssetStatus") -> str:
    """Return what is under way, and what waits."""
    if status.activeCommandId is None and not status.queuedCommands:
        doing = "nothing under way, nothing waits"
    else:
        active = "none" if status.activeCommandId is None else str(status.activeCommandId)
        doing = f"command under way {active}, {status.queuedCommands} waiting"
    return doing if status.activePlan is None else f"{doing}, plan {status.activePlan}"


def _place(values: dict[str, float | None], camera: "CameraState") -> str:
    """Return where the rover is, and whether it films."""
    x, y, heading = values.get("POS_X"), values.get("POS_Y"), values.get("HEAD")
    video = f"video {'on' if camera.videoOn else 'off'}"
    if x is None or y is None or heading is None:
        return f"where it is, is not known now, {video}"
    return f"at x {x:z.2f} m, y {y:z.2f} m, heading {degrees(heading):z.1f}°, {video}"


def _ways_out(mode: "AssetMode", suspended: "tuple[PlanUpdate, ...]") -> tuple[str, ...]:
    """Return why it stands, as far as its plans tell, and how it goes on; nothing if it does."""
    from adapters.mrs.spec import AssetMode

    first: tuple[str, ...] = ()
    if mode is AssetMode.STOPPED:
        first = ("to go on: rover command resume",)
    if mode is AssetMode.SAFE:
        first = ("rover watch says why; to go on, when that is over: rover command resume",)
    plans = (
        (
            f"plan {plan.planId} is suspended: {plan.text}",
            f"to go on: rover plan resume {plan.planId}",
        )
        for plan in suspended
    )
    return (*first, *chain.from_iterable(plans))


async def show_assets(client: "MrsClient", as_json: bool) -> None:
    """Print the rover and all others that it heard of, with their modes."""
    assets = await client.list_assets()
    if as_json:
        for each in assets:
            click.echo(json.dumps({"asset": each.asset, "mode": each.mode.name}))
        return
    table = _assets_table("asset", "mode", "software", "what it is")
    for each in assets:
        texts = (each.asset, each.mode.name, each.softwareVersion, each.description)
        table.add_row(*map(_plain_text, texts))
    _print_table(table)


async def show_asset(client: "MrsClient", asset: str, as_json: bool) -> None:
    """Print the values that the rover last heard of another.

    Raises:
        click.UsageError: it heard of no such asset.
    """
    from adapters.mal import MalError
    from adapters.mrs.spec import AreaError

    try:
        values = await client.get_asset_value(asset)
    except MalError as error:
        if error.number != AreaError.NOT_FOUND.value:
            raise
        text = f"--asset: {asset} was not heard of; `rover status --assets` lists who was"
        raise click.UsageError(text) from error
    if as_json:
        found = {value.name: {"value": _figure(value), "time": _sampled(value)} for value in values}
        click.echo(json.dumps({"asset": asset, "parameters": found}))
        return
    units = {each.name: each.unit or "" for each in await client.list_definition()}
    table = _assets_table("parameter", "value", "unit", "sampled, UTC")
    for value in values:
        figure = _figure(value)
        shown = "not known" if figure is None else f"{figure:z.3f}"
        table.add_row(_plain_text(value.name), shown, units.get(value.name, ""), _sampled(value))
    _print_table(table)


def _plain_text(text: str) -> "Text":
    """Return what another rover says as it may stand on a terminal: no markup, no controls."""
    from rich.text import Text

    return Text("".join(sign if sign.isprintable() else "?" for sign in text))


def _sampled(value: "ParameterValue") -> str:
    return datetime.fromtimestamp(value.timestamp / 1e9, UTC).isoformat(timespec="milliseconds")


def _assets_table(*columns: str) -> "Table":
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD)
    for column in columns:
        table.add_column(column, justify="right" if column == "value" else "left")
    return table


def _print_table(table: "Table") -> None:
    from rich.console import Console

    Console().print(table)
