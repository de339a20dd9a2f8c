"""Recordings that are looked at: each is one more asset, whose past comes from its file.

What a file holds is read once, into a database of its own that ends with the process; all requests
for the past are answered from that, as those for a rover are from the archive.
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
from adapters.console.web import answer, refused
from adapters.recording import RecordingError
from executive.history import RunHistory

_LOG: Final = logging.getLogger(__name__)

MOST_OCTETS: Final = 1 << 30
"""Of a file that a browser sends."""
PART: Final = 5000
"""Messages that are read, and then written, at once."""
PIECE: Final = 1 << 18


@dataclass(frozen=True, slots=True)
class Recording:
    """A recording that was read.

    Attributes:
        path: of the file.
        stamp: its octets, and when it was changed (ns since 1970 UTC), when it was read.
        folder: what is here of it.
        archive: what it told, as of a rover.
        history: what explanations are made from.
    """

    path: Path
    stamp: tuple[int, int] | None
    folder: Path
    entry: AssetEntry
    archive: Archive
    history: RunHistory


class Recordings:
    """Opens recordings, and answers the requests for that.

    Args:
        folder: where their databases are, and files that browsers sent.
        publish: tells pages that there is another asset, or one less.
        utc: the time.
    """

    def __init__(
        self,
        folder: Path,
        publish: Callable[[DictionaryChanged], None],
        utc: Callable[[], float],
    ) -> None:
        self._folder, self._publish, self._utc = folder, publish, utc
        self._opened: dict[str, Recording] = {}
        self._opening = asyncio.Lock()

    def routes(self) -> list[web.RouteDef]:
        """Return where they are answered."""
        return [
            web.post("/api/recordings/{file}", self._receive),
            web.delete("/api/recordings/{asset}", self._delete),
        ]

    def entries(self) -> Iterator[AssetEntry]:
        """Yield what there is of each."""
        return (each.entry for each in self._opened.values())

    def get(self, asset: str | None) -> Recording | None:
        """Return the recording that is shown as an asset; None if that is none."""
        return None if asset is None else self._opened.get(asset)

    async def open(self, path: Path, is_wanted: Callable[[], bool] = lambda: True) -> Recording:
        """Read a recording; the same file again is read again only if it was changed.

        Args:
            path: of the file.
            is_wanted: whether to go on reading, asked again and again.

        Raises:
            RecordingError: the file cannot be used as a recording, or is not wanted any more; the
                text says why.
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
        """Let go of all of them."""
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
            while part := await asyncio.to_thread(_take, messages):
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
        gone = self._opened.pop(asset)
        await gone.archive.close()
        shutil.rmtree(gone.folder, ignore_errors=True)
        self._publish(DictionaryChanged(asset))

    async def _receive(self, request: web.Request) -> web.Response:
        """Take a file that a browser has."""
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
            text = f"{name} cannot be kept here: {error.strerror}"
            raise refused(HTTPStatus.INSUFFICIENT_STORAGE, text) from error
        return answer(opened.entry, HTTPStatus.CREATED)

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
            if octets > MOST_OCTETS:
                text = (
                    f"{name} is larger than {MOST_OCTETS >> 30} GiB: start rover-console with"
                    f" --recording {name}"
                )
                raise refused(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, text)
            file.write(piece)


def _stamp(path: Path) -> tuple[int, int] | None:
    """Return what tells that a file was not changed; None if there is none."""
    if not path.exists():
        return None
    now = path.stat()
    return now.st_size, now.st_mtime_ns


def _tidy(name: str) -> str:
    """Return a name that can stand in an address and be that of a file."""
    return re.sub(r"[^\w.-]+", "-", name).lstrip(".") or "recording"


def is_connected(request: web.Request) -> Callable[[], bool]:
    """Return what says whether who sent a request still waits for the answer."""
    return lambda: request.transport is not None


def _take(messages: Iterator[Written]) -> list[Written]:
    return list(islice(messages, PART))
