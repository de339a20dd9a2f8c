"""Writers commit the batches of a ledger: `InlineWriter` at once, `ThreadWriter` on its own thread.

With a separate thread no tick waits for the disk. The thread takes all waiting batches into one
transaction (group commit). Batches are committed whole and in the order of their numbers; after
an error the same batches are tried again, so nothing is lost or reordered.

The stop latch is written by the same writer, a stop before the commit and a release after it. Only
the last change of a group counts, so that a release never undoes a later stop.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Final, Protocol

from executive.record.database import Database, LedgerError, Statement
from executive.record.stop_latch import LatchChange

RETRY_S: Final = 0.05
"""Period of the attempts to write after a failure: one tick; chosen, not measured."""


@dataclass(frozen=True, slots=True)
class Batch:
    """Changes that are committed together.

    Attributes:
        number: consecutive number, from 1.
        latch: change of the stop latch, if any.
    """

    number: int
    statements: Sequence[Statement]
    latch: LatchChange | None = None


@dataclass(frozen=True, slots=True)
class WriterState:
    """Progress of a writer.

    Attributes:
        durable: number of the last batch that is committed; 0 before the first.
        error: error of the last attempt; None if it succeeded.
        unstored: change of the stop latch that is to be stored with the next batch, after an error.
        latch_error: that error.
    """

    durable: int = 0
    error: LedgerError | None = None
    unstored: LatchChange | None = None
    latch_error: OSError | None = None


class BatchWriter(Protocol):
    """Commits batches in order."""

    def put(self, batch: Batch) -> None:
        """Accept a batch."""

    def poll(self) -> WriterState:
        """Return the present state."""

    def close(self) -> None:
        """Commit what can be committed, and end."""

    def abandon(self) -> None:
        """End as a crash would: batches that are not committed are lost."""


class InlineWriter:
    """Commits each batch in `put`, and tries again in each `poll` after a failure."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._waiting: list[Batch] = []
        self._state = WriterState()

    def put(self, batch: Batch) -> None:
        """Commit a batch, after those that failed before."""
        self._waiting.append(batch)
        self._try()

    def poll(self) -> WriterState:
        """Try again after a failure, and return the state."""
        if self._waiting:
            self._try()
        return self._state

    def close(self) -> None:
        """Do nothing: all that can be committed is."""

    def abandon(self) -> None:
        """Drop the batches that failed."""
        self._waiting.clear()

    def _try(self) -> None:
        self._state = _commit(self._database, self._waiting, self._state)
        if self._state.error is None:
            self._waiting.clear()


class ThreadWriter:
    """Commits batches on a thread of its own.

    Args:
        open_database: opens the writer's own connection to the file of the ledger.
        durable: number of the last batch that was committed before.
        wake: called on the writer's thread after each attempt; must be quick.
    """

    def __init__(
        self, open_database: Callable[[], Database], durable: int, wake: Callable[[], None]
    ) -> None:
        self._open_database = open_database
        self._wake = wake
        self._batches: SimpleQueue[Batch | None] = SimpleQueue()
        self._state = WriterState(durable)
        self._abandoned = False
        self._thread = Thread(target=self._run, name="ledger-writer", daemon=True)
        self._thread.start()

    def put(self, batch: Batch) -> None:
        """Hand a batch over to the thread."""
        self._batches.put(batch)

    def poll(self) -> WriterState:
        """Return the state after the last attempt."""
        return self._state

    def close(self) -> None:
        """Commit all batches and end the thread; after a failure, as `abandon`."""
        self._batches.put(None)
        self._thread.join()

    def abandon(self) -> None:
        """End the thread after the present attempt."""
        self._abandoned = True
        self.close()

    def _run(self) -> None:
        waiting: list[Batch] = []
        database: Database | None = None
        ending = False
        while not (ending and (not waiting or self._state.error is not None)):
            ending = self._take(waiting) or ending
            if self._abandoned:
                break
            if not waiting:
                continue
            try:
                database = database or self._open_database()
            except LedgerError as error:
                self._state = replace(self._state, error=error)
            else:
                self._state = _commit(database, waiting, self._state)
                if self._state.error is None:
                    waiting.clear()
            self._wake()
        if database is not None:
            database.close()

    def _take(self, waiting: list[Batch]) -> bool:
        """Wait for a batch, or for the next attempt; append all that are there.

        Returns:
            Whether the end was requested.
        """
        try:
            item = self._batches.get(timeout=RETRY_S if waiting else None)
            while item is not None:
                waiting.append(item)
                item = self._batches.get_nowait()
        except Empty:
            return False
        return True


def _commit(database: Database, batches: Sequence[Batch], before: WriterState) -> WriterState:
    """Commit batches in one transaction, with the last change of the stop latch."""
    changes = (each.latch for each in reversed(batches) if each.latch is not None)
    change, latch_error = next(changes, before.unstored), None
    if change is not None and change.stopped_by is not None:
        latch_error = change.store()
        change = None if latch_error is None else change
    try:
        database.transact([one for each in batches for one in each.statements])
    except LedgerError as error:
        return WriterState(before.durable, error, change, latch_error)
    if change is not None and change.stopped_by is None:
        latch_error = change.store()
        change = None if latch_error is None else change
    return WriterState(batches[-1].number, None, change, latch_error)
