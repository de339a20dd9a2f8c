"""The File Transfer service: which files there are aboard, and their contents in chunks."""

import asyncio
from collections.abc import AsyncGenerator
from contextlib import aclosing
from dataclasses import dataclass
from heapq import nlargest
from typing import Final

from adapters.mal import Call, Interaction
from adapters.mrs.errors import AreaError, invalid, with_text
from adapters.mrs.file_infos import file_info, meta_data
from adapters.mrs.file_reading import (
    READ_OCTETS,
    Checksums,
    changed,
    crc,
    not_found,
    read,
    stamp_of,
)
from adapters.mrs.file_watch import FileWatch
from adapters.mrs.offer import Offer
from adapters.mrs.types import FileChunk, FileInfo, FileReport
from executive.state import FileEventKind, FileFolder, FileStamp, check_path

SERVICE: Final = "FileTransfer"
MOST_LISTED: Final = 1000
"""Files that one listFiles returns: those changed last."""
MOST_TRANSFERS: Final = 16
CHUNK_OCTETS: Final = 1 << 16
LARGEST_CHUNK_OCTETS: Final = 1 << 18
STALLED_S: Final = 60.0
"""How long a consumer may take nothing before its transfer ends: its link is gone, most likely."""


@dataclass(slots=True, eq=False)
class _Transfer:
    """A transfer under way."""

    path: str
    task: "asyncio.Task[object]"
    cancelled: bool = False


class FileTransferService:
    """Serves listFiles, retrieveFile and cancelTransfer.

    Args:
        offer: where to put them up.
        folder: where the files lie.
        checksums: of the files.
        watch: is told when a file was transferred.
        stalled_s: see `STALLED_S`.
    """

    def __init__(
        self,
        offer: Offer,
        folder: FileFolder,
        checksums: Checksums,
        watch: FileWatch,
        stalled_s: float = STALLED_S,
    ) -> None:
        """Put the operations up."""
        self._folder = folder
        self._checksums = checksums
        self._watch = watch
        self._stalled_s = stalled_s
        self._transfers: set[_Transfer] = set()
        offer.serve(SERVICE, "listFiles", self._list)
        offer.serve(SERVICE, "retrieveFile", self._retrieve)
        offer.serve(SERVICE, "cancelTransfer", self._cancel)

    async def _list(self, call: Call, folder: str | None) -> tuple[tuple[FileInfo, ...]]:
        try:
            return (await asyncio.to_thread(self._listed, folder or ""),)
        except NotADirectoryError:
            raise not_found(folder or "") from None

    def _listed(self, folder: str) -> tuple[FileInfo, ...]:
        last = nlargest(
            MOST_LISTED, self._folder.entries(folder), key=lambda entry: entry[1].modified_ns
        )
        return tuple(
            file_info(path, stamp, self._checksums.known(stamp)) for path, stamp in sorted(last)
        )

    def _cancel(self, call: Call, path: str) -> None:
        """End every transfer of a file."""
        found = [transfer for transfer in self._transfers if transfer.path == path]
        if not found:
            raise not_found(path)
        for transfer in found:
            transfer.cancelled = True
            transfer.task.cancel()

    async def _retrieve(
        self, interaction: Interaction, path: str, offset: int | None, chunk: int | None
    ) -> tuple[FileReport]:
        if check_path(path) is not None:
            raise invalid(0)
        chunk = CHUNK_OCTETS if chunk is None else chunk
        if not 0 < chunk <= LARGEST_CHUNK_OCTETS:
            raise invalid(2)
        if len(self._transfers) == MOST_TRANSFERS:
            raise with_text(AreaError.BUSY, f"{MOST_TRANSFERS} transfers are under way already")
        task = asyncio.current_task()
        assert task is not None
        transfer = _Transfer(path, task)
        self._transfers.add(transfer)
        try:
            return (await self._send(interaction, path, offset or 0, chunk),)
        except asyncio.CancelledError:
            if not transfer.cancelled:
                raise
            text = f"the transfer of {path} was cancelled"
            raise with_text(AreaError.REJECTED, text) from None
        finally:
            self._transfers.discard(transfer)

    async def _send(
        self, interaction: Interaction, path: str, offset: int, chunk: int
    ) -> FileReport:
        """Send a file from an offset on, and return the checksum of what was read for it."""
        stamp = await asyncio.to_thread(stamp_of, self._folder, path)
        if offset > stamp.size_octets:
            raise invalid(1)
        about = await asyncio.to_thread(meta_data, self._folder, path)
        checksum = await self._checksums.of(path, stamp)
        interaction.acknowledge(file_info(path, stamp, checksum, about))
        value = await self._checksums.begin_of(path, stamp, offset)
        pieces = self._pieces(path, stamp, offset, READ_OCTETS // chunk * chunk, value)
        async with aclosing(pieces):
            async for begin, data, value in pieces:  # noqa: B007 - the last one counts
                for at in range(0, len(data), chunk):
                    part = FileChunk(offset=begin + at, data=data[at : at + chunk])
                    await self._update(interaction, part)
        if value != checksum:
            raise changed(path)
        await interaction.call.connection.drained()
        self._watch.hear(FileEventKind.TRANSFERRED, path, stamp, about)
        return FileReport(path=path, octets=stamp.size_octets - offset, checksum=value)

    async def _pieces(
        self, path: str, stamp: FileStamp, offset: int, step: int, value: int
    ) -> AsyncGenerator[tuple[int, bytes, int], None]:
        """Read a file from an offset on, the next piece while the last one is sent.

        Yields:
            Where a piece begins, its octets, and the checksum of the file up to its end.
        """

        def ahead(begin: int, value: int) -> "asyncio.Future[tuple[bytes, int]]":
            octets = min(step, stamp.size_octets - begin)
            loop = asyncio.get_running_loop()
            return loop.run_in_executor(None, self._read, path, stamp, begin, octets, value)

        if offset == stamp.size_octets:
            return
        coming = ahead(offset, value)
        try:
            while offset < stamp.size_octets:
                begin = offset
                data, value = await coming
                offset += len(data)
                if offset < stamp.size_octets:
                    coming = ahead(offset, value)
                yield begin, data, value
        finally:
            if not coming.cancel() and not coming.cancelled():
                coming.exception()  # nobody waits for what was read ahead any more

    def _read(
        self, path: str, stamp: FileStamp, offset: int, octets: int, before: int
    ) -> tuple[bytes, int]:
        data = read(self._folder, path, stamp, offset, octets)
        return data, crc(data, before)

    async def _update(self, interaction: Interaction, part: FileChunk) -> None:
        try:
            await interaction.update(part, patience_s=self._stalled_s)
        except TimeoutError:
            text = f"nothing was taken for {self._stalled_s:g} s"
            raise with_text(AreaError.REJECTED, text) from None
