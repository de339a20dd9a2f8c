"""`BrickRecord` of `rover-nxt`: commands, queue, claims, authority; all SQL of this process."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any, Final

from adapters.mops import Message, decode, is_last
from adapters.system import OPERATING_SYSTEM, SYNCED_APART, System, sync_database
from executive.record import Database
from executive.values.reports import Stage

MAX_COMMANDS: Final = 10_000
"""Maximum number of commands in the record; older ones are deleted."""
_NONE: Final = -1
_MAY_BE_OPEN: Final = 1000
"""Number of latest claims searched for open ones: the executive queues far fewer."""
_SELECT_COMMANDS: Final = "SELECT command, links, reply, queued FROM commands"
_FORGET: Final = "DELETE FROM commands WHERE source = ? AND moe_id = ? AND counter = ?"
_VERSION: Final = 1
"""Version of the tables; increase it with each change."""
_SCHEMA: Final = """
CREATE TABLE IF NOT EXISTS commands (
    number INTEGER PRIMARY KEY, source TEXT NOT NULL, moe_id INTEGER NOT NULL,
    counter INTEGER NOT NULL, command TEXT NOT NULL, links TEXT NOT NULL, reply TEXT,
    ended INTEGER NOT NULL, queued INTEGER NOT NULL DEFAULT 0, UNIQUE (source, moe_id, counter)
);
CREATE INDEX IF NOT EXISTS commands_open ON commands (number) WHERE NOT ended;
CREATE TABLE IF NOT EXISTS claims (
    number INTEGER PRIMARY KEY, source TEXT NOT NULL, moe_id INTEGER NOT NULL,
    command TEXT NOT NULL, reported TEXT, relay_copy TEXT, UNIQUE (source, moe_id)
);
CREATE TABLE IF NOT EXISTS authority (only_row INTEGER PRIMARY KEY, message TEXT NOT NULL);
"""


class BrickLink(Enum):
    """Link between the brick and a sender of commands."""

    DIRECT = "direct"
    RELAY = "relay"


@dataclass(frozen=True, slots=True)
class BrickCommand:
    """A command to the brick, the links that sent it, and the last reply.

    Attributes:
        waits: whether it is queued and not yet sent to the brick.
    """

    command: Message
    links: tuple[BrickLink, ...]
    replied: Message | None = None
    waits: bool = False

    @property
    def ended(self) -> bool:
        """Whether the last reply is final."""
        return self.replied is not None and is_last(self.replied)

    @property
    def refused(self) -> bool:
        """Whether the brick rejected it, so that it executed nothing of it."""
        replied = self.replied
        if replied is None or replied.received or replied.executed:
            return False
        return replied.outputs[:1] in ((), ("",), (Stage.REJECTED.name,))

    @property
    def is_part(self) -> bool:
        """Whether it is a part of a command that the executive carries out."""
        return self.links == (BrickLink.DIRECT,) and self.command.moe_inputs_counter is not None


@dataclass(frozen=True, slots=True)
class ExecutiveClaim:
    """A command that the executive carries out.

    Attributes:
        command: the command as announced over the direct link.
        reported: last report of the executive on it.
        wanted: the relay's copy; None until it is received.
    """

    command: Message
    reported: Message | None = None
    wanted: Message | None = None

    @property
    def ended(self) -> bool:
        """Whether the executive's last report is final."""
        return self.reported is not None and is_last(self.reported)


class BrickRecord(Database):
    """Commands by source, number and counter, and the executive's claims and authority.

    Commits survive `kill -9`, and those up to number `durable` (of `sealed`) loss of power.

    Args:
        path: database file; None keeps it in memory.
        system: opens and syncs the file.

    Raises:
        LedgerError: from every method except `sync`, if the file cannot be read or written.
    """

    def __init__(self, path: Path | None = None, system: System = OPERATING_SYSTEM) -> None:
        super().__init__(path, _SCHEMA, connect=system.connect, version=_VERSION)
        for setting in SYNCED_APART:
            self.rows(setting)
        self._system = system
        self.sealed, self.durable = 1, 0  # 1: the commits of earlier processes

    def transact(self, statements: Sequence[tuple[str, tuple[object, ...]]]) -> None:
        """Execute statements in one transaction: all of them or none."""
        super().transact(statements)
        self.sealed += 1

    def sync(self) -> None:
        """Sync all commits, on any thread; raises OSError or sqlite3.Error."""
        sealed = self.sealed
        sync_database(self._system, Path(self.path))
        self.durable = sealed

    def find(self, command: Message) -> BrickCommand | None:
        """Return the command with a message's source, number and counter, or None."""
        return self._select("source = ? AND moe_id = ? AND counter = ?", _key(command))

    def find_first(self, command: Message) -> BrickCommand | None:
        """Return the first command with a message's source and number, or None."""
        return self._select("source = ? AND moe_id = ? ORDER BY number LIMIT 1", _name(command))

    def find_from_relay(self, command: Message) -> BrickCommand | None:
        """Return the relay's command with a message's source and number, or None."""
        where = f"source = ? AND moe_id = ? AND links LIKE '%{BrickLink.RELAY.value}%' LIMIT 1"
        return self._select(where, _name(command))

    def latest(self, count: int) -> Sequence[BrickCommand]:
        """Return the latest commands, in order."""
        rows = self.rows(f"{_SELECT_COMMANDS} ORDER BY number DESC LIMIT ?", (count,))
        return [_command_of_row(row) for row in reversed(rows)]

    def unanswered(self) -> Sequence[BrickCommand]:
        """Return the commands without a final reply of the brick, in order."""
        rows = self.rows(f"{_SELECT_COMMANDS} WHERE NOT ended AND NOT queued ORDER BY number")
        return [_command_of_row(row) for row in rows]

    def waiting(self) -> Sequence[BrickCommand]:
        """Return the queued commands that were not sent to the brick, in order."""
        rows = self.rows(f"{_SELECT_COMMANDS} WHERE NOT ended AND queued ORDER BY number")
        return [_command_of_row(row) for row in rows]

    def save(self, stored: BrickCommand, instead: BrickCommand | None = None) -> None:
        """Record a command, or its last reply, before the brick receives it.

        Args:
            stored: the command.
            instead: a command deleted in the same transaction.
        """
        self._save(
            "INSERT INTO commands (source, moe_id, counter, command, links, reply, ended, queued)"
            " VALUES (?, ?, ?, ?, ?, ?, ?, ?) ON CONFLICT DO UPDATE SET command = excluded.command,"
            " links = excluded.links, reply = excluded.reply, ended = excluded.ended,"
            " queued = excluded.queued",
            (
                *_key(stored.command),
                str(stored.command),
                ",".join(link.value for link in stored.links),
                None if stored.replied is None else str(stored.replied),
                stored.ended,
                stored.waits,
            ),
            "DELETE FROM commands WHERE NOT queued"
            " AND number <= (SELECT max(number) - ? FROM commands)",
            instead,
        )

    def forget(self, stored: BrickCommand) -> None:
        """Delete a command that did not reach the brick."""
        self.transact([(_FORGET, _key(stored.command))])

    def claim(self, command: Message) -> ExecutiveClaim | None:
        """Return the executive's claim on a message's source and number, or None."""
        where = "source = ? AND moe_id = ?"
        query = f"SELECT command, reported, relay_copy FROM claims WHERE {where}"
        rows = self.rows(query, _name(command))
        return _claim(rows[0]) if rows else None

    def claims_with_copy(self, count: int) -> Sequence[ExecutiveClaim]:
        """Return the last claims with a copy of the relay, in order."""
        query = (
            "SELECT command, reported, relay_copy FROM claims WHERE relay_copy IS NOT NULL"
            " ORDER BY number DESC LIMIT ?"
        )
        return [_claim(row) for row in reversed(self.rows(query, (count,)))]

    def unended_claims(self) -> Sequence[ExecutiveClaim]:
        """Return the claims without a final report."""
        query = "SELECT command, reported, relay_copy FROM claims ORDER BY number DESC LIMIT ?"
        rows = self.rows(query, (_MAY_BE_OPEN,))
        return [claim for claim in map(_claim, rows) if not claim.ended]

    def save_claim(self, claim: ExecutiveClaim, instead: BrickCommand | None = None) -> None:
        """Record a claim or its changed state; `instead` as in `save`."""
        texts = (None if each is None else str(each) for each in (claim.reported, claim.wanted))
        self._save(
            "INSERT INTO claims (source, moe_id, command, reported, relay_copy)"
            " VALUES (?, ?, ?, ?, ?) ON CONFLICT DO UPDATE SET command = excluded.command,"
            " reported = excluded.reported, relay_copy = excluded.relay_copy",
            (*_name(claim.command), str(claim.command), *texts),
            "DELETE FROM claims WHERE number <= (SELECT max(number) - ? FROM claims)",
            instead,
        )

    def authority(self) -> Message | None:
        """Return the last authority message of the executive, or None."""
        rows = self.rows("SELECT message FROM authority")
        return _read(rows[0][0]) if rows else None

    def save_authority(self, message: Message) -> None:
        """Record an authority message of the executive."""
        self.transact([("INSERT OR REPLACE INTO authority VALUES (0, ?)", (str(message),))])

    def _select(self, where: str, values: tuple[object, ...]) -> BrickCommand | None:
        rows = self.rows(f"{_SELECT_COMMANDS} WHERE {where}", values)
        return _command_of_row(rows[0]) if rows else None

    def _save(
        self,
        statement: str,
        values: tuple[object, ...],
        prune: str,
        instead: BrickCommand | None,
    ) -> None:
        statements = [(statement, values), (prune, (MAX_COMMANDS,))]
        if instead is not None:
            statements.append((_FORGET, _key(instead.command)))
        self.transact(statements)


def _name(command: Message) -> tuple[str, int]:
    return command.source, _NONE if command.moe_inputs_id is None else command.moe_inputs_id


def _key(command: Message) -> tuple[str, int, int]:
    counter = command.moe_inputs_counter
    return *_name(command), _NONE if counter is None else counter


def _command_of_row(row: tuple[Any, ...]) -> BrickCommand:
    command, links, replied, waits = row
    by = tuple(BrickLink(link) for link in links.split(",") if link)
    return BrickCommand(_read(command), by, _read_any(replied), bool(waits))


def _claim(row: tuple[Any, ...]) -> ExecutiveClaim:
    command, reported, wanted = row
    return ExecutiveClaim(_read(command), _read_any(reported), _read_any(wanted))


def _read(text: str) -> Message:
    return decode(text.encode("ascii"))


def _read_any(text: str | None) -> Message | None:
    return None if text is None else _read(text)
