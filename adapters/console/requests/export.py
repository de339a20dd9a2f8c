"""HTTP request that exports archived data as a file, CSV or MCAP, streamed in chunks.

MCAP has one topic for each kind; its messages are JSON. Telemetry is `{"value", "quality"}` on
`/ASSET/LINK/KEY`, reports are `foxglove.Log` on `/ASSET/reports`, other kinds are console messages
on `/ASSET/KIND`. The publish time is the time aboard, the log time is the reception time.
"""

import csv
import io
import json
import re
from collections.abc import AsyncIterator, Callable, Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from datetime import UTC, datetime, timedelta
from enum import Enum, unique
from functools import partial
from types import NoneType, UnionType
from typing import Any, Final, get_args, get_origin, get_type_hints

from aiohttp import web
from mcap.writer import Writer
from sqlalchemy import Connection

from adapters.console.archive import (
    Archive,
    ArchivedParameter,
    ExportCursor,
    Exported,
    ExportRecord,
    ExportRow,
    export_page,
    find_parameters,
    record_page,
    to_us,
)
from adapters.console.messages import (
    AlarmStatus,
    CommandStatus,
    NotificationMessage,
    PlanProgress,
    TreeNode,
    TreeState,
)
from adapters.console.recordings import Recordings
from adapters.console.rovers import AssetEntry
from adapters.console.web import MAX_NUMBER, invalid, number_of, one_of

Key = tuple[str, str]

LIBRARY: Final = "rover-console"
EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
NS_PER_S: Final = 1_000_000_000
TELEMETRY: Final = {
    "type": "object",
    "properties": {
        "value": {"type": ["number", "string", "null"]},
        "quality": {"enum": ["good", "late", "invalid"]},
    },
}
STAGES: Final = ("SENT", "ACKNOWLEDGED", "FORWARDED", "RECEIVED", "ACCEPTED", "STARTED")
_TIMES: Final = frozenset(
    (
        *("utc", "rx", "created", "deadline", *(stage.lower() for stage in STAGES), "end"),
        *("raised", "last", "cleared", "shelved", "shelved_until"),
    )
)
"""Columns with times; `acknowledged` is one of commands and of alarms."""
_LEVELS: Final = {"INFORMATIONAL": 2, "WARNING": 3, "ALARM": 4, "SEVERE": 4, "CRITICAL": 5}
"""Levels of foxglove.Log: 2 is INFO, 5 is FATAL."""


class CsvFile:
    """CSV file with a header line and one line for each item.

    A tree has one line for each node. A command has one line with the times of its stages. Times
    are ISO 8601 in UTC, telemetry has its unit. Values other than numbers and text are JSON.

    Args:
        units: unit of each parameter, by asset and key.
    """

    content_type = "text/csv"

    def __init__(self, units: Mapping[Key, str]) -> None:
        self._units = units
        self._has_names = False

    def begin(self) -> bytes:
        """Return no octets: the columns depend on the data."""
        return b""

    def samples(self, rows: Sequence[ExportRow]) -> bytes:
        """Return the lines of samples."""
        units = self._units
        lines = (
            (_iso(each.utc), _iso(each.rx), *each[2:], units.get((each.asset, each.key), ""))
            for each in rows
        )
        return self._lines((*ExportRow._fields, "unit"), lines)

    def records(self, _: str, kind: Exported, page: Sequence[ExportRecord]) -> bytes:
        """Return the lines of records."""
        names, lines = _COLUMNS.get(kind, (_names(kind), _one_line))
        rows = (line for each in page for line in lines(each.body))
        return self._lines(names, ([_cell(name, row.get(name)) for name in names] for row in rows))

    def end(self) -> bytes:
        """Return no octets: CSV has no trailer."""
        return b""

    def _lines(self, names: Sequence[str], rows: Iterable[Sequence[object]]) -> bytes:
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        if not self._has_names:
            writer.writerow(names)
            self._has_names = True
        writer.writerows(rows)
        return text.getvalue().encode()


def _names(kind: Any) -> tuple[str, ...]:
    return tuple(each.name for each in fields(kind))


def _cell(name: str, value: Any) -> object:
    if value is not None and name in _TIMES:
        return _iso(value)
    return json.dumps(value) if isinstance(value, dict | list) else value


def _iso(utc_s: float) -> str:
    """Return a time in ISO 8601, UTC, to the microsecond; beyond the year 9999 the number."""
    try:
        at = EPOCH + timedelta(microseconds=to_us(utc_s))
    except OverflowError:
        return str(utc_s)
    return at.isoformat(timespec="microseconds").replace("+00:00", "Z")


def _one_line(body: dict[str, Any]) -> list[dict[str, Any]]:
    return [body]


def _command_line(body: dict[str, Any]) -> list[dict[str, Any]]:
    reached = {each["stage"]: each for each in body["history"]}
    times = {stage.lower(): reached[stage]["utc"] for stage in STAGES if stage in reached}
    last = body["history"][-1] if body["ended"] and body["history"] else {}
    end = {"end": last.get("utc"), "detail": last.get("detail"), "code": last.get("code")}
    return [{**body, **times, **end}]


def _node_lines(body: dict[str, Any]) -> list[dict[str, Any]]:
    return [{**body, **node} for node in body["nodes"]]


_COLUMNS: Final[dict[Exported, tuple[tuple[str, ...], Any]]] = {
    CommandStatus: (
        (
            *(name for name in _names(CommandStatus) if name != "history"),
            *(stage.lower() for stage in STAGES),
            "end",
            "detail",
            "code",
        ),
        _command_line,
    ),
    TreeState: (
        (*(name for name in _names(TreeState) if name != "nodes"), *_names(TreeNode)),
        _node_lines,
    ),
}


class _ChunkBuffer(io.BytesIO):
    """Buffer of written octets since the last `pop`; positions are those of the complete file."""

    def __init__(self) -> None:
        super().__init__()
        self._taken = 0

    def tell(self) -> int:
        return self._taken + super().tell()

    def pop(self) -> bytes:
        piece = self.getvalue()
        self._taken += len(piece)
        self.seek(0)
        self.truncate()
        return piece


class McapFile:
    """MCAP file with a topic for each parameter and link, and for each kind of records."""

    content_type = "application/octet-stream"

    def __init__(self) -> None:
        self._pieces = _ChunkBuffer()
        self._writer = Writer(self._pieces)
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}

    def begin(self) -> bytes:
        """Return the header."""
        self._writer.start(library=LIBRARY)
        return self._pieces.pop()

    def samples(self, rows: Sequence[ExportRow]) -> bytes:
        """Return the octets of samples; the writer may buffer some until a chunk is complete."""
        for row in rows:
            channel = self._channel(f"/{row.asset}/{row.link}/{row.key}", "telemetry", TELEMETRY)
            self._add(channel, row.utc, row.rx, {"value": row.value, "quality": row.quality})
        return self._pieces.pop()

    def records(self, name: str, kind: Exported, page: Sequence[ExportRecord]) -> bytes:
        """Return the octets of records, on topics of that name."""
        for each in page:
            topic = f"/{each.body['asset']}/{name}"
            if kind is NotificationMessage:
                channel = self._channel(topic, "foxglove.Log", LOG)
                self._add(channel, each.utc, each.rx, _log(each))
            else:
                channel = self._channel(topic, f"rover.{kind.__name__}", schema_of(kind))
                self._add(channel, each.utc, each.rx, each.body)
        return self._pieces.pop()

    def end(self) -> bytes:
        """Return the remaining octets, with the index."""
        self._writer.finish()
        return self._pieces.pop()

    def _channel(self, topic: str, name: str, schema: dict[str, Any]) -> int:
        if topic not in self._channels:
            if name not in self._schemas:
                octets = json.dumps(schema).encode()
                self._schemas[name] = self._writer.register_schema(name, "jsonschema", octets)
            channel = self._writer.register_channel(topic, "json", self._schemas[name])
            self._channels[topic] = channel
        return self._channels[topic]

    def _add(self, channel: int, utc: float, rx: float, body: dict[str, Any]) -> None:
        self._writer.add_message(
            channel, log_time=_ns(rx), data=json.dumps(body).encode(), publish_time=_ns(utc)
        )


def _ns(utc_s: float) -> int:
    """Return a time in whole microseconds, as the archive has it."""
    return to_us(utc_s) * 1000


def _log(report: ExportRecord) -> dict[str, Any]:
    """Return a report as a `foxglove.Log` message, with the complete report."""
    sec, nsec = divmod(_ns(report.utc), NS_PER_S)
    body = report.body
    return {
        "timestamp": {"sec": sec, "nsec": nsec},
        "level": _LEVELS[body["severity"]],
        "message": body["text"],
        "name": body["asset"],
        "file": "",
        "line": 0,
        "report": body,
    }


def schema_of(kind: Any) -> dict[str, Any]:
    """Return the JSON schema of a type, for the encoding of `messages.plain`."""
    options = get_args(kind) if isinstance(kind, UnionType) else ()
    if options and NoneType in options:
        others = [schema_of(each) for each in options if each is not NoneType]
        return {"anyOf": [*others, {"type": "null"}]}
    if is_dataclass(kind):
        hints = get_type_hints(kind)
        return {
            "type": "object",
            "properties": {each.name: schema_of(hints[each.name]) for each in fields(kind)},
        }
    if get_origin(kind) is tuple:
        return {"type": "array", "items": schema_of(get_args(kind)[0])}
    if isinstance(kind, type) and issubclass(kind, Enum):
        return {"enum": [each.value for each in kind]}
    return {"type": _TYPES[kind]} if kind in _TYPES else {"type": "object"}


_TYPES: Final = {str: "string", int: "integer", bool: "boolean", float: "number"}
LOG: Final = {
    "type": "object",
    "properties": {
        "timestamp": {
            "type": "object",
            "title": "time",
            "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}},
        },
        "level": {"type": "integer"},
        "message": {"type": "string"},
        "name": {"type": "string"},
        "file": {"type": "string"},
        "line": {"type": "integer"},
        "report": schema_of(NotificationMessage),
    },
}
"""Schema of https://docs.foxglove.dev/docs/sdk/schemas/log, with the report."""


@unique
class ExportFormat(Enum):
    """Format of an export."""

    CSV = "csv"
    MCAP = "mcap"


@unique
class ExportKind(Enum):
    """Kind of exported data."""

    TELEMETRY = "tm"
    COMMANDS = "commands"
    REPORTS = "reports"
    TREE = "tree"
    PLANS = "plans"
    ALARMS = "alarms"


_ARCHIVED_TYPES: Final[dict[ExportKind, Exported]] = {
    ExportKind.COMMANDS: CommandStatus,
    ExportKind.REPORTS: NotificationMessage,
    ExportKind.TREE: TreeState,
    ExportKind.PLANS: PlanProgress,
    ExportKind.ALARMS: AlarmStatus,
}


class ExportRequests:
    """Serves the request.

    Args:
        archive: archived data of rovers.
        recordings: opened recordings, with their own archives.
        entries: returns the dictionary entry of each asset.
    """

    def __init__(
        self, archive: Archive, recordings: Recordings, entries: Callable[[], Iterable[AssetEntry]]
    ) -> None:
        self._archive = archive
        self._recordings = recordings
        self._entries = entries

    def routes(self) -> list[web.RouteDef]:
        """Return the route."""
        return [web.get("/api/export", self._export, allow_head=False)]

    def _units(self) -> dict[Key, str]:
        return {
            (one.asset, each.key): each.unit for one in self._entries() for each in one.parameters
        }

    async def _export(self, request: web.Request) -> web.StreamResponse:
        form = one_of(ExportFormat, "format", request.query.get("format", ExportFormat.CSV.value))
        names = request.query.get("content", ExportKind.TELEMETRY.value).split(",")
        wanted = [one_of(ExportKind, "content", name) for name in dict.fromkeys(names)]
        if form is ExportFormat.CSV and len(wanted) > 1:
            text = "a CSV file holds one kind; request each alone, or use format=mcap"
            raise invalid("content", text)
        asset = request.query.get("asset")
        start_us = to_us(number_of(request, "start", 0.0))
        end_us = to_us(number_of(request, "end", MAX_NUMBER))
        recording = self._recordings.find(asset)
        archive = self._archive if recording is None else recording.archive
        await archive.flush()
        file = CsvFile(self._units()) if form is ExportFormat.CSV else McapFile()

        response = web.StreamResponse()
        response.content_type = file.content_type
        name = _file_name(request, wanted)
        response.headers["Content-Disposition"] = f'attachment; filename="{name}.{form.value}"'
        await response.prepare(request)
        await response.write(file.begin())
        for each in wanted:
            pieces = (
                _telemetry_pages(archive, file, asset, start_us, end_us)
                if each is ExportKind.TELEMETRY
                else _write_archived(archive, file, each, asset, start_us, end_us)
            )
            async for piece in pieces:
                await response.write(piece)
        await response.write(file.end())
        await response.write_eof()
        return response


def _file_name(request: web.Request, wanted: Sequence[ExportKind]) -> str:
    """Return the name of a file without its ending: ASSET_CONTENT_START_END, as far as given."""
    content = ["telemetry" if each is ExportKind.TELEMETRY else each.value for each in wanted]
    span = [
        re.sub(r"[-:]|\.\d+", "", _iso(number_of(request, name, 0.0)))
        for name in ("start", "end")
        if name in request.query
    ]
    parts = (request.query.get("asset", ""), "-".join(content), *span)
    return re.sub(r"[^\w.@-]", "-", "_".join(filter(None, parts)), flags=re.ASCII)


async def _telemetry_pages(
    archive: Archive, file: CsvFile | McapFile, asset: str | None, start_us: int, end_us: int
) -> AsyncIterator[bytes]:
    def write_page(
        connection: Connection, parameter: ArchivedParameter, since_us: int
    ) -> tuple[bytes, int | None]:
        rows, next_us = export_page(connection, parameter, since_us, end_us)
        return file.samples(rows), next_us

    yield file.samples([])
    for parameter in await archive.read(partial(find_parameters, asset=asset)):
        since_us: int | None = start_us
        while since_us is not None:
            octets, since_us = await archive.read(
                partial(write_page, parameter=parameter, since_us=since_us)
            )
            yield octets


async def _write_archived(
    archive: Archive,
    file: CsvFile | McapFile,
    what: ExportKind,
    asset: str | None,
    start_us: int,
    end_us: int,
) -> AsyncIterator[bytes]:
    def write_page(
        connection: Connection, after: ExportCursor | None
    ) -> tuple[bytes, ExportCursor | None]:
        page, cursor = record_page(
            connection, _ARCHIVED_TYPES[what], asset, start_us, end_us, after
        )
        return file.records(what.value, _ARCHIVED_TYPES[what], page), cursor

    octets, after = await archive.read(partial(write_page, after=None))
    yield octets
    while after is not None:
        octets, after = await archive.read(partial(write_page, after=after))
        yield octets
