"""`RelayRecord`: durable state of the executive's end of the relay link, in the ledger's file."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from executive.commands import Command
from executive.record.ledger import Ledger
from executive.values.reports import Identity, Stage

_SCHEMA: Final = """
CREATE TABLE IF NOT EXISTS relayed (
    source TEXT NOT NULL, command_id INTEGER NOT NULL, code INTEGER NOT NULL, counter INTEGER,
    PRIMARY KEY (source, command_id)
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS relay_notification_ack
    (only_row INTEGER PRIMARY KEY, sequence INTEGER NOT NULL);
CREATE TABLE IF NOT EXISTS ledger_name (only_row INTEGER PRIMARY KEY, name TEXT NOT NULL);
"""


_NAME_OCTETS: Final = 6


@dataclass(frozen=True, slots=True)
class RelayedCommand:
    """The relay's code and counter of a command."""

    code: int
    counter: int | None


class RelayRecord:
    """Records commands received over the relay, and the last report delivered to it.

    Args:
        ledger: the ledger; its file stores the record.
        random_octets: returns unpredictable octets, for the name of a new ledger.

    Attributes:
        ledger_name: distinguishes this ledger's numbers from those of an earlier or later one.

    Raises:
        LedgerError: from every method, if the file cannot be read.
    """

    def __init__(self, ledger: Ledger, random_octets: Callable[[int], bytes]) -> None:
        self._ledger = ledger
        ledger.add_tables(_SCHEMA, self._forget)
        if not ledger.rows("SELECT sequence FROM relay_notification_ack"):
            self.mark_delivered(ledger.last_sequence)
            ledger.commit()
        if not ledger.rows("SELECT name FROM ledger_name"):
            name = random_octets(_NAME_OCTETS).hex()
            ledger.write("INSERT INTO ledger_name VALUES (0, ?)", (name,))
            ledger.commit()
        ((self.ledger_name,),) = ledger.rows("SELECT name FROM ledger_name")
        self._last_query: tuple[Identity, RelayedCommand] | None = None

    @property
    def delivered_up_to(self) -> int:
        """The number of the last report delivered to the relay."""
        ((sequence,),) = self._ledger.rows("SELECT sequence FROM relay_notification_ack")
        return int(sequence)

    def mark_delivered(self, sequence: int) -> None:
        """Record that reports up to this number were delivered to the relay."""
        self._ledger.write(
            "INSERT OR REPLACE INTO relay_notification_ack VALUES (0, ?)", (sequence,)
        )

    def add(self, command: Command, code: int) -> None:
        """Record that a command was received over the relay."""
        identity = command.identity
        self._ledger.write(
            "INSERT OR IGNORE INTO relayed VALUES (?, ?, ?, ?)",
            (identity.source, identity.command_id, code, command.counter),
        )

    def find(self, identity: Identity) -> RelayedCommand | None:
        """Return how a command was received over the relay; None if it was not."""
        if self._last_query is not None and self._last_query[0] == identity:
            return self._last_query[1]  # reports on one command mostly follow each other
        rows = self._ledger.rows(
            "SELECT code, counter FROM relayed WHERE source = ? AND command_id = ?",
            (identity.source, identity.command_id),
        )
        if not rows:
            return None
        self._last_query = identity, RelayedCommand(*rows[0])
        return self._last_query[1]

    def _forget(self, identity: Identity, _: Stage) -> None:
        self._ledger.write(
            "DELETE FROM relayed WHERE source = ? AND command_id = ?",
            (identity.source, identity.command_id),
        )
