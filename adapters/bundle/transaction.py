"""Groups of changes that are committed together, and what waits for that."""

import logging
from collections.abc import Callable
from contextlib import ExitStack

from adapters.bundle.database import Database
from adapters.bundle.errors import StoreError

_LOG = logging.getLogger(__name__)


class Transaction:
    """Gathers what must be true on the disk before anybody is told.

    Changes that can be undone are written to the database at once. Those that cannot, because what
    they stand for has happened, are marks: they are written with the next commit that succeeds.
    """

    def __init__(self, database: Database) -> None:
        """Gather for this database."""
        self._database = database
        self._marks: list[Callable[[], None]] = []
        self._waiting: list[Callable[[StoreError | None], None]] = []
        self._failing = False

    @property
    def pending(self) -> bool:
        """Whether there is something to commit."""
        return bool(self._marks or self._waiting) or self._database.gathering

    def mark(self, write: Callable[[], None]) -> None:
        """Write something with the next commit, and again with the one after if that fails."""
        self._marks.append(write)

    def then(self, tell: Callable[[StoreError | None], None]) -> None:
        """Tell somebody of the next commit: None if it succeeded, or why it did not."""
        self._waiting.append(tell)

    def commit(self) -> None:
        """Commit what has gathered, and tell who waits, all of them; one may raise."""
        failure: StoreError | None = None
        try:
            for write in self._marks:
                write()
            self._database.commit()
            self._marks.clear()
        except StoreError as error:
            failure = error
            self._database.undo()
        if failure is not None and not self._failing:
            _LOG.error("nothing can be stored: %s", failure)
        self._failing = failure is not None
        waiting, self._waiting = self._waiting, []
        with ExitStack() as told:
            for tell in reversed(waiting):
                told.callback(tell, failure)
