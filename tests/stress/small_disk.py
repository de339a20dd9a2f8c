"""A small disk that can be filled: a file system in memory, where this user may mount one."""

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

DISK_OCTETS: Final = 144 << 20
"""More than the 64 MiB that bundle stores leave free."""
_ATTEMPTS: Final = 100


class NoDiskError(Exception):
    """No disk can be made here; the text says why."""


class Disk:
    """A folder, perhaps with a disk of its own, and what can fill it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def fill(self) -> None:
        """Leave not an octet, from one moment to the next.

        Raises:
            NoDiskError: somebody writes faster than the disk can be made smaller.
        """
        for _ in range(_ATTEMPTS):
            now = os.statvfs(self.folder)
            if _mounted("remount", (now.f_blocks - now.f_bfree) * now.f_frsize, self.folder) == "":
                return
        raise NoDiskError(f"{self.folder} does not become full")

    def empty(self) -> None:
        _mounted("remount", DISK_OCTETS, self.folder)


@contextmanager
def small_disk(folder: Path) -> Iterator[Disk]:
    """Yield a disk that is mounted on a folder.

    Raises:
        NoDiskError: this user may not mount, or this system cannot.
    """
    folder.mkdir(parents=True)
    if why := _mounted("rw", DISK_OCTETS, folder):
        raise NoDiskError(why)
    try:
        yield Disk(folder)
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


def _mounted(option: str, octets: int, folder: Path) -> str:
    """Mount; return why that could not be, or nothing."""
    command = ["mount", "-t", "tmpfs", "-o", f"{option},size={octets}", "tmpfs", str(folder)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError as error:
        return str(error)
    return done.stderr.strip() if done.returncode else ""
