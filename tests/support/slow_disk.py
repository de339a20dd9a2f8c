"""A ledger's writer on a slow disk, in simulated time; it loses power at any moment."""

from collections.abc import Callable
from random import Random

from executive.record.database import Database
from executive.record.writer import Batch, InlineWriter, WriterState


class SlowWriter:
    """Commits all that waits at once, as the thread does, each time after a while.

    Args:
        database: the ledger's file.
        durable: number of the last batch that was committed before.
        now_s: the simulated time.
        commit_s: draws how long the next commit takes.
    """

    def __init__(
        self,
        database: Database,
        durable: int,
        now_s: Callable[[], float],
        commit_s: Callable[[], float],
    ) -> None:
        self._inline = InlineWriter(database)
        self._state = WriterState(durable)
        self._now_s, self._commit_s = now_s, commit_s
        self._waiting: list[Batch] = []
        self._group: list[Batch] = []
        self._done_s = 0.0

    def put(self, batch: Batch) -> None:
        self._waiting.append(batch)
        self._begin()

    def poll(self) -> WriterState:
        while self._group and self._now_s() >= self._done_s:
            for batch in self._group:
                self._inline.put(batch)
                self._state = self._inline.poll()
            self._group = []
            self._begin()
        return self._state

    def close(self) -> None:
        for batch in (*self._group, *self._waiting):
            self._inline.put(batch)
        self._state = self._inline.poll()

    def abandon(self) -> None:
        """Lose the uncommitted batches."""
        self._group, self._waiting = [], []

    def _begin(self) -> None:
        if not self._group and self._waiting:
            self._group, self._waiting = self._waiting, []
            self._done_s = self._now_s() + self._commit_s()


def drawn(random: Random, *commit_s: float) -> Callable[[], float]:
    """Return a function that draws durations of commits around one of these means."""
    mean_s = random.choice(commit_s)
    return lambda: random.uniform(0.0, 2.0 * mean_s)
