"""What a rover was asked for: what waits in the outbox, and what has not ended."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from adapters.bundle import BundleId
from adapters.orbiter.losses import Loss
from executive.commands import Command, Identity, Stop
from executive.ledger import Ledger
from executive.reports import Stage

_SCHEMA: Final = """
CREATE TABLE IF NOT EXISTS underway (
    bundle TEXT PRIMARY KEY, source TEXT NOT NULL, command_id INTEGER NOT NULL,
    utc_s REAL NOT NULL
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS asked (
    source TEXT NOT NULL, command_id INTEGER NOT NULL, message BLOB,
    until_utc_s REAL NOT NULL, asked_utc_s REAL NOT NULL, ended INTEGER NOT NULL,
    PRIMARY KEY (source, command_id)
) WITHOUT ROWID;
CREATE INDEX IF NOT EXISTS asked_open ON asked (asked_utc_s) WHERE NOT ended;
"""
_ENDED: Final = 1
_FORGOTTEN: Final = 2
"""Of `ended`: nothing more is expected, as the rover has another ledger now."""
_WORKING: Final = (Stage.STARTED.value, Stage.PROGRESS.value)
_WAITING: Final = (Stage.RECEIVED.value, Stage.ACCEPTED.value)
_OPEN: Final = " FROM asked a LEFT JOIN stages s USING (source, command_id) WHERE NOT a.ended"
_WAITS: Final = (
    " EXISTS (SELECT 1 FROM underway u WHERE u.source = a.source AND u.command_id = a.command_id)"
)


@dataclass(frozen=True, slots=True)
class Open:
    """A command that has not ended, as far as is known.

    Attributes:
        message: the command as it went up.
        until_utc_s: when it is no longer worth sending.
    """

    identity: Identity
    message: bytes
    until_utc_s: float


class Asked:
    """The commands that went to one rover. A message is kept while it may be sent once more.

    Args:
        ledger: where commands and their stages are; its commits hold these tables too.

    Raises:
        LedgerError: from every method, if the file cannot be read or written.
    """

    def __init__(self, ledger: Ledger) -> None:
        """Make the tables."""
        self._ledger = ledger
        ledger.extend(_SCHEMA)

    def sent(
        self, command: Command, message: bytes, bundle: BundleId, utc_s: float, until_utc_s: float
    ) -> None:
        """Remember that a command is in the outbox, in a bundle."""
        identity = command.identity
        key = (identity.source, identity.command_id)
        self._ledger.record(command)
        self._ledger.write(
            "INSERT OR REPLACE INTO underway VALUES (?, ?, ?, ?)", (str(bundle), *key, utc_s)
        )
        self._ledger.write(
            "INSERT OR REPLACE INTO asked VALUES (?, ?, ?, ?, ?, 0)",
            (*key, message, until_utc_s, utc_s),
        )
        self._ledger.commit()

    def carried_out(self, command: Command, utc_s: float, until_utc_s: float) -> None:
        """Remember a command that did not go up, from the next commit on, for its lifetime."""
        identity = command.identity
        self._ledger.record(command)
        self._ledger.write(
            "INSERT OR REPLACE INTO asked VALUES (?, ?, NULL, ?, ?, ?)",
            (identity.source, identity.command_id, until_utc_s, utc_s, _ENDED),
        )

    def knows(self, bundle: BundleId) -> bool:
        """Return whether a bundle was written down that has not left the outbox."""
        return bool(self._ledger.rows("SELECT 1 FROM underway WHERE bundle = ?", (str(bundle),)))

    def again(self, identity: Identity, utc_s: float) -> None:
        """Remember that a command was asked for once more."""
        self._ledger.write(
            "UPDATE asked SET asked_utc_s = ? WHERE source = ? AND command_id = ?",
            (utc_s, identity.source, identity.command_id),
        )
        self._ledger.commit()

    def left(self, bundle: BundleId, utc_s: float, lost: bool = False) -> Identity | None:
        """Remember that a bundle has left the outbox; return the command in it, the first time.

        Args:
            bundle: one of this rover's, or not.
            utc_s: when.
            lost: whether nothing more is expected of its command.
        """
        key = (str(bundle),)
        rows = self._ledger.rows("SELECT source, command_id FROM underway WHERE bundle = ?", key)
        if not rows:
            return None
        identity = Identity(*rows[0])
        self._ledger.write("DELETE FROM underway WHERE bundle = ?", key)
        if lost:
            self.end(identity)
        self.again(identity, utc_s)
        return identity

    def all_left(self, utc_s: float) -> None:
        """Remember that the outbox is empty."""
        if self.oldest_utc_s() is None:
            return
        self._ledger.write(f"UPDATE asked AS a SET asked_utc_s = ? WHERE {_WAITS}", (utc_s,))
        self._ledger.write("DELETE FROM underway", ())
        self._ledger.commit()

    def oldest_utc_s(self) -> float | None:
        """Return since when the oldest command has been in the outbox; None if none is there."""
        ((oldest_utc_s,),) = self._ledger.rows("SELECT min(utc_s) FROM underway")
        return None if oldest_utc_s is None else float(oldest_utc_s)

    def lost(self, command_id: int) -> Sequence[tuple[Identity, float, Loss]]:
        """Return commands of a number that may have no end, since when, and why."""
        rows = self._ledger.rows(
            "SELECT a.source, a.command_id, a.asked_utc_s, a.ended FROM asked a"
            " LEFT JOIN stages s USING (source, command_id)"
            " WHERE a.command_id = ? AND (a.ended = ? OR a.ended = ? AND s.stage IS NULL)",
            (command_id, _FORGOTTEN, _ENDED),
        )
        return [
            (
                Identity(source, number),
                float(utc_s),
                Loss.FORGOTTEN if ended == _FORGOTTEN else Loss.GIVEN_UP,
            )
            for source, number, utc_s, ended in rows
        ]

    def end(self, identity: Identity) -> None:
        """Expect nothing more of a command, from the next commit on."""
        self._ledger.write(
            "UPDATE asked SET message = NULL, ended = ? WHERE source = ? AND command_id = ?",
            (_ENDED, identity.source, identity.command_id),
        )

    def give_up(self, utc_s: float) -> Sequence[Identity]:
        """Expect nothing more of what was begun, from the next commit on; return what that was.

        What else has left the outbox is not asked for again: nobody knows whether it was done.
        """
        rows = self._ledger.rows(
            f"SELECT a.source, a.command_id{_OPEN} AND s.stage IS NOT NULL AND NOT {_WAITS}"
        )
        for key in rows:
            self._ledger.write(
                "UPDATE asked SET ended = ?, asked_utc_s = ? WHERE source = ? AND command_id = ?",
                (_FORGOTTEN, utc_s, *key),
            )
        self._ledger.write(f"UPDATE asked AS a SET message = NULL WHERE NOT {_WAITS}", ())
        return [Identity(*key) for key in rows]

    def unheard(self, until_utc_s: float) -> Sequence[Identity]:
        """Expect nothing more of what nothing was heard of in its lifetime; return what that was.

        Args:
            until_utc_s: the latest end of a lifetime.
        """
        rows = self._ledger.rows(
            f"SELECT a.source, a.command_id{_OPEN} AND s.stage IS NULL AND NOT {_WAITS}"
            " AND a.until_utc_s <= ?",
            (until_utc_s,),
        )
        found = [Identity(*row) for row in rows]
        for identity in found:
            self.end(identity)
        self._ledger.commit()
        return found

    def unanswered(
        self, asked_before_utc_s: float, utc_s: float, begun: bool, most: int
    ) -> Sequence[Open]:
        """Return commands to be asked for again, the one that waits longest first.

        A stop is none of them: it would stop what has been begun since.

        Args:
            asked_before_utc_s: those that were asked for last before this.
            utc_s: the time; those that are worth sending no longer are left.
            begun: also those of which something was heard.
            most: how many at most.
        """
        rows = self._ledger.rows(
            f"SELECT a.source, a.command_id, a.message, a.until_utc_s{_OPEN}"
            " AND a.message IS NOT NULL AND a.asked_utc_s <= ? AND a.until_utc_s > ?"
            " AND (? OR s.stage IS NULL)"
            f" AND NOT {_WAITS} AND NOT EXISTS (SELECT 1 FROM commands c WHERE c.source = a.source"
            " AND c.command_id = a.command_id AND c.name = ?) ORDER BY a.asked_utc_s LIMIT ?",
            (asked_before_utc_s, utc_s, begun, Stop.__name__, most),
        )
        return [Open(Identity(*row[:2]), bytes(row[2]), float(row[3])) for row in rows]

    def active(self) -> int | None:
        """Return the number of the command that the rover works on, as far as is known."""
        rows = self._ledger.rows(f"SELECT a.command_id{_OPEN} AND s.stage IN (?, ?)", _WORKING)
        return int(rows[0][0]) if rows else None

    def queued(self) -> int:
        """Return how many commands were sent of which the rover has begun none."""
        ((count,),) = self._ledger.rows(
            f"SELECT count(*){_OPEN} AND (s.stage IS NULL OR s.stage IN (?, ?))", _WAITING
        )
        return int(count)
