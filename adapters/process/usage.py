"""`ResourceMonitor`: processor, memory, disk that this process uses; `take_priority` raises it."""

import logging
import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from adapters.system import OPERATING_SYSTEM, System

_MIN_WINDOW_S: Final = 1.0
"""Minimum window of the average processor load."""


@dataclass(frozen=True, slots=True)
class ResourceUsage:
    """Resource usage of a process; None for figures that this system does not provide.

    Attributes:
        memory_octets: resident memory.
        cpu_ratio: processor time of the last seconds, as a fraction of one core's; None at first.
        disk_free_octets: free space for it on the disk of its data.
        uptime_s: time since the monitor was created, s.
    """

    memory_octets: int | None
    cpu_ratio: float | None
    disk_free_octets: int | None
    uptime_s: float


class ResourceMonitor:
    """Measures the resource usage of this process, including the disk with the folder `data`."""

    def __init__(self, data: Path, system: System = OPERATING_SYSTEM) -> None:
        self._data, self._system = data, system
        self._began_s = self._measured_s = system.now_s()
        self._cpu_s = system.cpu_s()
        self._cpu_ratio: float | None = None

    def measure(self) -> ResourceUsage:
        """Return the present usage; call it on one thread."""
        now_s = self._system.now_s()
        if (passed_s := now_s - self._measured_s) >= _MIN_WINDOW_S:
            cpu_s = self._system.cpu_s()
            self._cpu_ratio = (cpu_s - self._cpu_s) / passed_s
            self._measured_s, self._cpu_s = now_s, cpu_s
        free_octets = None
        with suppress(OSError):
            free_octets = self._system.free_octets(self._data)
        memory_octets = self._system.memory_octets()
        return ResourceUsage(memory_octets, self._cpu_ratio, free_octets, now_s - self._began_s)


NICE: Final = -10
"""About ten times the processor time of a process of normal priority, and its turn before it."""
_LOG = logging.getLogger(__name__)


def take_priority() -> None:
    """Raise the priority of this process, and of the threads and processes that it starts.

    A priority that was set outside, as by `nice` or a unit file, is left as it is.
    """
    if os.getpriority(os.PRIO_PROCESS, 0) != 0:
        return
    try:
        os.setpriority(os.PRIO_PROCESS, 0, NICE)
    except PermissionError:
        _LOG.info("priority not raised to nice %d: not permitted (RLIMIT_NICE)", NICE)
