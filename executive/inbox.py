"""The thread-safe way into the core: links put commands and questions, the core's thread takes."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from queue import SimpleQueue

from executive.admission import Admission
from executive.commands import Command


@dataclass(frozen=True, slots=True)
class Submission:
    """A command, and who to tell whether it was admitted (called on the core's thread)."""

    command: Command
    reply: Callable[[Admission], None]


@dataclass(frozen=True, slots=True)
class Question:
    """Something to read or do on the core's thread, which owns what it touches."""

    ask: Callable[[], None]


class Inbox:
    """A queue that wakes the core's thread.

    Args:
        wake: called from the putting thread after each put; must be thread-safe and quick.
    """

    def __init__(self, wake: Callable[[], None] = lambda: None) -> None:
        """Start empty."""
        self.wake = wake
        self._items: SimpleQueue[Submission | Question] = SimpleQueue()

    def submit(self, command: Command, reply: Callable[[Admission], None]) -> None:
        """Hand over a command."""
        self._items.put(Submission(command, reply))
        self.wake()

    def ask(self, question: Callable[[], None]) -> None:
        """Have something read or done on the core's thread."""
        self._items.put(Question(question))
        self.wake()

    def drain(self) -> Iterator[Submission | Question]:
        """Yield what has come; what comes meanwhile is for the next time, so that this ends."""
        for _ in range(self._items.qsize()):
            yield self._items.get_nowait()
