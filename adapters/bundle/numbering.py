"""Creation timestamps that are never given twice, whatever the clock does."""

from typing import Final

from adapters.bundle.database import Database
from adapters.bundle.transaction import Transaction
from adapters.bundle.values import DTN_EPOCH_UTC_MS, Creation

_TIME: Final = "last creation time"
_SEQUENCE: Final = "last creation sequence"


class Numbering:
    """Gives creation timestamps that only grow, over restarts and when the clock steps back.

    The last one is written with the transaction of the bundle that has it. What a crash undoes was
    never sent, so that it may be given again.
    """

    def __init__(self, database: Database, transaction: Transaction) -> None:
        """Go on after the last number that was committed."""
        self._database = database
        self._transaction = transaction
        self._last = Creation(database.count(_TIME), database.count(_SEQUENCE))
        self._to_write = False

    def next(self, utc_ms: int) -> Creation:
        """Return a new creation timestamp, for the time now in milliseconds since 1970."""
        last = self._last
        time_ms = max(utc_ms - DTN_EPOCH_UTC_MS, last.time_ms, 1)
        sequence = last.sequence + 1 if time_ms == last.time_ms else 0
        self._last = Creation(time_ms, sequence)
        if not self._to_write:
            self._to_write = True
            self._transaction.mark(self._write)
        return self._last

    def _write(self) -> None:
        self._to_write = False
        self._database.set_count(_TIME, self._last.time_ms)
        self._database.set_count(_SEQUENCE, self._last.sequence)
