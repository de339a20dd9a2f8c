"""The request that exports archived data, streamed in chunks."""

from collections.abc import AsyncIterator
from enum import Enum, unique
from functools import partial
from http import HTTPStatus
from typing import Final

from aiohttp import web
from sqlalchemy import Connection

from adapters.console.archive import (
    Archive,
    ArchivedParameter,
    ExportCursor,
    Exported,
    export_page,
    find_parameters,
    record_page,
    to_us,
)
from adapters.console.messages import (
    AlarmStatus,
    CommandStatus,
    Notified,
    PlanProgress,
    TreeState,
)
from adapters.console.recordings import Recordings
from adapters.console.requests.export_files import CsvFile, McapFile
from adapters.console.web import MAX_NUMBER, number_of, one_of, refused


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
    ExportKind.REPORTS: Notified,
    ExportKind.TREE: TreeState,
    ExportKind.PLANS: PlanProgress,
    ExportKind.ALARMS: AlarmStatus,
}


class ExportRequests:
    """Serves the request.

    Args:
        archive: archived data of rovers.
        recordings: opened recordings, with their own archives.
    """

    def __init__(self, archive: Archive, recordings: Recordings) -> None:
        self._archive = archive
        self._recordings = recordings

    def routes(self) -> list[web.RouteDef]:
        """Return the route."""
        return [web.get("/api/export", self._export, allow_head=False)]

    async def _export(self, request: web.Request) -> web.StreamResponse:
        form = one_of(ExportFormat, "fmt", request.query.get("fmt", ExportFormat.CSV.value))
        names = request.query.get("what", ExportKind.TELEMETRY.value).split(",")
        wanted = [one_of(ExportKind, "what", name) for name in dict.fromkeys(names)]
        if form is ExportFormat.CSV and len(wanted) > 1:
            text = "what: a CSV file holds one kind; request each alone, or use fmt=mcap"
            raise refused(HTTPStatus.UNPROCESSABLE_ENTITY, text, field="what")
        asset = request.query.get("asset")
        start_us = to_us(number_of(request, "start", 0.0))
        end_us = to_us(number_of(request, "end", MAX_NUMBER))
        recording = self._recordings.find(asset)
        archive = self._archive if recording is None else recording.archive
        await archive.flush()
        file = CsvFile() if form is ExportFormat.CSV else McapFile()

        response = web.StreamResponse()
        response.content_type = file.content_type
        name = "telemetry" if wanted == [ExportKind.TELEMETRY] else "-".join(names)
        response.headers["Content-Disposition"] = f'attachment; filename="{name}.{form.value}"'
        await response.prepare(request)
        await response.write(file.begin())
        for each in wanted:
            pieces = (
                _telemetry(archive, file, asset, start_us, end_us)
                if each is ExportKind.TELEMETRY
                else _write_archived(archive, file, each, asset, start_us, end_us)
            )
            async for piece in pieces:
                await response.write(piece)
        await response.write(file.end())
        await response.write_eof()
        return response


async def _telemetry(
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
