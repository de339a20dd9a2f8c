"""`AuthorityRecord`: the last grant of the command authority, in the ledger's file."""

from dataclasses import dataclass
from typing import Final

from executive.record.ledger import Ledger

_SCHEMA: Final = """
CREATE TABLE IF NOT EXISTS authority (
    only_row INTEGER PRIMARY KEY, holder TEXT, epoch INTEGER NOT NULL, lease_s REAL NOT NULL,
    given_by TEXT
);
"""


@dataclass(frozen=True, slots=True)
class Grant:
    """The last grant.

    Attributes:
        holder: name of the holder; None if it was released since, or never granted.
        epoch: the number of the grant, one more than that of the grant before; 0 before the first.
        lease_s: lease in seconds after each contact of the holder.
        granted_by: source that handed it over; None if it was requested or taken.
    """

    holder: str | None = None
    epoch: int = 0
    lease_s: float = 0.0
    granted_by: str | None = None


class AuthorityRecord:
    """The last grant; every method raises LedgerError if the file cannot be used."""

    def __init__(self, ledger: Ledger) -> None:
        self._ledger = ledger
        ledger.add_tables(_SCHEMA)

    def read(self) -> Grant:
        """Return the last committed grant."""
        rows = self._ledger.rows("SELECT holder, epoch, lease_s, given_by FROM authority")
        return Grant(*rows[0]) if rows else Grant()

    @property
    def failing(self) -> bool:
        """Whether grants cannot be stored at present."""
        return self._ledger.failing

    def save(self, grant: Grant) -> None:
        """Write a grant with the next commit.

        Its requester gets it after that, so that its number is not granted again after a crash.
        """
        values = (grant.holder, grant.epoch, grant.lease_s, grant.granted_by)
        self._ledger.write("INSERT OR REPLACE INTO authority VALUES (0, ?, ?, ?, ?)", values)
