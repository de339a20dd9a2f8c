"""How long ago this process was started, the launcher's shell included: `exec` keeps the start."""

import os
import time
from pathlib import Path
from typing import Final

_STARTTIME: Final = 19
"""Field 22 of proc(5)'s stat, counted behind the name of the program."""


def since_start_s() -> float:
    """Return seconds since the kernel made this process, to 10 ms."""
    fields = Path("/proc/self/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    started_s = int(fields[_STARTTIME]) / os.sysconf("SC_CLK_TCK")
    return time.clock_gettime(time.CLOCK_BOOTTIME) - started_s


def told(seconds: float) -> str:
    """Return a time since the start in words, as the launcher may have installed first."""
    installed = " (installation included)" if os.environ.get("ROVER_INSTALLED") else ""
    return f"{seconds:.1f} s{installed}"
