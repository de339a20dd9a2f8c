"""`Recordings` opens recordings for the pages: each is one more asset, with an archive of its own.

A file is read once, into its own database, which is deleted at the end of the process. All requests
for the history are answered from it, as requests for a rover are from the archive.
"""

import asyncio
import logging
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from http import HTTPStatus
from itertools import chain, count, islice
from pathlib import Path, PurePosixPath
from typing import Final

from aiohttp import web

from adapters.console.archive import Archive, Written, open_database
from adapters.console.messages import DictionaryChanged
from adapters.console.recordings.recorded import RecordedRun
from adapters.console.rovers import AssetEntry
from adapters.console.web import json_response, refused
from adapters.recording import RecordingError
from executive.history import RunHistory

_LOG: Final = logging.getLogger(__name__)

MAX_UPLOAD_OCTETS: Final = 1 << 30
"""Maximum size of an uploaded file."""
PART: Final = 5000
"""Messages of one batch of reading and writing."""
PIECE: Final = 1 << 18


@dataclass(frozen=True, slots=True)
class Recording:
    """An opened recording.

    Attributes:
        path: path of the file.
        stamp: size in octets and change time (ns since 1970 UTC) of the file that was read.
        folder: folder of its database, and of an uploaded file.
        archive: its messages.
        history: run history for explanations.
    """

    path: Path
    stamp: tuple[int, int] | None
    folder: Path
    entry: AssetEntry
    archive: Archive
    history: RunHistory


class Recordings:
    """Opens recordings, and serves the requests for that.

    Args:
        folder: folder for their databases and for uploaded files.
        publish: notifies pages of a new or removed asset.
        utc: clock, s since 1970 UTC.
    """

    def __init__(
        self, folder: Path, publish: Callable[[DictionaryChanged], None], utc: Callable[[], float]
    ) -> None:
        self._folder, self._publish, self._utc = folder, publish, utc
        self._opened: dict[str, Recording] = {}
        self._opening = asyncio.Lock()

    def routes(self) -> list[web.RouteDef]:
        """Return the routes."""
        return [
            web.post("/api/recordings/{file}", self._receive),
            web.delete("/api/recordings/{asset}", self._delete),
        ]

    def entries(self) -> Iterator[AssetEntry]:
        """Yield their dictionary entries."""
        return (each.entry for each in self._opened.values())

    def find(self, asset: str | None) -> Recording | None:
        """Return the recording of an asset; None if the asset is no recording."""
        return None if asset is None else self._opened.get(asset)

    async def open(self, path: Path, is_wanted: Callable[[], bool] = lambda: True) -> Recording:
        """Read a recording; an opened file is read again only if it has changed.

        Args:
            path: path of the file.
            is_wanted: called repeatedly; reading ends once it returns False.

        Raises:
            RecordingError: the file cannot be used as a recording, or is no longer wanted; the
                text gives the reason.
        """
        async with self._opening:
            path = path.resolve()
            known = next((each for each in self._opened.values() if each.path == path), None)
            if known is not None:
                if _stamp(path) in {known.stamp, None}:
                    return known
                await self._close(known.entry.asset)
            return await self._read(path, await self._new_folder(), is_wanted)

    async def close(self) -> None:
        """Close all recordings."""
        for asset in list(self._opened):
            await self._close(asset)

    async def _new_folder(self) -> Path:
        return Path(await asyncio.to_thread(tempfile.mkdtemp, dir=self._folder))

    async def _read(self, path: Path, folder: Path, is_wanted: Callable[[], bool]) -> Recording:
        now_s = asyncio.get_running_loop().time
        began_s = now_s()
        archive = Archive(await asyncio.to_thread(open_database, None, folder), self._utc)
        try:
            run = await asyncio.to_thread(RecordedRun, path, is_wanted)
            stamp = _stamp(path)
            name = self._name_of(run.rover, path)
            messages = run.messages(name)
            while part := await asyncio.to_thread(_next_part, messages):
                for message in part:
                    archive.put(message)
                await archive.flush()
        except BaseException:
            await archive.close()
            shutil.rmtree(folder)
            raise
        opened = Recording(path, stamp, folder, run.entry(), archive, run.history())
        self._opened[name] = opened
        self._publish(DictionaryChanged(name))
        _LOG.info("%s was read in %.1f s: %s", path, now_s() - began_s, name)
        return opened

    def _name_of(self, rover: str, path: Path) -> str:
        name = f"{rover}@{_tidy(path.stem)}"
        others = (f"{name}-{number}" for number in count(2))
        return next(each for each in chain([name], others) if each not in self._opened)

    async def _close(self, asset: str) -> None:
        closed = self._opened.pop(asset)
        await closed.archive.close()
        shutil.rmtree(closed.folder, ignore_errors=True)
        self._publish(DictionaryChanged(asset))

    async def _receive(self, request: web.Request) -> web.Response:
        """Receive a file that a browser uploads, and open it."""
        name = PurePosixPath(request.match_info["file"]).name
        folder = await self._new_folder()
        path = folder / _tidy(name)
        try:
            try:
                await _receive_into(path, request, name)
            except BaseException:
                shutil.rmtree(folder)
                raise
            async with self._opening:
                opened = await self._read(path, folder, is_connected(request))
        except RecordingError as error:
            text = str(error).replace(str(path), name)
            raise refused(HTTPStatus.UNPROCESSABLE_ENTITY, text, field="file") from error
        except OSError as error:
            text = f"{name} cannot be stored: {error.strerror}"
            raise refused(HTTPStatus.INSUFFICIENT_STORAGE, text) from error
        return json_response(opened.entry, HTTPStatus.CREATED)

    async def _delete(self, request: web.Request) -> web.Response:
        asset = request.match_info["asset"]
        if asset not in self._opened:
            raise refused(HTTPStatus.NOT_FOUND, f"there is no recording {asset[:64]!r} open")
        await self._close(asset)
        return web.Response(status=HTTPStatus.NO_CONTENT)


async def _receive_into(path: Path, request: web.Request, name: str) -> None:
    octets = 0
    with path.open("wb") as file:
        async for piece in request.content.iter_chunked(PIECE):
            octets += len(piece)
            if octets > MAX_UPLOAD_OCTETS:
                text = (
                    f"{name} is larger than {MAX_UPLOAD_OCTETS >> 30} GiB: start rover-console with"
                    f" --recording {name}"
                )
                raise refused(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, text)
            file.write(piece)


def _stamp(path: Path) -> tuple[int, int] | None:
    """Return size and change time of a file; None if it does not exist."""
    if not path.exists():
        return None
    now = path.stat()
    return now.st_size, now.st_mtime_ns


def _tidy(name: str) -> str:
    """Return a name that is valid in a URL and as a file name."""
    return re.sub(r"[^\w.-]+", "-", name).lstrip(".") or "recording"


def is_connected(request: web.Request) -> Callable[[], bool]:
    """Return a function that tests whether the client of a request is still connected."""
    return lambda: request.transport is not None


def _next_part(messages: Iterator[Written]) -> list[Written]:
    return list(islice(messages, PART))
