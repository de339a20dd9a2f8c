"""What other threads hand over to the core, served in the order of its arrival; stops overtake."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import count
from queue import SimpleQueue
from typing import Final

from executive.commands import Command, Stop
from executive.commands.lifecycle import SubmitResult

MOST_A_TURN: Final = 32
"""Commands and questions of one turn, so that the ticks keep their time."""


@dataclass(frozen=True, slots=True)
class Submission:
    """A command, and who to tell whether it was admitted.

    Attributes:
        arrival: counts the commands in the order in which they were submitted.
        prepare: called before the command is looked at; what it writes is committed with it.
    """

    arrival: int
    command: Command
    reply: Callable[[SubmitResult], None]
    prepare: Callable[[], None]


Question = Callable[[], None]
"""Something to read or do on the executive's thread, which owns what it touches."""


class Inbox:
    """Commands and questions from any thread, for the core's thread to take."""

    def __init__(self) -> None:
        self._items: SimpleQueue[Submission | Question] = SimpleQueue()
        self._stops: SimpleQueue[Submission] = SimpleQueue()
        self._arrivals = count(1)
        self._stopped_at = 0

    def put(
        self,
        command: Command,
        reply: Callable[[SubmitResult], None],
        prepare: Callable[[], None],
    ) -> None:
        """Hand over a command, from any thread."""
        submission = Submission(next(self._arrivals), command, reply, prepare)
        stops = isinstance(command.request, Stop)
        (self._stops if stops else self._items).put(submission)

    def ask(self, question: Question) -> None:
        """Hand over a question, from any thread."""
        self._items.put(question)

    @property
    def stop_waits(self) -> bool:
        """Whether a stop has come that was not taken."""
        return not self._stops.empty()

    @property
    def empty(self) -> bool:
        """Whether nothing waits."""
        return self._items.empty() and self._stops.empty()

    @property
    def waiting(self) -> int:
        """How many commands and questions wait."""
        return self._items.qsize() + self._stops.qsize()

    @property
    def stops_now(self) -> int:
        """How many stops are to be taken now."""
        return min(self._stops.qsize(), MOST_A_TURN)

    @property
    def items_now(self) -> int:
        """How many commands and questions are to be taken in this turn."""
        return min(self._items.qsize(), MOST_A_TURN)

    def take_stop(self) -> Submission:
        """Return the next stop."""
        stop = self._stops.get_nowait()
        self._stopped_at = stop.arrival
        return stop

    def take(self) -> Submission | Question:
        """Return the next command that is no stop, or the next question."""
        return self._items.get_nowait()

    def overtaken(self, submission: Submission) -> bool:
        """Return whether a stop was taken that has come after a command."""
        return submission.arrival < self._stopped_at
