"""Which numbers the reports of a rover have here, where it may come back with a new ledger."""

from typing import Final

from adapters.mops.message import MopsError
from adapters.mops.reports import HIGHEST_SEQUENCE
from executive.ledger import Ledger

APART: Final = HIGHEST_SEQUENCE + 1
"""From the first number of a ledger to the first of the next."""
MOST: Final = 1000
"""Ledgers of one rover. Who names more names something else."""
_SCHEMA: Final = """
CREATE TABLE IF NOT EXISTS ledgers (name TEXT PRIMARY KEY, place INTEGER NOT NULL) WITHOUT ROWID;
"""


class Ledgers:
    """The ledgers that a rover has had, by the names in its reports, in the order of their coming.

    The reports of the first have the numbers that the rover gave them, those of the next ones begin
    at `APART` + 1, 2 * `APART` + 1, and so on. So numbers only rise with a new ledger, and what is
    still on its way from the old one keeps its own.

    Args:
        ledger: in whose file and commits this is kept.

    Raises:
        LedgerError: from every method, if the file cannot be read.
    """

    def __init__(self, ledger: Ledger) -> None:
        """Go on with what is known."""
        self._ledger = ledger
        ledger.extend(_SCHEMA)
        rows = ledger.rows("SELECT name, place FROM ledgers ORDER BY place")
        self._places = {str(name): int(place) for name, place in rows}

    def new(self, name: str) -> bool:
        """Return whether a name is that of a ledger that comes after another.

        Raises:
            MopsError: it is one more than there can be.
        """
        if not name or name in self._places:
            return False
        if len(self._places) >= MOST:
            raise MopsError(f"ledger: {name} is number {MOST + 1} of the rover")
        return bool(self._places)

    def number(self, name: str, sequence: int) -> int:
        """Return the number that a report has here, and know the ledger from the next commit on.

        Args:
            name: of the ledger; empty is the newest.
            sequence: the number in it.
        """
        if name and name not in self._places:
            self._places[name] = len(self._places)
            self._ledger.write("INSERT INTO ledgers VALUES (?, ?)", (name, self._places[name]))
        place = self._places[name] if name else max(self._places.values(), default=0)
        return place * APART + sequence
