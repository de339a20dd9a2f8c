"""The stop latch on disk: whether the rover is stopped, whatever becomes of process and disk."""

import os
from pathlib import Path
from typing import Final
from zlib import crc32

_SIZE: Final = 512
"""Octets: one sector, which a disk writes whole or not at all."""
UNWRITTEN_LEDGER: Final = "aboard:ledger"
"""Stands in place of a command where the ledger could not store its own failure."""
_UNREADABLE: Final = "someone: the record of who is damaged"


class StopLatch:
    """Who stopped the rover, in a file of one sector.

    Its room is taken when it is made, and it is overwritten in place, so that it can be written on
    a full disk (except where a file system writes copies, as btrfs and ZFS do). A file that is
    damaged counts as stopped.

    Args:
        path: the file; made with its folders if missing, not stopped then.

    Attributes:
        stopped_by: what the file says; None if the rover is not stopped.

    Raises:
        OSError: the file cannot be made, read or written, from every method.
    """

    def __init__(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        found = os.pread(self._file, _SIZE, 0)
        if any(found):
            self.stopped_by = _read(found)
            return
        os.posix_fallocate(self._file, 0, _SIZE)
        self._write(None)
        os.fsync(self._file)
        folder = os.open(path.parent, os.O_RDONLY | os.O_CLOEXEC)
        os.fsync(folder)
        os.close(folder)

    def set(self, stopped_by: str) -> None:
        """Write down that the rover is stopped; returns when that would survive loss of power.

        The first of several stops is kept: a flood of them does not wear out the disk.
        """
        if self.stopped_by is None:
            self._write(stopped_by)

    def clear(self) -> None:
        """Write down that it is stopped no more, once that is so in the ledger."""
        self._write(None)

    def close(self) -> None:
        """Close the file; nothing, if that was done."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def _write(self, stopped_by: str | None) -> None:
        text = b"" if stopped_by is None else stopped_by.encode(errors="replace")[: _SIZE - 16]
        body = b"%08x %s\n" % (crc32(text), text)
        os.pwrite(self._file, body.ljust(_SIZE, b" "), 0)
        os.fdatasync(self._file)
        self.stopped_by = stopped_by


def _read(found: bytes) -> str | None:
    checksum, _, text = found.rstrip(b" ").removesuffix(b"\n").partition(b" ")
    if checksum != b"%08x" % crc32(text):
        return _UNREADABLE
    return text.decode(errors="replace") or None
