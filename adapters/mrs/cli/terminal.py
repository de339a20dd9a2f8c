"""Shared by the sub-commands that use the MRS: connection, error messages, tables, JSON.

The client is imported at first use, so that `--help` is fast.
"""

import asyncio
import json
import sys
from collections.abc import Awaitable, Callable, Coroutine, Iterable
from dataclasses import fields, is_dataclass
from datetime import UTC, datetime
from enum import Enum
from functools import wraps
from math import isfinite
from typing import TYPE_CHECKING, Any, Final, NoReturn, TypeVar

import click

from adapters.mal import (
    CertificateError,
    Certificates,
    Encoding,
    MalError,
    NamedValue,
    TypedAttribute,
)
from adapters.mrs.cli.options import ADDRESS, RoverTarget, to_option
from adapters.mrs.transport import TransportMismatchError, TransportSettings
from executive.values.reasons import UnknownReason
from executive.values.reports import printable

if TYPE_CHECKING:
    from rich.table import Table

    from adapters.mrs.ground import MrsClient

T = TypeVar("T")

FAILED: Final = 1
COMPLETION_TIMEOUT_S: Final = 1.0
COMPLETED_REPORTS: Final = 200
HINT: Final = (
    "start a rover with `rover demo --stay` (add --relay for one behind the orbiter), or give its"
    " address with --to"
)
TERMS_HINT: Final = (
    "check --certificate, --key and --authorities (all three, or none for clear text), and"
    " --encoding"
)

_TIMES: Final = {"timestamp", "modified", "began", "next", "until"}
_FIGURES: Final = {"value", "octets"}


async def connect(to: RoverTarget, source: str | None = None) -> "MrsClient":
    """Connect; an invalid address is a usage error, other errors get a hint for the operator."""
    from adapters.mrs.ground import MrsClient, UnknownHostError

    try:
        return await MrsClient.connect(to.uri, source, terms=to.terms)
    except ValueError as error:
        raise click.UsageError(f"--to: {error}") from error
    except CertificateError as error:
        raise click.UsageError(f"TLS: {error}") from error
    except TransportMismatchError as error:
        raise ConnectionError(f"{error}; {TERMS_HINT}") from error
    except UnknownHostError as error:
        raise ConnectionError(f"{error}: check --to or ROVER_URI") from error
    except ConnectionError as error:
        raise ConnectionError(f"{error}; {HINT}") from error


def in_session(function: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
    """Wrap a coroutine of a client as a sub-command's callback, with the options of a session.

    An option `source` of the sub-command is the source of the session.
    """

    @to_option
    @wraps(function)
    def callback(to: RoverTarget, source: str | None = None, **given: Any) -> None:
        async def session() -> None:
            async with await connect(to, source) as client:
                await function(client, **given)

        run(session())

    return callback


def completion(
    query: Callable[["MrsClient"], Awaitable[Iterable[str]]],
) -> Callable[[click.Context, click.Parameter, str], list[str]]:
    """Return the completion of an argument by names from the rover; without an answer, none."""

    async def names(to: RoverTarget) -> list[str]:
        async with asyncio.timeout(COMPLETION_TIMEOUT_S), await connect(to) as client:
            return list(await query(client))

    def complete(ctx: click.Context, _: click.Parameter, begun: str) -> list[str]:
        files: list[Any] = [ctx.params.get(name) for name in ("certificate", "key", "authorities")]
        own = Certificates(*files) if all(files) else None
        terms = TransportSettings(Encoding(ctx.params.get("encoding")), own)
        try:
            found = asyncio.run(names(RoverTarget(ctx.params.get("to") or ADDRESS, terms)))
        except (OSError, MalError, click.ClickException):
            return []
        return [name for name in found if name.startswith(begun)]

    return complete


async def plan_ids(client: "MrsClient") -> list[str]:
    """Return the ids of the plans of a rover, to complete them."""
    return [plan.plan_id for plan in await client.get_plan_status()]


async def file_paths(client: "MrsClient") -> list[str]:
    """Return the paths of the files of a rover, to complete them."""
    return [file.path for file in await client.list_files()]


async def command_numbers(client: "MrsClient") -> list[str]:
    """Return the numbers of the last commands of a rover, to complete them; newest first."""
    last = await client.get_last_notification()
    since = None if last is None else max(1, last.cursor - COMPLETED_REPORTS)
    found = [each.report.identity for each in await client.get_notifications(since)]
    return list(dict.fromkeys(str(each.command_id) for each in reversed(found) if each))


def run(session: Coroutine[Any, Any, T]) -> T:
    """Run a session, and return its result.

    It exits 1 after an error answer, a transfer error or a local OSError.
    """
    from adapters.mrs.ground import TransferError
    from adapters.mrs.spec import describe_error

    try:
        return asyncio.run(session)
    except MalError as error:
        fail(describe_error(error))
    except ConnectionError:
        raise
    except (TransferError, OSError) as error:
        fail(str(error))


def echo_line(line: str, *, word: str = "", fg: str | None = None, err: bool = False) -> None:
    """Print one line, with unprintable characters escaped: texts may come from other systems.

    One word may be coloured; `err` prints to standard error.
    """
    line = printable(line)
    coloured = line.replace(word, click.style(word, fg=fg), 1) if word and fg else line
    click.echo(coloured, err=err)


def fail(text: str) -> NoReturn:
    """Print an error, and exit 1."""
    echo_line(f"Error: {text}", err=True)
    sys.exit(FAILED)


def echo_json(value: Any) -> None:
    """Print an MRS value, or a structure of such values, as one line of JSON."""
    click.echo(json.dumps(_plain(value)))


def _plain(value: Any, name: str = "") -> Any:
    match value:
        case None:
            return None
        case Enum():
            return value.name
        case TypedAttribute() | UnknownReason():
            return _plain(value.value)
        case (NamedValue(), *_):
            return {each.name: _plain(each.value) for each in value}
        case tuple() | list():
            return [_plain(each) for each in value]
        case dict():
            return {key: _plain(each, key) for key, each in value.items()}
        case float():
            return value if isfinite(value) else None
        case int() if name in _TIMES:
            return iso(value / 1e9)
        case bytes():
            return value.hex()
        case _ if is_dataclass(value):
            return _plain(plain_fields(value))
        case _:
            return value


def plain_fields(value: Any) -> dict[str, Any]:
    """Return the fields of an MRS value by their names."""
    return {each.name: getattr(value, each.name) for each in fields(value)}


def print_table(rows: Iterable[tuple[str, ...]], *columns: str) -> None:
    """Print a table with column titles."""
    from rich.console import Console

    Console().print(table(rows, *columns))


def table(rows: Iterable[tuple[str, ...]], *columns: str) -> "Table":
    """Return a table of texts without markup, with unprintable characters escaped."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    made = Table(box=box.SIMPLE_HEAD)
    for column in columns:
        made.add_column(column, justify="right" if column in _FIGURES else "left", overflow="fold")
    for row in rows:
        made.add_row(*(Text(printable(text)) for text in row))
    return made


def utc(time_ns: int) -> str:
    """Return a time of the MRS as `YYYY-MM-DD HH:MM:SS` in UTC."""
    return f"{datetime.fromtimestamp(time_ns / 1e9, UTC):%Y-%m-%d %H:%M:%S}"


def iso(utc_s: float) -> str:
    """Return a UTC time in ISO 8601, to the millisecond."""
    return datetime.fromtimestamp(utc_s, UTC).isoformat(timespec="milliseconds")


def clock(utc_s: float | None = None) -> str:
    """Return the local time of day, now or at a UTC time, to the millisecond."""
    time = datetime.now() if utc_s is None else datetime.fromtimestamp(utc_s)
    return f"{time:%H:%M:%S}.{time.microsecond // 1000:03d}"
