"""What a process takes of the machine that it runs on."""

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from adapters.system import OPERATING_SYSTEM, System

_LEAST_S: Final = 1.0
"""Over which the processor's time is averaged, at least."""


@dataclass(frozen=True, slots=True)
class ResourceUsage:
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


class ResourceMonitor:
    """Looks at what this process takes, of the disk with the folder `data`, too."""

    def __init__(self, data: Path, system: System = OPERATING_SYSTEM) -> None:
        self._data, self._system = data, system
        self._began_s = self._looked_s = system.now_s()
        self._cpu_s = system.cpu_s()
        self._cpu_ratio: float | None = None

    def look(self) -> ResourceUsage:
        """Return what it takes now; on one thread."""
        now_s = self._system.now_s()
        if (passed_s := now_s - self._looked_s) >= _LEAST_S:
            cpu_s = self._system.cpu_s()
            self._cpu_ratio = (cpu_s - self._cpu_s) / passed_s
            self._looked_s, self._cpu_s = now_s, cpu_s
        free_octets = None
        with suppress(OSError):
            free_octets = self._system.free_octets(self._data)
        memory_octets = self._system.memory_octets()
        return ResourceUsage(memory_octets, self._cpu_ratio, free_octets, now_s - self._began_s)
