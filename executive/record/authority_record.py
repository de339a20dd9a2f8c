"""Who holds the authority over the asset, in the ledger's file."""

from dataclasses import dataclass
from typing import Final

from executive.record.database import LedgerError
from executive.record.ledger import Ledger

_SCHEMA: Final = """
CREATE TABLE IF NOT EXISTS authority (
    only_row INTEGER PRIMARY KEY, holder TEXT, epoch INTEGER NOT NULL, lease_s REAL NOT NULL,
    given_by TEXT
);
"""


@dataclass(frozen=True, slots=True)
class Grant:
    """What was granted last.

    Attributes:
        holder: to whom; None if it was released since, or never granted.
        epoch: the number of the grant, one more than that of the grant before; 0 before the first.
        lease_s: how long it lasts after each sign of the holder.
        given_by: who handed it over; None if it was requested or taken.
    """

    holder: str | None = None
    epoch: int = 0
    lease_s: float = 0.0
    given_by: str | None = None


class AuthorityRecord:
    """The last grant; raises LedgerError from every method if the file cannot be used."""

    def __init__(self, ledger: Ledger) -> None:
        self._ledger = ledger
        ledger.extend(_SCHEMA)

    def read(self) -> Grant:
        """Return the last grant that was committed."""
        rows = self._ledger.rows("SELECT holder, epoch, lease_s, given_by FROM authority")
        return Grant(*rows[0]) if rows else Grant()

    def keep(self, grant: Grant, former: Grant) -> None:
        """Write a grant down, so that no other of its number is given after a crash.

        Where that fails, what is written once it works again is the former one.
        """
        self._ledger.commit()
        try:
            self._write(grant)
            self._ledger.commit()
        except LedgerError:
            self._write(former)
            raise

    def _write(self, grant: Grant) -> None:
        values = (grant.holder, grant.epoch, grant.lease_s, grant.given_by)
        self._ledger.write("INSERT OR REPLACE INTO authority VALUES (0, ?, ?, ?, ?)", values)
