"""The requests for files aboard: a list, and a file, which is fetched once and kept here.

What a rover sends is not trusted: a browser shows it as a picture, or saves it, and runs nothing.
"""

import asyncio
import hashlib
from collections import defaultdict
from dataclasses import dataclass
from http import HTTPStatus
from pathlib import Path, PurePosixPath
from typing import Final
from urllib.parse import quote

from aiohttp import web

from adapters.console.messages import Scalar
from adapters.console.requests.commanding import Commanding
from adapters.console.rovers import NS_PER_S, figures_of
from adapters.console.web import answer, refused
from adapters.mal import MalError
from adapters.mrs.ground import MrsClient, TransferError
from adapters.mrs.spec import AreaError, FileInfo, describe_error

MOST_KEPT: Final = 1_000_000_000
"""Octets of fetched files; those that were fetched longest ago go first."""
_SHOWN: Final = {"image/jpeg", "image/png", "image/gif", "image/webp"}


@dataclass(frozen=True, slots=True)
class FileEntry:
    """A file aboard.

    Attributes:
        checksum: CRC-32 of the content; None where the list does not tell it.
        meta: what is known of it, such as where a picture was taken.
    """

    path: str
    size: int
    modified: float
    mime: str | None
    checksum: int | None
    meta: dict[str, Scalar]


class Files:
    """Answers these requests.

    Args:
        commanding: knows the assets.
        folder: where fetched files are kept.
    """

    def __init__(self, commanding: Commanding, folder: Path) -> None:
        self._commanding = commanding
        self._folder = folder
        self._fetching: defaultdict[Path, asyncio.Lock] = defaultdict(asyncio.Lock)

    def routes(self) -> list[web.RouteDef]:
        """Return where they are answered."""
        return [
            web.get("/api/files/{asset}", self._list),
            web.get("/api/files/{asset}/{path:.+}", self._file),
        ]

    async def _list(self, request: web.Request) -> web.Response:
        client = self._commanding.client(request.match_info["asset"])
        try:
            found = await client.list_files(request.query.get("folder"))
        except (MalError, ConnectionError) as error:
            raise _refused(error) from error
        return answer({"files": list(map(_entry, found))})

    async def _file(self, request: web.Request) -> web.StreamResponse:
        asset, path = request.match_info["asset"], request.match_info["path"]
        client = self._commanding.client(asset)
        try:
            file = await client.get_attributes(path)
            if "about" in request.query:
                return answer(_entry(file))
            here = await self._fetch(client, asset, file)
        except (MalError, ConnectionError, TransferError, OSError) as error:
            raise _refused(error) from error
        name = quote(PurePosixPath(file.path).name)
        how = "inline" if file.mimeType in _SHOWN else "attachment"
        mime = file.mimeType if file.mimeType in _SHOWN else "application/octet-stream"
        return web.FileResponse(
            here,
            headers={
                "Content-Type": str(mime),
                "Content-Disposition": f"{how}; filename*=UTF-8''{name}",
                "Content-Security-Policy": "default-src 'none'; sandbox",
            },
        )

    async def _fetch(self, client: MrsClient, asset: str, file: FileInfo) -> Path:
        """Return where a file is here, which is fetched unless it was before."""
        named = f"{asset}\0{file.path}\0{file.size}\0{file.checksum}"
        here = self._folder / hashlib.sha256(named.encode()).hexdigest()
        async with self._fetching[here]:
            if not here.exists():
                self._folder.mkdir(parents=True, exist_ok=True)
                await client.retrieve_file(file.path, here)
                self._forget_oldest()
        return here

    def _forget_oldest(self) -> None:
        newest_first = sorted(
            ((each.stat().st_mtime, each.stat().st_size, each) for each in self._folder.iterdir()),
            reverse=True,
        )
        octets = 0
        for number, (_, size, path) in enumerate(newest_first):
            octets += size
            if octets > MOST_KEPT and number > 0:
                path.unlink(missing_ok=True)


def _entry(file: FileInfo) -> FileEntry:
    return FileEntry(
        path=file.path,
        size=file.size,
        modified=file.modified / NS_PER_S,
        mime=file.mimeType,
        checksum=file.checksum,
        meta=figures_of(file.metaData),
    )


def _refused(error: Exception) -> Exception:
    match error:
        case MalError(number=AreaError.NOT_FOUND.value):
            return refused(HTTPStatus.NOT_FOUND, f"there is no such file aboard: {error}")
        case MalError():
            return refused(HTTPStatus.UNPROCESSABLE_ENTITY, describe_error(error))
        case TransferError() | ConnectionError():
            text = f"it was not fetched: {error}; ask again, and it goes on where it ended"
            return refused(HTTPStatus.SERVICE_UNAVAILABLE, text)
        case _:
            return refused(HTTPStatus.INSUFFICIENT_STORAGE, f"it cannot be kept here: {error}")
