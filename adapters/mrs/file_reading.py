"""Octets of files aboard, read off the loop: a stop is not to wait for a disk.

Each function here runs in a thread, opens the file anew, reads no more than a slice, and makes sure
that it is still the same file. So nothing stays open between two slices, whatever ends a transfer.
"""

import asyncio
import os
import time
from collections import OrderedDict
from typing import Final

from adapters.mal import MalError
from adapters.mrs.errors import AreaError, with_text
from executive.state import LONGEST_PATH, FileFolder, FileStamp

READ_OCTETS: Final = 1 << 20
"""What is read at a time."""
SLICE_OCTETS: Final = 1 << 22
"""What is read for a checksum before somebody else has a turn."""
KNOWN_CHECKSUMS: Final = 512
AT_REST_NS: Final = 1_000_000_000
"""A file may change twice within the resolution of its time: one younger is not remembered."""
AT_ONCE: Final = 4
"""Checksums that are computed at the same time."""


def changed(path: str) -> MalError:
    """Return the error for a file that was changed while it was read."""
    return with_text(AreaError.REJECTED, f"{path} was changed while it was read")


def not_found(path: str) -> MalError:
    """Return the error for a file that is not there, or not any more."""
    return with_text(AreaError.NOT_FOUND, path[:LONGEST_PATH])


def stamp_of(folder: FileFolder, path: str) -> FileStamp:
    """Return the stamp of a file.

    Raises:
        MalError: NotFound.
    """
    stamp = folder.stamp(path)
    if stamp is None:
        raise not_found(path)
    return stamp


def read(folder: FileFolder, path: str, stamp: FileStamp, offset: int, octets: int) -> bytes:
    """Return octets of a file.

    Args:
        folder: where it lies.
        path: the file.
        stamp: of the file that `FileFolder` found there, which it must still be.
        offset: where to begin.
        octets: how many, all of them within the file.

    Raises:
        MalError: NotFound, it is gone; Rejected, it was changed or cannot be read.
    """
    try:
        file = os.open(folder.root / path, os.O_RDONLY | os.O_NONBLOCK)
        try:
            if FileStamp.of(os.fstat(file)) != stamp:
                raise changed(path)
            data = os.pread(file, octets, offset)
        finally:
            os.close(file)
    except FileNotFoundError:
        raise not_found(path) from None
    except OSError as error:
        raise with_text(AreaError.REJECTED, f"{path} cannot be read: {error.strerror}") from error
    if len(data) < octets:
        raise changed(path)
    return data


def crc(data: bytes, before: int) -> int:
    """Return the CRC-32 (IEEE 802.3) of octets that follow others."""
    from zlib import crc32  # for who asks

    return crc32(data, before)


class Checksums:
    """CRC-32s of files, the last ones remembered.

    Whoever asks for the same file at the same time waits for the same computation, which goes on
    when they do not wait any more: after a timeout, the next one to ask has the sooner an answer.
    """

    def __init__(self, folder: FileFolder) -> None:
        """Know none."""
        self._folder = folder
        self._known: OrderedDict[FileStamp, int] = OrderedDict()
        self._running: dict[tuple[str, FileStamp], asyncio.Task[int]] = {}
        self._room = asyncio.Semaphore(AT_ONCE)

    def known(self, stamp: FileStamp) -> int | None:
        """Return the checksum of a file if it is remembered; may be called from any thread."""
        return self._known.get(stamp)

    async def of(self, path: str, stamp: FileStamp) -> int:
        """Return the checksum of a file; raises as `read` does."""
        known = self._known.get(stamp)
        if known is not None:
            return known
        key = (path, stamp)
        if key not in self._running:
            task = self._running[key] = asyncio.create_task(self._compute(path, stamp))
            task.add_done_callback(lambda ended: self._forget(key, ended))
        return await asyncio.shield(self._running[key])

    async def begin_of(self, path: str, stamp: FileStamp, octets: int) -> int:
        """Return the checksum of the first octets of a file; raises as `read` does."""
        value = offset = 0
        while offset < octets:
            end = min(offset + SLICE_OCTETS, octets)
            value = await asyncio.to_thread(self._slice, path, stamp, offset, end, value)
            offset = end
        return value

    async def _compute(self, path: str, stamp: FileStamp) -> int:
        async with self._room:
            value = await self.begin_of(path, stamp, stamp.size_octets)
        if await asyncio.to_thread(self._folder.stamp, path) != stamp:
            raise changed(path)
        if time.time_ns() - stamp.modified_ns > AT_REST_NS:
            self._known[stamp] = value
            if len(self._known) > KNOWN_CHECKSUMS:
                self._known.popitem(last=False)
        return value

    def _slice(self, path: str, stamp: FileStamp, offset: int, end: int, value: int) -> int:
        for begin in range(offset, end, READ_OCTETS):
            octets = min(READ_OCTETS, end - begin)
            value = crc(read(self._folder, path, stamp, begin, octets), value)
        return value

    def _forget(self, key: tuple[str, FileStamp], ended: "asyncio.Task[int]") -> None:
        del self._running[key]
        if not ended.cancelled():
            ended.exception()  # whoever waits still gets it; perhaps nobody does any more
