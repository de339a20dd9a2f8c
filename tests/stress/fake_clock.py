"""`python -m tests.stress.fake_clock FILE MODULE ...`: runs a module under a clock that can be set.

The file holds by how many seconds its wall clock is wrong; whoever writes there sets the clock of
the process while it runs, as an operator or NTP would. Monotonic time goes on.
"""

import mmap
import runpy
import struct
import sys
import time
from pathlib import Path
from typing import Final

_OCTETS: Final = 8


def set_clock(path: Path, wrong_by_s: float) -> None:
    """Have the clocks of this file's processes be wrong by so much from now on."""
    with path.open("r+b" if path.exists() else "w+b") as file:
        file.write(struct.pack("d", wrong_by_s))


def main() -> None:
    _, path, module, *arguments = sys.argv
    with Path(path).open("rb") as file:
        error_s = memoryview(mmap.mmap(file.fileno(), _OCTETS, prot=mmap.PROT_READ)).cast("d")
    true_utc_s = time.time
    # Before anything of ours is imported, so that everybody gets this clock.
    time.time = lambda: true_utc_s() + error_s[0]
    sys.argv = [module, *arguments]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
