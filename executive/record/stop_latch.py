"""`StopLatch`: file that stores whether the rover is stopped, across crashes and full disks."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from zlib import crc32

from executive.commands import ROS_SOURCE

_SIZE: Final = 512
"""Size in octets: one sector, which a disk writes atomically."""
UNWRITTEN_LEDGER: Final = "aboard:ledger"
"""Stored in place of a command if the ledger could not store its own failure."""
_UNREADABLE: Final = "unknown: the stop record is damaged"


class StopLatch:
    """The command id that stopped the rover, in a file of one sector.

    Its space is allocated on creation and overwritten in place, so that it can be written on a full
    disk. This fails on file systems that write copies, as btrfs and ZFS. A damaged file counts as
    stopped.

    It is for stops that the ledger cannot store, as on a full disk: the ledger's own last stop
    holds the rover after a restart, even if this file was cleared before the resume was committed.

    Args:
        path: the file; if missing it is created with its folders, as not stopped.

    Attributes:
        stopped_by: content of the file once the last change is stored; None if not stopped.

    Raises:
        OSError: the file cannot be created or read.
    """

    def __init__(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self._change: LatchChange | None = None
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        found = os.pread(self._file, _SIZE, 0)
        if any(found):
            self.stopped_by = _read(found)
            return
        os.posix_fallocate(self._file, 0, _SIZE)
        self.stopped_by = None
        self.write(None)
        os.fsync(self._file)
        folder = os.open(path.parent, os.O_RDONLY | os.O_CLOEXEC)
        os.fsync(folder)
        os.close(folder)

    def set(self, stopped_by: str) -> None:
        """Change to stopped, with the next commit of the ledger.

        The first of several stops is retained, so that a flood of them does not wear out the disk.
        Only a stop of ROS clients, which they may resume, is replaced by that of another source.
        """
        if self.stopped_by is None or (_by_ros(self.stopped_by) and not _by_ros(stopped_by)):
            self._to(stopped_by)

    def clear(self) -> None:
        """Change to not stopped, after the next commit of the ledger."""
        self._to(None)

    def take_change(self) -> "LatchChange | None":
        """Return the change that is to be stored, once; None without one."""
        change, self._change = self._change, None
        return change

    def write(self, stopped_by: str | None) -> None:
        """Write the file; returns once that would survive loss of power; raises OSError."""
        text = b"" if stopped_by is None else stopped_by.encode(errors="replace")[: _SIZE - 16]
        body = b"%08x %s\n" % (crc32(text), text)
        os.pwrite(self._file, body.ljust(_SIZE, b" "), 0)
        os.fdatasync(self._file)

    def close(self) -> None:
        """Close the file; without effect if it is closed."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def _to(self, stopped_by: str | None) -> None:
        self.stopped_by = stopped_by
        self._change = LatchChange(self, stopped_by)


@dataclass(frozen=True, slots=True)
class LatchChange:
    """A change of the stop latch that is to be stored."""

    latch: StopLatch
    stopped_by: str | None

    def store(self) -> OSError | None:
        """Write it to the file; return the error, if any."""
        try:
            self.latch.write(self.stopped_by)
        except OSError as error:
            return error
        return None


def _by_ros(stopped_by: str) -> bool:
    return stopped_by.startswith(f"{ROS_SOURCE}:")


def _read(found: bytes) -> str | None:
    checksum, _, text = found.rstrip(b" ").removesuffix(b"\n").partition(b" ")
    if checksum != b"%08x" % crc32(text):
        return _UNREADABLE
    return text.decode(errors="replace") or None
