"""HTTP requests for the list of onboard files, for fetched files, and for transfers.

Files of a rover are not trusted: a browser displays pictures, saves other files, and runs none.
"""

import asyncio
import mimetypes
from dataclasses import dataclass
from http import HTTPStatus
from pathlib import Path, PurePosixPath
from typing import Final
from urllib.parse import quote

from aiohttp import web

from adapters.console.messages import Scalar, TransferState
from adapters.console.recordings import Recordings, is_connected
from adapters.console.requests.file_store import FileStore
from adapters.console.requests.transfers import Connect, TransferAction, Transfers, store_path
from adapters.console.rovers import NS_PER_S, figures_of
from adapters.console.web import OPERATOR, body_of, json_response, one_of, refused, text_of
from adapters.mal import MalError
from adapters.mrs.spec import CURRENT_RECORDING, AreaError, FileInfo, describe_error
from adapters.recording import RecordingError
from executive.state import FileStamp

_NO_SUCH_TRANSFER: Final = "no such transfer"
_INLINE_TYPES: Final = {"image/jpeg", "image/png", "image/gif", "image/webp"}


@dataclass(frozen=True, slots=True)
class FileEntry:
    """A file of a component.

    Attributes:
        checksum: CRC-32 of the content; None if the list does not have it.
        meta: metadata, such as the pose of a picture.
    """

    path: str
    size: int
    modified: float
    mime: str | None
    checksum: int | None
    meta: dict[str, Scalar]


class FileRequests:
    """Serves these requests.

    Args:
        client: returns the session with an asset.
        store: stored files.
        transfers: fetches files into the store.
        recordings: opens stored recordings.
        own: name of the asset that lists the stored files.
    """

    def __init__(
        self,
        client: Connect,
        store: FileStore,
        transfers: Transfers,
        recordings: Recordings,
        own: str,
    ) -> None:
        self._client, self._store, self._transfers = client, store, transfers
        self._recordings, self._own = recordings, own

    def routes(self) -> list[web.RouteDef]:
        """Return the routes."""
        return [
            web.get(f"/api/files/{self._own}", self._list_stored),
            web.get(f"/api/files/{self._own}/{{path:.+}}", self._get_stored),
            web.get("/api/files/{asset}", self._list),
            web.get("/api/files/{asset}/{path:.+}", self._file),
            web.get("/api/transfers", self._list_transfers),
            web.post("/api/transfers", self._transfer),
            web.post("/api/transfers/{id}", self._turn),
            web.delete("/api/transfers/{id}", self._remove),
            web.post("/api/transfers/{id}/recording", self._open_fetched),
            web.post("/api/files/{asset}/recording", self._open_current),
        ]

    async def _list(self, request: web.Request) -> web.Response:
        client = self._client(request.match_info["asset"])
        try:
            found = await client.list_files(request.query.get("folder"))
        except (MalError, ConnectionError) as error:
            raise _file_error(error) from error
        return json_response({"files": list(map(_entry, found))})

    async def _list_stored(self, _: web.Request) -> web.Response:
        found = await asyncio.to_thread(lambda: sorted(self._store.entries()))
        return json_response({"files": [_stored_entry(*each) for each in found]})

    async def _file(self, request: web.Request) -> web.StreamResponse:
        """Respond with a file aboard, which is fetched unless the store has the same content."""
        asset, path = request.match_info["asset"], request.match_info["path"]
        client, target = self._client(asset), store_path(asset, path)
        try:
            file = await client.get_attributes(path)
            if "about" in request.query:
                return json_response(_entry(file))
            here = await asyncio.to_thread(self._store.find_same, target, file)
            if here is None:
                await self._fetch(asset, path)
                here = self._store.find(target)
        except (MalError, ConnectionError, OSError, ValueError) as error:
            raise _file_error(error) from error
        return _file_response(here, file.mimeType)

    async def _get_stored(self, request: web.Request) -> web.StreamResponse:
        path = request.match_info["path"]
        return _file_response(self._store.find(path), mimetypes.guess_type(path)[0])

    async def _fetch(self, asset: str, path: str) -> None:
        begun = self._transfers.fetch(asset, path, "")
        stopped = await self._transfers.until_stopped(begun.id)
        match stopped.state:
            case TransferState.DONE:
                return
            case TransferState.INTERRUPTED:
                text = f"not fetched yet: {stopped.detail}; its transfer resumes by itself"
            case TransferState.PAUSED:
                text = "not fetched yet: its transfer is paused; resume the transfer"
            case _:
                why = stopped.detail or "its transfer was ended"
                text = f"not fetched: {why}; request it again"
        raise refused(HTTPStatus.SERVICE_UNAVAILABLE, text)

    async def _list_transfers(self, _: web.Request) -> web.Response:
        return json_response({"transfers": self._transfers.listed})

    async def _transfer(self, request: web.Request) -> web.Response:
        body = await body_of(request)
        asset, path = text_of(body, "asset"), text_of(body, "path")
        self._client(asset)  # refuses at once if no session is available
        try:
            begun = self._transfers.fetch(asset, path, request[OPERATOR])
        except (OSError, ValueError) as error:
            raise _file_error(error) from error
        return json_response(begun, HTTPStatus.ACCEPTED)

    async def _turn(self, request: web.Request) -> web.Response:
        action = one_of(TransferAction, "action", (await body_of(request)).get("action"))
        try:
            turned = await self._transfers.apply(request.match_info["id"], action)
        except KeyError:
            raise refused(HTTPStatus.NOT_FOUND, _NO_SUCH_TRANSFER) from None
        return json_response(turned)

    async def _open_current(self, request: web.Request) -> web.Response:
        """Fetch the recording of an asset that it writes now, and open it."""
        asset = request.match_info["asset"]
        try:
            files = await self._client(asset).list_files(CURRENT_RECORDING)
            copy = max(files, key=lambda each: each.modified)  # others were moved there
            await self._fetch(asset, copy.path)
        except (MalError, ConnectionError, OSError, ValueError) as error:
            if isinstance(error, MalError) and error.number == AreaError.NOT_FOUND.value:
                text = f"{asset} offers no recording: see recording.enabled of its settings"
                raise refused(HTTPStatus.NOT_FOUND, text) from error
            raise _file_error(error) from error
        return await self._open(request, store_path(asset, copy.path))

    async def _open_fetched(self, request: web.Request) -> web.Response:
        """Open a fetched recording as an asset."""
        name = request.match_info["id"]
        found = next((each for each in self._transfers.listed if each.id == name), None)
        path = "" if found is None else store_path(found.asset, found.path)
        return await self._open(request, path)

    async def _open(self, request: web.Request, path: str) -> web.Response:
        stored = self._store.find(path)
        if stored is None:
            raise refused(HTTPStatus.NOT_FOUND, "no such file in the store: fetch it first")
        try:
            opened = await self._recordings.open(stored, is_connected(request))
        except RecordingError as error:
            text = str(error).replace(str(stored), stored.name)
            raise refused(HTTPStatus.UNPROCESSABLE_ENTITY, text) from error
        return json_response(opened.entry, HTTPStatus.CREATED)

    async def _remove(self, request: web.Request) -> web.Response:
        try:
            await self._transfers.remove(request.match_info["id"])
        except KeyError:
            raise refused(HTTPStatus.NOT_FOUND, _NO_SUCH_TRANSFER) from None
        return web.Response(status=HTTPStatus.NO_CONTENT)


def _file_response(here: Path | None, mime: str | None) -> web.FileResponse:
    if here is None:
        raise refused(HTTPStatus.NOT_FOUND, "no such file in the store")
    name = quote(PurePosixPath(here).name)
    how = "inline" if mime in _INLINE_TYPES else "attachment"
    return web.FileResponse(
        here,
        headers={
            "Content-Type": mime if mime in _INLINE_TYPES else "application/octet-stream",
            "Content-Disposition": f"{how}; filename*=UTF-8''{name}",
            "Content-Security-Policy": "default-src 'none'; sandbox",
        },
    )


def _entry(file: FileInfo) -> FileEntry:
    return FileEntry(
        path=file.path,
        size=file.size,
        modified=file.modified / NS_PER_S,
        mime=file.mimeType,
        checksum=file.checksum,
        meta=figures_of(file.metaData),
    )


def _stored_entry(path: str, stamp: FileStamp) -> FileEntry:
    modified_s, mime = stamp.modified_ns / NS_PER_S, mimetypes.guess_type(path)[0]
    return FileEntry(path, stamp.size_octets, modified_s, mime, None, {})


def _file_error(error: Exception) -> Exception:
    match error:
        case MalError(number=AreaError.NOT_FOUND.value):
            return refused(HTTPStatus.NOT_FOUND, f"no such file aboard: {error}")
        case MalError():
            return refused(HTTPStatus.UNPROCESSABLE_ENTITY, describe_error(error))
        case ConnectionError():
            text = f"the link was lost: {error}; request it again when the link is up"
            return refused(HTTPStatus.SERVICE_UNAVAILABLE, text)
        case ValueError():
            return refused(HTTPStatus.UNPROCESSABLE_ENTITY, f"path: {error}", field="path")
        case _:
            return refused(HTTPStatus.INSUFFICIENT_STORAGE, f"the file cannot be stored: {error}")
