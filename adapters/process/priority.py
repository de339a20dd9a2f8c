"""`take_priority`: a higher scheduling priority of a process, where the system permits it."""

import logging
import os
from typing import Final

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
