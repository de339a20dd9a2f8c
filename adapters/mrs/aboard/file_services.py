"""`FileServices`: FileManagement and FileTransfer, except the commands `delete` and `move`."""

import asyncio
import shutil
from collections.abc import AsyncGenerator, Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import aclosing, suppress
from dataclasses import dataclass
from heapq import nlargest
from pathlib import Path
from typing import Final
from zlib import crc32

from adapters.mal import CallContext, Interaction, MalError
from adapters.mrs.aboard.file_access import (
    READ_OCTETS,
    Checksums,
    FolderWatcher,
    MetaData,
    changed_error,
    file_info,
    meta_data,
    mime_type,
    not_found_error,
    read,
)
from adapters.mrs.aboard.served_operations import ServedOperations
from adapters.mrs.spec import (
    CURRENT_RECORDING,
    AreaError,
    FileChunk,
    FileInfo,
    FileReport,
    with_text,
)
from adapters.system import OPERATING_SYSTEM, System
from executive.settings import Settings
from executive.state import FileFolder, FileStamp, check_path
from executive.values.reports import FileEventKind

READERS: Final = 2
"""Number of reader threads: one may list a full folder while the other serves a transfer."""
MAX_LISTED: Final = 1000
"""Maximum files in one answer of listFiles: those changed last."""
MAX_TRANSFERS: Final = 16
CHUNK_OCTETS: Final = 1 << 16
MAX_CHUNK_OCTETS: Final = 1 << 18
STALLED_S: Final = 60.0
"""Timeout of a transfer without an accepted chunk; chosen, not measured."""
PREEMPTIBLE_AFTER_S: Final = 2.0
"""The same if another transfer waits and `MAX_TRANSFERS` are active; chosen, not measured."""


def _peer(call: CallContext) -> str:
    return call.peer_name or call.connection.peer_host


@dataclass(slots=True, eq=False)
class _Transfer:
    """An active transfer.

    Attributes:
        peer: its client: the name of the certificate, or the client's address.
        last_progress_s: time of the last accepted chunk, by the loop's clock.
        ended: reason of its cancellation; empty if it was not cancelled.
    """

    path: str
    peer: str
    task: "asyncio.Task[object]"
    last_progress_s: float
    ended: str = ""

    def end(self, why: str) -> None:
        """Cancel it, with a reason for its client."""
        self.ended = why
        self.task.cancel()


class FileServices:
    """Serves both services; blocking calls use `READERS` threads of the running loop from now on.

    Args:
        holder: returns the holder of the authority, which may cancel transfers of all clients.
        recordings: folder of the recordings, which grow; None without recordings.
        system: clock that decides whether a file is unchanged for long enough.

    Attributes:
        watch: publishes changes of files.
    """

    def __init__(
        self,
        served: ServedOperations,
        folder: FileFolder,
        settings: Settings,
        holder: Callable[[], Awaitable[str | None]],
        recordings: Path | None = None,
        system: System = OPERATING_SYSTEM,
    ) -> None:
        asyncio.get_running_loop().set_default_executor(ThreadPoolExecutor(READERS, "files"))
        self._folder = folder
        self._asset = settings.asset
        self._holder = holder
        self._recordings = recordings
        self._copying = asyncio.Lock()
        self._checksums = Checksums(folder, system)
        self._transfers: set[_Transfer] = set()
        self._broadcast = served.broadcast(
            "FileManagement", "monitorFiles", settings.asset, settings.domain
        )
        self.watch = FolderWatcher(folder, self._publish)
        served.serve("FileManagement", "fileStored", self._on_file_stored)
        served.serve("FileManagement", "getAttributes", self._attributes)
        served.serve("FileTransfer", "listFiles", self._list)
        served.serve("FileTransfer", "retrieveFile", self._retrieve)
        served.serve("FileTransfer", "cancelTransfer", self._cancel)

    def inspect(self, path: str) -> tuple[FileStamp | None, MetaData]:
        """Return stamp and metadata, None if the file is missing; may be called from any thread."""
        return self._folder.stamp(path), meta_data(self._folder, path)

    def _publish(self, kind: FileEventKind, path: str, stamp: FileStamp, about: MetaData) -> None:
        self._broadcast(
            kind,
            file_info(path, stamp, self._checksums.known(stamp), about),
            keys=(self._asset, kind.value, mime_type(path)),
        )

    async def _stamp_of(self, path: str) -> tuple[FileStamp, MetaData]:
        """Return stamp and metadata of a file; raises NotFound."""
        stamp, about = await asyncio.to_thread(self.inspect, path)
        if stamp is None:
            raise not_found_error(path)
        return stamp, about

    async def _on_file_stored(self, _: CallContext, file: FileInfo) -> None:
        """Publish that a file was stored; raises Invalid unless path, size and checksum match."""
        stamp, about = await asyncio.to_thread(self.inspect, file.path)
        if stamp is None or stamp.size_octets != file.size:
            actual = "no file" if stamp is None else f"a file of {stamp.size_octets} octets"
            raise with_text(AreaError.INVALID, f"file: at {file.path[:80]} there is {actual}")
        if file.checksum is not None:
            try:
                fits = await self._checksums.of(file.path, stamp) == file.checksum
            except MalError:
                fits = False
            if not fits:
                text = f"file: {file.path} has another checksum, or is being written"
                raise with_text(AreaError.INVALID, text)
        self.watch.notify(FileEventKind.STORED, file.path, stamp, about)

    async def _attributes(self, _: CallContext, path: str) -> tuple[FileInfo]:
        stamp, about = await self._stamp_of(path)
        checksum: int | None = None
        try:
            checksum = await self._checksums.of(path, stamp)
        except MalError as error:
            if error.number == AreaError.NOT_FOUND.value:
                raise
        return (file_info(path, stamp, checksum, about),)

    async def _list(self, _: CallContext, folder: str | None) -> tuple[tuple[FileInfo, ...]]:
        try:
            if folder == CURRENT_RECORDING and self._recordings is not None:
                async with self._copying:
                    await asyncio.to_thread(self._copy_recording, self._recordings)
            return (await asyncio.to_thread(self._listed, folder or ""),)
        except NotADirectoryError:
            raise not_found_error(folder or "") from None

    def _listed(self, folder: str) -> tuple[FileInfo, ...]:
        last = nlargest(
            MAX_LISTED, self._folder.entries(folder), key=lambda entry: entry[1].modified_ns
        )
        return tuple(
            file_info(path, stamp, self._checksums.known(stamp)) for path, stamp in sorted(last)
        )

    def _copy_recording(self, recordings: Path) -> None:
        """Replace the copy of the current recording, unless it is being sent.

        Raises:
            MalError: Rejected, it cannot be copied.
        """
        copies = self._folder.root / CURRENT_RECORDING
        part = copies / ".part"
        if self._is_sending_copy:
            return
        try:
            copies.mkdir(parents=True, exist_ok=True)
            if copies.is_symlink():  # the files of another folder are not to be deleted
                raise NotADirectoryError(f"{CURRENT_RECORDING} is a link")
            files = recordings.glob("*.mcap")
            newest = max(files, key=lambda each: each.stat().st_mtime_ns, default=None)
            if newest is None:
                raise with_text(AreaError.REJECTED, "there is no recording yet")
            shutil.copyfile(newest, part)
            if not self._is_sending_copy:
                for former in copies.glob("*.mcap"):
                    former.unlink()
                part.replace(copies / newest.name)
        except OSError as error:
            raise with_text(AreaError.REJECTED, f"no copy of the recording: {error}") from error
        finally:
            with suppress(OSError):  # also after a full disk
                part.unlink()

    @property
    def _is_sending_copy(self) -> bool:
        sent = list(self._transfers)
        return any(each.path.startswith(f"{CURRENT_RECORDING}/") for each in sent)

    async def _cancel(self, call: CallContext, path: str) -> None:
        """Cancel the client's transfers of a file; for the holder of the authority those of all.

        The certificate identifies the holder. Its name is queried before transfers are selected.
        """
        named = call.peer_name is not None
        holds = named and call.peer_name == await self._holder()
        found = [transfer for transfer in self._transfers if transfer.path == path]
        if not found:
            raise not_found_error(path)
        own = [transfer for transfer in found if holds or transfer.peer == _peer(call)]
        if not own:
            name = ", ".join(sorted({transfer.peer for transfer in found}))
            text = f"the transfer of {path} belongs to {name}: it or the authority holder ends it"
            raise with_text(AreaError.REJECTED, text)
        for transfer in own:
            transfer.end(f"the transfer of {path} was cancelled")

    async def _retrieve(
        self, interaction: Interaction, path: str, offset: int | None, chunk: int | None
    ) -> tuple[FileReport]:
        fault = check_path(path)
        if fault is not None:
            raise with_text(AreaError.INVALID, f"path: {fault.text}")
        if chunk == 0:
            raise with_text(AreaError.INVALID, "chunkSize: at least 1 octet, or NULL")
        chunk = min(chunk or CHUNK_OCTETS, MAX_CHUNK_OCTETS)
        if len(self._transfers) >= MAX_TRANSFERS:
            self._evict_stalled()
        task = asyncio.current_task()
        assert task is not None
        transfer = _Transfer(path, _peer(interaction.call), task, asyncio.get_running_loop().time())
        self._transfers.add(transfer)
        try:
            return (await self._send(interaction, transfer, offset or 0, chunk),)
        except asyncio.CancelledError:
            if not transfer.ended:
                raise
            raise with_text(AreaError.REJECTED, transfer.ended) from None
        finally:
            self._transfers.discard(transfer)

    def _evict_stalled(self) -> None:
        """Cancel the transfer that has waited longest for an accepted chunk.

        Raises:
            MalError: Busy, all transfers progress.
        """
        stalled = min(self._transfers, key=lambda transfer: transfer.last_progress_s)
        for_s = asyncio.get_running_loop().time() - stalled.last_progress_s
        if for_s < PREEMPTIBLE_AFTER_S:
            raise with_text(AreaError.BUSY, f"{MAX_TRANSFERS} transfers are active: try again")
        self._transfers.discard(stalled)
        stalled.end(f"no chunk was accepted for {for_s:.0f} s, and another transfer waits")

    async def _send(
        self, interaction: Interaction, transfer: _Transfer, offset: int, chunk: int
    ) -> FileReport:
        """Send a file from an offset on, and return the checksum of the octets read for it."""
        path = transfer.path
        stamp, about = await self._stamp_of(path)
        if offset > stamp.size_octets:
            text = f"offset: {path} has {stamp.size_octets} octets"
            raise with_text(AreaError.INVALID, text)
        checksum = await self._checksums.of(path, stamp)
        interaction.acknowledge(file_info(path, stamp, checksum, about))
        value = await self._checksums.of_first_octets(path, stamp, offset)
        pieces = self._pieces(path, stamp, offset, READ_OCTETS // chunk * chunk, value)
        async with aclosing(pieces):
            async for begin, data, value in pieces:  # noqa: B007 - the last one counts
                for at in range(0, len(data), chunk):
                    part = FileChunk(offset=begin + at, data=data[at : at + chunk])
                    await self._update(interaction, part)
                    transfer.last_progress_s = asyncio.get_running_loop().time()
        if value != checksum:
            raise changed_error(path)
        await interaction.call.connection.drain()
        self.watch.notify(FileEventKind.TRANSFERRED, path, stamp, about)
        return FileReport(path=path, octets=stamp.size_octets - offset, checksum=value)

    async def _pieces(
        self, path: str, stamp: FileStamp, offset: int, step: int, value: int
    ) -> AsyncGenerator[tuple[int, bytes, int], None]:
        """Read a file from an offset on; reads the next piece while the last one is sent.

        Yields:
            Offset of a piece, its octets, and the checksum of the file up to its end.
        """

        def ahead(begin: int, value: int) -> "asyncio.Future[tuple[bytes, int]]":
            octets = min(step, stamp.size_octets - begin)
            loop = asyncio.get_running_loop()
            return loop.run_in_executor(None, self._read, path, stamp, begin, octets, value)

        if offset == stamp.size_octets:
            return
        following = ahead(offset, value)
        try:
            while offset < stamp.size_octets:
                begin = offset
                data, value = await following
                offset += len(data)
                if offset < stamp.size_octets:
                    following = ahead(offset, value)
                yield begin, data, value
        finally:
            if not following.cancel() and not following.cancelled():
                following.exception()  # marks it as retrieved: the read-ahead is no longer needed

    def _read(
        self, path: str, stamp: FileStamp, offset: int, octets: int, before: int
    ) -> tuple[bytes, int]:
        data = read(self._folder, path, stamp, offset, octets)
        return data, crc32(data, before)

    async def _update(self, interaction: Interaction, part: FileChunk) -> None:
        try:
            await interaction.update(part, patience_s=STALLED_S)
        except TimeoutError:
            text = f"no chunk was accepted for {STALLED_S:g} s"
            raise with_text(AreaError.REJECTED, text) from None
