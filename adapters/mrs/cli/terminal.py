"""What all sub-commands do alike: connect for a person, say what failed, print tables and JSON.

The client is imported when it is needed, so that help is quick.
"""

import asyncio
import json
import sys
from collections.abc import Callable, Coroutine, Iterable
from dataclasses import fields, is_dataclass
from datetime import UTC, datetime
from enum import Enum
from functools import wraps
from math import isfinite
from typing import TYPE_CHECKING, Any, Final

import click

from adapters.mal import CertificateError, MalError, NamedValue, TypedAttribute
from adapters.mrs.cli.options import RoverTarget, to_option
from adapters.mrs.terms import TransportMismatchError
from executive.values.reports import printable

if TYPE_CHECKING:
    from rich.table import Table

    from adapters.mrs.ground import MrsClient

FAILED: Final = 1
HINT: Final = (
    "start a rover with `rover demo --stay` (add --relay for one behind the orbiter), or say where"
    " one is with --to"
)
TERMS_HINT: Final = (
    "say how it is spoken to with --certificate, --key and --authorities (or without them), and"
    " --encoding"
)

_TIMES: Final = {"timestamp", "modified", "began"}
_FIGURES: Final = {"value", "octets"}


async def connect(to: RoverTarget, source: str | None = None) -> "MrsClient":
    """Connect for a person: an address that is none is a usage error, and a silent rover a hint."""
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
        raise ConnectionError(f"{error}: look at --to, or at ROVER_URI") from error
    except ConnectionError as error:
        raise ConnectionError(f"{error}; {HINT}") from error


def in_session(function: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
    """Make a coroutine of a client the callback of a sub-command, with the options of a session.

    Where the sub-command has an option `source`, that is whose session it is.
    """

    @to_option
    @wraps(function)
    def callback(to: RoverTarget, source: str | None = None, **given: Any) -> None:
        async def session() -> None:
            async with await connect(to, source) as client:
                await function(client, **given)

        run(session())

    return callback


def run(session: Coroutine[Any, Any, None]) -> None:
    """Run a session; what the rover answers by an error, or cannot be stored here, exits 1."""
    from adapters.mrs.ground import TransferError
    from adapters.mrs.spec import describe_error

    try:
        asyncio.run(session)
    except MalError as error:
        fail(describe_error(error))
    except ConnectionError:
        raise
    except (TransferError, OSError) as error:
        fail(str(error))


def say(line: str, *, word: str = "", fg: str | None = None, err: bool = False) -> None:
    """Print one line, whoever its words are of: what is not printable is escaped.

    A word of it may be coloured; with `err` it goes to standard error.
    """
    line = printable(line)
    coloured = line.replace(word, click.style(word, fg=fg), 1) if word and fg else line
    click.echo(coloured, err=err)


def fail(text: str) -> None:
    """Say what failed, and exit 1."""
    say(f"Error: {text}", err=True)
    sys.exit(FAILED)


def echo_json(value: Any) -> None:
    """Print a value of the MRS, or what is made of such values, as one line of JSON."""
    click.echo(json.dumps(_plain(value)))


def _plain(value: Any, name: str = "") -> Any:
    match value:
        case None:
            return None
        case Enum():
            return value.name
        case TypedAttribute():
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
            return iso(value)
        case bytes():
            return value.hex()
        case _ if is_dataclass(value):
            names = (each.name for each in fields(value))
            return {each: _plain(getattr(value, each), each) for each in names}
        case _:
            return value


def print_table(rows: Iterable[tuple[str, ...]], *columns: str) -> None:
    """Print rows of texts under the titles of their columns."""
    from rich.console import Console

    Console().print(table(rows, *columns))


def table(rows: Iterable[tuple[str, ...]], *columns: str) -> "Table":
    """Return rows of texts, whoever said them: without markup, what is not printable escaped."""
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
    """Return a time of the MRS in words."""
    return f"{datetime.fromtimestamp(time_ns / 1e9, UTC):%Y-%m-%d %H:%M:%S}"


def iso(time_ns: int) -> str:
    """Return a time of the MRS by ISO 8601, to the millisecond."""
    return datetime.fromtimestamp(time_ns / 1e9, UTC).isoformat(timespec="milliseconds")


def clock(time_ns: int | None = None) -> str:
    """Return the time of day here, now or at a time of the MRS, to the millisecond."""
    time = datetime.now() if time_ns is None else datetime.fromtimestamp(time_ns / 1e9)
    return f"{time:%H:%M:%S}.{time.microsecond // 1000:03d}"
