"""SIGINT and SIGTERM as a wish that a process looks at when it is ready to."""

import asyncio
import signal
from types import FrameType
from typing import Final

_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)


class Termination:
    """Whether this process was asked to end.

    The first signal counts; from then on to the end of the process they are ignored, so that an
    impatient second one does not cut short the way to standing. Only for the main thread, which is
    to look again and again.
    """

    def __init__(self) -> None:
        self.requested = False
        for number in _SIGNALS:
            signal.signal(number, self._ask)

    def _ask(self, _number: int, _frame: FrameType | None) -> None:
        self.requested = True
        for number in _SIGNALS:
            signal.signal(number, signal.SIG_IGN)


def termination_event() -> asyncio.Event:
    """Return what SIGINT and SIGTERM set from now on, on the running loop."""
    asked, loop = asyncio.Event(), asyncio.get_running_loop()
    for number in _SIGNALS:
        loop.add_signal_handler(number, asked.set)
    return asked
