"""`Inbox`: queue of commands and queries from other threads to the core; stops overtake others."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import count
from queue import SimpleQueue
from typing import Final

from executive.commands import Command, Stop
from executive.commands.lifecycle import SubmitResult

MAX_ITEMS_PER_TURN: Final = 32
"""Maximum number of commands and queries served in one turn, so that ticks stay on time."""


@dataclass(frozen=True, slots=True)
class Submission:
    """A command with its reply callback.

    Attributes:
        order: number of the command in the order of submission.
        prepare: called before the command is examined; its writes are committed with it.
    """

    order: int
    command: Command
    reply: Callable[[SubmitResult], None]
    prepare: Callable[[], None]


Query = Callable[[], None]
"""A function that reads or acts on the executive's thread, which owns the objects it uses."""


class Inbox:
    """Commands and queries from any thread, which the core's thread serves."""

    def __init__(self) -> None:
        self._items: SimpleQueue[Submission | Query] = SimpleQueue()
        self._stops: SimpleQueue[Submission] = SimpleQueue()
        self._order = count(1)
        self._stopped_at = 0

    def put(
        self,
        command: Command,
        reply: Callable[[SubmitResult], None],
        prepare: Callable[[], None],
    ) -> None:
        """Add a command, from any thread."""
        submission = Submission(next(self._order), command, reply, prepare)
        stops = isinstance(command.request, Stop)
        (self._stops if stops else self._items).put(submission)

    def put_query(self, question: Query) -> None:
        """Add a query, from any thread."""
        self._items.put(question)

    @property
    def stop_pending(self) -> bool:
        """Whether a stop is pending."""
        return not self._stops.empty()

    @property
    def empty(self) -> bool:
        """Whether the queue is empty."""
        return self._items.empty() and self._stops.empty()

    @property
    def waiting(self) -> int:
        """Number of pending commands and queries."""
        return self._items.qsize() + self._stops.qsize()

    @property
    def pending_stops(self) -> int:
        """Number of stops to serve now."""
        return min(self._stops.qsize(), MAX_ITEMS_PER_TURN)

    @property
    def pending_items(self) -> int:
        """Number of commands and queries to serve in this turn."""
        return min(self._items.qsize(), MAX_ITEMS_PER_TURN)

    def take_stop(self) -> Submission:
        """Remove and return the next stop."""
        stop = self._stops.get_nowait()
        self._stopped_at = stop.order
        return stop

    def take(self) -> Submission | Query:
        """Remove and return the next command other than a stop, or the next query."""
        return self._items.get_nowait()

    def superseded_by_stop(self, submission: Submission) -> bool:
        """Whether a stop that was submitted after the command has been served."""
        return submission.order < self._stopped_at
