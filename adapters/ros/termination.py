"""SIGINT and SIGTERM as a wish that a process looks at when it is ready to."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class Termination:
    """Whether this process was asked to end."""

    def __init__(self) -> None:
        """Not yet."""
        self.requested = False


@contextmanager
def termination() -> Iterator[Termination]:
    """Catch SIGINT and SIGTERM. Only for the main thread, which is to look again and again."""
    asked = Termination()

    def ask(_number: int, _frame: FrameType | None) -> None:
        asked.requested = True

    before = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
