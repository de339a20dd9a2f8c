"""What a process takes of the machine that it runs on."""

import os
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

_LEAST_S: Final = 1.0
"""Over which the processor's time is averaged, at least."""


@dataclass(frozen=True, slots=True)
class Usage:
    """What a process takes at a moment; None for what this system does not tell.

    Attributes:
        memory_octets: resident.
        cpu_ratio: processor time of the last seconds, as a part of one core's; None at first.
        disk_free_octets: what is left for it on the disk of its data.
        uptime_s: since it began to look.
    """

    memory_octets: int | None
    cpu_ratio: float | None
    disk_free_octets: int | None
    uptime_s: float


class ProcessUsage:
    """Looks at what this process takes.

    Args:
        data: a folder on the disk that it writes to.
    """

    def __init__(self, data: Path) -> None:
        self._data = data
        self._began_s = self._looked_s = time.monotonic()
        self._cpu_s = time.process_time()
        self._cpu_ratio: float | None = None

    def look(self) -> Usage:
        """Return what it takes now; on one thread."""
        now_s = time.monotonic()
        if (passed_s := now_s - self._looked_s) >= _LEAST_S:
            cpu_s = time.process_time()
            self._cpu_ratio = (cpu_s - self._cpu_s) / passed_s
            self._looked_s, self._cpu_s = now_s, cpu_s
        free_octets = None
        with suppress(OSError):
            disk = os.statvfs(self._data)
            free_octets = disk.f_bavail * disk.f_frsize
        return Usage(_resident_octets(), self._cpu_ratio, free_octets, now_s - self._began_s)


def _resident_octets() -> int | None:
    try:
        pages = Path("/proc/self/statm").read_text(encoding="ascii").split()[1]
        return int(pages) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError, IndexError):  # no Linux
        return None
