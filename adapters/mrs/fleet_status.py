"""What a rover knows of others, for `rover status`."""

import json
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import click

from adapters.mal import MalError
from adapters.mrs.client import MrsClient
from adapters.mrs.errors import AreaError

if TYPE_CHECKING:
    from rich.table import Table
    from rich.text import Text

    from adapters.mrs.types import ParameterValue


async def show_assets(client: MrsClient, as_json: bool) -> None:
    """Print the rover and all others that it heard of, with their modes."""
    assets = await client.list_assets()
    if as_json:
        for each in assets:
            click.echo(json.dumps({"asset": each.asset, "mode": each.mode.name}))
        return
    table = _table("asset", "mode", "software", "what it is")
    for each in assets:
        texts = (each.asset, each.mode.name, each.softwareVersion, each.description)
        table.add_row(*map(_plain, texts))
    _print(table)


async def show_asset(client: MrsClient, asset: str, as_json: bool) -> None:
    """Print the values that the rover last heard of another.

    Raises:
        click.UsageError: it heard of no such asset.
    """
    try:
        values = await client.get_asset_value(asset)
    except MalError as error:
        if error.number != AreaError.NOT_FOUND.value:
            raise
        text = f"--asset: {asset} was not heard of; `rover status --assets` lists who was"
        raise click.UsageError(text) from error
    if as_json:
        found = {value.name: {"value": _figure(value), "time": _time(value)} for value in values}
        click.echo(json.dumps({"asset": asset, "parameters": found}))
        return
    units = {each.name: each.unit or "" for each in await client.list_definition()}
    table = _table("parameter", "value", "unit", "sampled, UTC")
    for value in values:
        figure = _figure(value)
        shown = "not known" if figure is None else f"{figure:z.3f}"
        table.add_row(_plain(value.name), shown, units.get(value.name, ""), _time(value))
    _print(table)


def _plain(text: str) -> "Text":
    """Return what another rover says as it may stand on a terminal: no markup, no controls."""
    from rich.text import Text

    return Text("".join(sign if sign.isprintable() else "?" for sign in text))


def _figure(value: "ParameterValue") -> float | None:
    return None if value.value is None else float(value.value.value)


def _time(value: "ParameterValue") -> str:
    return datetime.fromtimestamp(value.timestamp / 1e9, UTC).isoformat(timespec="milliseconds")


def _table(*columns: str) -> "Table":
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD)
    for column in columns:
        table.add_column(column, justify="right" if column == "value" else "left")
    return table


def _print(table: "Table") -> None:
    from rich.console import Console

    Console().print(table)
