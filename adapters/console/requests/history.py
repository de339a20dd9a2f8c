"""HTTP requests that read the archive: samples, commands, notifications."""

from collections.abc import Callable
from functools import partial
from itertools import groupby
from operator import itemgetter
from typing import Any, Final, TypeVar

from aiohttp import web
from sqlalchemy import Connection

from adapters.console.archive import (
    MAX_SAMPLES,
    Archive,
    SampleQuery,
    Strategy,
    read_commands,
    read_last_sample,
    read_notifications,
    read_records,
    read_samples,
    to_us,
)
from adapters.console.messages import LinkKind
from adapters.console.recordings import Recordings
from adapters.console.web import (
    MAX_NUMBER,
    body_of,
    count_of,
    invalid,
    is_number,
    json_answer,
    json_response,
    number_of,
    one_of,
    requested_page,
)

T = TypeVar("T")

SIZE: Final = 500
MAX_KEYS: Final = 1000


class ArchiveRequests:
    """Serves these requests.

    Args:
        archive: archived data of rovers.
        recordings: opened recordings, with their own archives.
    """

    def __init__(self, archive: Archive, recordings: Recordings) -> None:
        self._archive = archive
        self._recordings = recordings

    def routes(self) -> list[web.RouteDef]:
        """Return the routes."""
        return [
            web.get("/api/tm/{asset}/{key}", self._samples),
            web.post("/api/tm:batch", self._last_samples),
            web.get("/api/commands", self._commands),
            web.get("/api/notifications", self._notifications),
            web.get("/api/records/{ty}", self._records),
        ]

    def _archive_of(self, asset: str | None) -> Archive:
        """Return the archive with the history of an asset."""
        recording = self._recordings.find(asset)
        return self._archive if recording is None else recording.archive

    async def _read(self, asset: str | None, act: Callable[[Connection], T]) -> T:
        """Write the queue, then read the history of an asset; None for all rovers."""
        archive = self._archive_of(asset)
        await archive.flush()
        return await archive.read(act)

    async def _samples(self, request: web.Request) -> web.Response:
        wanted = SampleQuery(
            asset=request.match_info["asset"],
            key=request.match_info["key"],
            link=_link(request.query.get("link")),
            start_us=to_us(number_of(request, "start", 0.0)),
            end_us=to_us(number_of(request, "end", MAX_NUMBER)),
            strategy=one_of(Strategy, "strategy", request.query.get("strategy", "latest")),
            size=count_of(request, "size", SIZE, MAX_SAMPLES),
        )
        found = await self._read(wanted.asset, partial(read_samples, wanted=wanted))
        return json_answer(f'{{"samples":{found}}}')

    async def _last_samples(self, request: web.Request) -> web.Response:
        body = await body_of(request)
        keys, end = body.get("keys"), body.get("end", MAX_NUMBER)
        if not isinstance(keys, list) or len(keys) > MAX_KEYS or not all(map(_is_key, keys)):
            text = f"a list of at most {MAX_KEYS} [asset, key] or [asset, key, link] is needed"
            raise invalid("keys", text)
        if not is_number(end) or not abs(end) <= MAX_NUMBER:
            raise invalid("end", "seconds since 1970 UTC are needed")
        found = []
        for asset, wanted in groupby(sorted(keys, key=itemgetter(0)), itemgetter(0)):
            last = [(key, _link(link[0] if link else None)) for _, key, *link in wanted]
            found += await self._read(
                asset, partial(_last_of, asset=asset, wanted=last, end_us=to_us(end))
            )
        return json_response({"samples": found})

    async def _commands(self, request: web.Request) -> web.Response:
        page = requested_page(request)
        found = await self._read(page.asset, partial(read_commands, page=page))
        return json_answer(f'{{"commands":{found}}}')

    async def _notifications(self, request: web.Request) -> web.Response:
        page = requested_page(request)
        found = await self._read(page.asset, partial(read_notifications, page=page))
        return json_answer(f'{{"notifications":{found}}}')

    async def _records(self, request: web.Request) -> web.Response:
        ty, page = request.match_info["ty"], requested_page(request)
        found = await self._read(page.asset, partial(read_records, ty=ty, page=page))
        return json_answer(f'{{"records":{found}}}')


def _last_of(
    connection: Connection, asset: str, wanted: list[tuple[str, LinkKind | None]], end_us: int
) -> list[dict[str, Any]]:
    return [
        sample
        for key, link in wanted
        for sample in read_last_sample(connection, asset, key, link, end_us)
    ]


def _link(value: object) -> LinkKind | None:
    return None if value is None else one_of(LinkKind, "link", value)


def _is_key(key: object) -> bool:
    return (
        isinstance(key, list) and len(key) in {2, 3} and all(isinstance(each, str) for each in key)
    )
