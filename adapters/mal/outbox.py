"""What waits to be written to a subscriber that does not read fast enough."""

from collections import OrderedDict, deque
from collections.abc import Callable
from typing import Final

DROPPABLE_CAP: Final = 256
"""Droppable messages that wait, at most; the oldest gives way to a new one."""
BACKLOG_CAP: Final = 4096
"""Messages that may not be dropped and wait, at most; one more and the subscriber is given up."""


class Outbox:
    """Writes through while it can; while it must wait, keeps messages in order and bounded."""

    def __init__(self, write: Callable[[bytes], None], give_up: Callable[[str], None]) -> None:
        """Take how to write a message, and how to end the connection for a reason."""
        self._write = write
        self._give_up = give_up
        self._waiting: OrderedDict[int, bytes] = OrderedDict()
        self._droppable: deque[int] = deque()
        self._number = 0
        self._paused = False

    def put(self, message: bytes, droppable: bool) -> None:
        """Write a message now or later."""
        if not self._paused:
            self._write(message)
            return
        self._number += 1
        if droppable:
            if len(self._droppable) == DROPPABLE_CAP:
                del self._waiting[self._droppable.popleft()]
            self._droppable.append(self._number)
        elif len(self._waiting) - len(self._droppable) == BACKLOG_CAP:
            self._give_up(f"{BACKLOG_CAP} messages wait that may not be dropped")
            return
        self._waiting[self._number] = message

    def pause(self) -> None:
        """Keep what comes from now on."""
        self._paused = True

    def resume(self) -> None:
        """Write what waits, until paused again."""
        self._paused = False
        while self._waiting and not self._paused:
            number, message = self._waiting.popitem(last=False)
            if self._droppable and self._droppable[0] == number:
                self._droppable.popleft()
            self._write(message)
