"""SIGINT and SIGTERM as a request that a process polls when it is ready."""

import asyncio
import signal
from types import FrameType
from typing import Final

_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)


class Termination:
    """Whether the termination of this process is requested.

    After the first signal all further ones are ignored to the end of the process: a second one
    must not interrupt the stop of the rover. Only for the main thread, which must poll it.
    """

    def __init__(self) -> None:
        self.requested = False
        for number in _SIGNALS:
            signal.signal(number, self._on_signal)

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        self.requested = True
        for number in _SIGNALS:
            signal.signal(number, signal.SIG_IGN)


def termination_event() -> asyncio.Event:
    """Return an event that SIGINT and SIGTERM set from now on, on the running loop."""
    requested, loop = asyncio.Event(), asyncio.get_running_loop()
    for number in _SIGNALS:
        loop.add_signal_handler(number, requested.set)
    return requested
