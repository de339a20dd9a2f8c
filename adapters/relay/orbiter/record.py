"""`RoverRecord`: a rover's commands, reports and telemetry at the orbiter, stored durably.

Its tables are in the ledger's file and are written in its commits. Every method raises
`LedgerError` if the file cannot be read or written.
"""

import asyncio
import sqlite3
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from adapters.bundle import BundleId
from adapters.mops import MAX_SEQUENCE, UNNUMBERED, MopsError
from adapters.relay.orbiter.report_ledger import Loss, ReportLedger
from adapters.system import OPERATING_SYSTEM, System, rewrite_log, sync_database
from executive.commands import Command, Stop
from executive.record import LedgerError
from executive.values.reports import Identity, Report, Stage

_SCHEMA: Final = """
CREATE TABLE IF NOT EXISTS outbox (
    bundle TEXT PRIMARY KEY, source TEXT NOT NULL, command_id INTEGER NOT NULL,
    utc_s REAL NOT NULL
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS uplinked (
    source TEXT NOT NULL, command_id INTEGER NOT NULL, message BLOB,
    until_utc_s REAL NOT NULL, sent_utc_s REAL NOT NULL, ended INTEGER NOT NULL,
    PRIMARY KEY (source, command_id)
) WITHOUT ROWID;
CREATE INDEX IF NOT EXISTS uplinked_open ON uplinked (sent_utc_s) WHERE NOT ended;
CREATE TABLE IF NOT EXISTS ledgers (
    name TEXT PRIMARY KEY, position INTEGER NOT NULL
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS pruned (only_row INTEGER PRIMARY KEY, sequence INTEGER NOT NULL);
CREATE TABLE IF NOT EXISTS received_units (
    unit TEXT PRIMARY KEY, number INTEGER NOT NULL
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS telemetry (
    one INTEGER PRIMARY KEY CHECK (one = 1), utc_s REAL NOT NULL, message BLOB NOT NULL
);
CREATE TABLE IF NOT EXISTS authorities (
    number INTEGER PRIMARY KEY, source TEXT NOT NULL UNIQUE, epoch INTEGER NOT NULL
);
"""
MAX_AUTHORITIES: Final = 100
"""Maximum number of sources with a recorded authority; older ones are deleted."""
_ENDED: Final = 1
_WORKING: Final = (Stage.STARTED.value, Stage.PROGRESS.value)
_WAITING: Final = (Stage.RECEIVED.value, Stage.ACCEPTED.value)
_OPEN: Final = " FROM uplinked a LEFT JOIN stages s USING (source, command_id) WHERE NOT a.ended"
_WAITS: Final = (
    " EXISTS (SELECT 1 FROM outbox u WHERE u.source = a.source AND u.command_id = a.command_id)"
)


@dataclass(frozen=True, slots=True)
class OutstandingCommand:
    """A command whose end is not known.

    Attributes:
        message: the command as uplinked.
        until_utc_s: time until which it may be sent.
    """

    identity: Identity
    message: bytes
    until_utc_s: float


class Outstanding:
    """Commands uplinked to one rover. A message is stored while it may be retransmitted."""

    def __init__(self, ledger: ReportLedger) -> None:
        self._ledger = ledger

    def add(
        self, command: Command, message: bytes, bundle: BundleId, utc_s: float, until_utc_s: float
    ) -> None:
        """Add a command that is in the outbox, in a bundle."""
        key = _key(command.identity)
        self._ledger.record(command)
        self._ledger.write(
            "INSERT OR REPLACE INTO outbox VALUES (?, ?, ?, ?)", (str(bundle), *key, utc_s)
        )
        self._ledger.write(
            "INSERT OR REPLACE INTO uplinked VALUES (?, ?, ?, ?, ?, 0)",
            (*key, message, until_utc_s, utc_s),
        )
        self._ledger.commit()

    def add_done(self, command: Command, utc_s: float, until_utc_s: float) -> None:
        """Add a command executed here, with the next commit, for its lifetime."""
        self._ledger.record(command)
        self._ledger.write(
            "INSERT OR REPLACE INTO uplinked VALUES (?, ?, NULL, ?, ?, ?)",
            (*_key(command.identity), until_utc_s, utc_s, _ENDED),
        )

    def in_outbox(self, bundle: BundleId) -> bool:
        """Return whether a bundle is recorded that has not left the outbox."""
        return bool(self._ledger.rows("SELECT 1 FROM outbox WHERE bundle = ?", (str(bundle),)))

    def note_retransmission(self, identity: Identity, utc_s: float) -> None:
        """Record the retransmission of a command."""
        self._ledger.write(
            "UPDATE uplinked SET sent_utc_s = ? WHERE source = ? AND command_id = ?",
            (utc_s, *_key(identity)),
        )
        self._ledger.commit()

    def note_departure(
        self, bundle: BundleId, utc_s: float, loss: Loss | None = None
    ) -> Identity | None:
        """Record that a bundle has left the outbox; return its command, the first time.

        Args:
            bundle: its identity; it may belong to another rover.
            utc_s: the time.
            loss: why its command may be lost; recorded as a report if it has none yet.
        """
        self._ledger.commit()  # uncommitted rows must be written before they are read
        key = (str(bundle),)
        rows = self._ledger.rows("SELECT source, command_id FROM outbox WHERE bundle = ?", key)
        if not rows:
            return None
        identity = Identity(*rows[0])
        if loss is not None and self._ledger.last_report(identity) is None:
            self._lose(identity, loss, utc_s)
        elif loss is not None:
            self.end(identity)
        self._ledger.write("DELETE FROM outbox WHERE bundle = ?", key)
        self.note_retransmission(identity, utc_s)
        return identity

    def is_retained(self, identity: Identity) -> bool:
        """Return whether a command may be retransmitted."""
        where = "source = ? AND command_id = ? AND message IS NOT NULL AND NOT ended"
        return bool(self._ledger.rows(f"SELECT 1 FROM uplinked WHERE {where}", _key(identity)))

    def cancel_retransmissions(self) -> None:
        """Cancel all retransmissions: a stop ends all commands sent before it."""
        self._ledger.write("UPDATE uplinked SET message = NULL WHERE message IS NOT NULL", ())
        self._ledger.commit()

    def outbox_empty(self, utc_s: float) -> None:
        """Record that the outbox is empty."""
        if self.earliest_utc_s() is None:
            return
        self._ledger.write(f"UPDATE uplinked AS a SET sent_utc_s = ? WHERE {_WAITS}", (utc_s,))
        self._ledger.write("DELETE FROM outbox", ())
        self._ledger.commit()

    def earliest_utc_s(self) -> float | None:
        """Return the time of the first command that is still in the outbox, or None."""
        ((earliest_utc_s,),) = self._ledger.rows("SELECT min(utc_s) FROM outbox")
        return None if earliest_utc_s is None else float(earliest_utc_s)

    def end(self, identity: Identity) -> None:
        """Expect no further reports on a command, from the next commit on."""
        self._ledger.write(
            "UPDATE uplinked SET message = NULL, ended = ? WHERE source = ? AND command_id = ?",
            (_ENDED, *_key(identity)),
        )

    def end_started(self, utc_s: float) -> None:
        """Report started commands as lost, with the next commit.

        Other commands that have left the outbox are not retransmitted: they may have been executed.
        """
        rows = self._ledger.rows(
            f"SELECT a.source, a.command_id{_OPEN} AND s.stage IS NOT NULL AND NOT {_WAITS}"
        )
        for key in rows:
            self._lose(Identity(*key), Loss.LEDGER_REPLACED, utc_s)
        self._ledger.write(f"UPDATE uplinked AS a SET message = NULL WHERE NOT {_WAITS}", ())

    def end_unreported(self, until_utc_s: float, utc_s: float) -> None:
        """Report commands without any report in their lifetime as lost, and expect none.

        Args:
            until_utc_s: latest end of the lifetime of these commands.
            utc_s: the time.
        """
        rows = self._ledger.rows(
            f"SELECT a.source, a.command_id{_OPEN} AND s.stage IS NULL AND NOT {_WAITS}"
            " AND a.until_utc_s <= ?",
            (until_utc_s,),
        )
        for key in rows:
            self._lose(Identity(*key), Loss.UNREPORTED, utc_s)
        self._ledger.commit()

    def _lose(self, identity: Identity, loss: Loss, utc_s: float) -> None:
        self.end(identity)
        self._ledger.append_report(loss.report(identity, utc_s))

    def unanswered(
        self, requested_before_utc_s: float, utc_s: float, begun: bool, maximum: int
    ) -> Sequence[OutstandingCommand]:
        """Return commands to retransmit, in descending order of their wait.

        Stops are excluded: a stop would end commands started since.

        Args:
            requested_before_utc_s: only commands last sent before this time, or after `utc_s`, if
                the clock was set back.
            utc_s: the time; expired commands are excluded.
            begun: include commands that have reports.
            maximum: maximum number of commands.
        """
        rows = self._ledger.rows(
            f"SELECT a.source, a.command_id, a.message, a.until_utc_s{_OPEN}"
            " AND a.message IS NOT NULL AND a.sent_utc_s NOT BETWEEN ? AND ? AND a.until_utc_s > ?"
            " AND (? OR s.stage IS NULL)"
            f" AND NOT {_WAITS} AND NOT EXISTS (SELECT 1 FROM commands c WHERE c.source = a.source"
            " AND c.command_id = a.command_id AND c.name = ?) ORDER BY a.sent_utc_s LIMIT ?",
            (requested_before_utc_s, utc_s, utc_s, begun, Stop.__name__, maximum),
        )
        return [
            OutstandingCommand(Identity(*row[:2]), bytes(row[2]), float(row[3])) for row in rows
        ]

    def active(self) -> int | None:
        """Return the number of the command that the rover executes, as far as is known."""
        rows = self._ledger.rows(f"SELECT a.command_id{_OPEN} AND s.stage IN (?, ?)", _WORKING)
        return int(rows[0][0]) if rows else None

    def queued(self) -> int:
        """Return the number of uplinked commands that the rover has not started."""
        ((count,),) = self._ledger.rows(
            f"SELECT count(*){_OPEN} AND (s.stage IS NULL OR s.stage IN (?, ?))", _WAITING
        )
        return int(count)


LEDGER_STRIDE: Final = MAX_SEQUENCE + 1
"""Distance between the first numbers of successive ledgers."""
MAX_LEDGERS: Final = 1000
"""Maximum number of ledgers of one rover; a report that names one more is refused."""


class Ledgers:
    """Ledgers that a rover has had, by the names in its reports, in order of appearance.

    Reports of the first ledger have the rover's numbers; those of later ones begin at multiples of
    `LEDGER_STRIDE`, plus 1. So numbers only increase with a new ledger, and reports of the old one
    that arrive late have numbers of their own.
    """

    def __init__(self, ledger: ReportLedger) -> None:
        self._ledger = ledger
        rows = ledger.rows("SELECT name, position FROM ledgers ORDER BY position")
        self._indexes = {str(name): int(index) for name, index in rows}

    def new(self, name: str) -> bool:
        """Return whether a name is that of a ledger that follows another.

        Raises:
            MopsError: the rover has the maximum number of ledgers.
        """
        if not name or name in self._indexes:
            return False
        if len(self._indexes) >= MAX_LEDGERS:
            raise MopsError(f"ledger: {name} is number {MAX_LEDGERS + 1} of the rover")
        return bool(self._indexes)

    def number(self, name: str, sequence: int) -> int:
        """Return the number of a report here; record its ledger with the next commit.

        Args:
            name: name of the ledger; empty for the newest.
            sequence: number of the report in it.
        """
        if name and name not in self._indexes:
            self._indexes[name] = len(self._indexes)
            self._ledger.write("INSERT INTO ledgers VALUES (?, ?)", (name, self._indexes[name]))
        index = self._indexes[name] if name else max(self._indexes.values(), default=0)
        return index * LEDGER_STRIDE + sequence


_OF_COMMAND: Final = "{0}.source = c.source AND {0}.command_id = c.command_id"
_COMMANDS: Final = (
    "DELETE FROM commands AS c WHERE"
    " coalesce((SELECT max(cursor) FROM reports r JOIN recorded ON number = sequence"
    f"  WHERE {_OF_COMMAND.format('r')}), 0) <= ?"
    f" AND NOT EXISTS (SELECT 1 FROM uplinked a WHERE {_OF_COMMAND.format('a')}"
    "  AND (a.until_utc_s > ? OR NOT a.ended AND EXISTS"
    f"   (SELECT 1 FROM stages s WHERE {_OF_COMMAND.format('s')})))"
    " AND NOT (c.source = ? AND c.command_id = ?)"
)
_REPORTS: Final = (
    "DELETE FROM reports AS r WHERE sequence IN (SELECT number FROM recorded WHERE cursor <= ?)"
    f" AND NOT EXISTS (SELECT 1 FROM commands c WHERE {_OF_COMMAND.format('r')})"
)
_LEFTOVERS: Final = (
    *(
        f"DELETE FROM {table} AS t"
        f" WHERE NOT EXISTS (SELECT 1 FROM commands c WHERE {_OF_COMMAND.format('t')})"
        for table in ("stages", "uplinked")
    ),
    *(
        f"DELETE FROM {table} AS t"
        " WHERE NOT EXISTS (SELECT 1 FROM reports r WHERE r.sequence = t.number)"
        for table in ("received_units", "recorded")
    ),
)


_SLACK: Final = 20
"""The record is pruned when it exceeds its limit by this fraction, 1 / `_SLACK`."""


class RecordRetention:
    """Prunes the reports above a maximum number, and commands without reports.

    Open commands are retained, and those that may be repeated: a command is known for its whole
    lifetime. So the maximum may be exceeded for a time. An active stop is retained, too.

    Args:
        maximum: maximum number of reports.
        stopped_by: returns the active stop.
    """

    def __init__(
        self, ledger: ReportLedger, maximum: int, stopped_by: Callable[[], Identity | None]
    ) -> None:
        self._ledger, self._max_reports, self._stopped_by = ledger, maximum, stopped_by
        rows = ledger.rows("SELECT sequence FROM pruned")
        self._border = int(rows[0][0]) if rows else 0
        self._pruned_to = 0

    def was_pruned(self, number: int) -> bool:
        """Return whether a number may be that of a pruned report."""
        return 0 < number <= self._border

    def prune(self, utc_s: float) -> None:
        """Prune the excess above the limit once it is large enough."""
        cursor = self._cursor_before(self._max_reports)
        if cursor > self._pruned_to and self._cursor_before(
            self._max_reports + self._max_reports // _SLACK
        ):
            self._forget(cursor, utc_s)

    def _forget(self, cursor: int, utc_s: float) -> None:
        stop = self._stopped_by()
        stop_key = ("", 0) if stop is None else _key(stop)
        maximum = "SELECT max(number) FROM recorded WHERE cursor <= ?"
        ((number,),) = self._ledger.rows(maximum, (cursor,))
        self._ledger.write(_COMMANDS, (cursor, utc_s, *stop_key))
        self._ledger.write(_REPORTS, (cursor,))
        for statement in _LEFTOVERS:
            self._ledger.write(statement, ())
        border = max(self._border, number)
        self._ledger.write("INSERT OR REPLACE INTO pruned VALUES (0, ?)", (border,))
        self._ledger.commit()
        self._border, self._pruned_to = border, cursor

    def _cursor_before(self, count: int) -> int:
        """Return the cursor before the last `count` reports; 0 if there are fewer."""
        rows = self._ledger.rows(
            "SELECT cursor FROM recorded ORDER BY cursor DESC LIMIT 1 OFFSET ?", (count,)
        )
        return int(rows[0][0]) if rows else 0


MAX_REPORTS: Final = 100_000


class RoverRecord:
    """Commands uplinked to a rover, its reports, and its last telemetry.

    Commands and reports are stored as on the rover, in a separate ledger. Results of a method that
    has returned survive `kill -9`, and loss of power after `durable`.

    Args:
        path: the file; it and its folders are created if missing.
        numbered: whether the rover numbers its reports; otherwise they are numbered here.
        max_reports: maximum number of reports.
        system: the disk.

    Attributes:
        ledger: commands and reports.
        outstanding: state of the commands.
        ledgers: ledgers that number the rover's reports.
    """

    def __init__(
        self,
        path: Path,
        numbered: bool = True,
        max_reports: int = MAX_REPORTS,
        system: System = OPERATING_SYSTEM,
    ) -> None:
        self._numbered = numbered
        self._system = system
        self.ledger = ReportLedger(path, _SCHEMA, system.connect)
        self._sync()  # writes of a killed process may not be on the disk yet
        self._synced, self._syncing = self.ledger.state.durable, asyncio.Lock()
        self.outstanding, self.ledgers = Outstanding(self.ledger), Ledgers(self.ledger)
        self._history = RecordRetention(self.ledger, max_reports, self.active_stop)

    def close(self) -> None:
        """Close the file."""
        self.ledger.close()

    async def durable(self) -> None:
        """Return once everything recorded before survives loss of power; a thread waits for it.

        Raises:
            LedgerError: it may not survive it.
        """
        wanted = self.ledger.sealed
        async with self._syncing:
            if self._synced >= wanted:
                return
            committed = self.ledger.state.durable
            try:
                await asyncio.to_thread(self._sync)
            except LedgerError:
                rewrite_log(Path(self.ledger.path))
                raise
            self._synced = committed

    def _sync(self) -> None:
        try:
            sync_database(self._system, Path(self.ledger.path))
        except (OSError, sqlite3.Error) as error:
            raise LedgerError(f"ledger {self.ledger.path}: {error}") from error

    def add_report(self, report: Report, unit: str, ledger: str = "") -> bool:
        """Record a report; return whether it is new.

        A refusal by a rover that numbers its reports may have no number: it never reached the
        rover's ledger. A report without a number that repeats an earlier one is not new.

        Args:
            report: the report.
            unit: bundle and index of its message; identifies a repetition of a report without
                a number.
            ledger: name of the rover's ledger that numbered it.
        """
        if self.ledger.failing:
            self.ledger.commit()
        if report.sequence != UNNUMBERED:
            number = self.ledgers.number(ledger, report.sequence)
            if self._has(number) or self._is_forgotten(report, number):
                return False
            report = replace(report, sequence=number)
        else:
            if self._is_known(unit) or self._is_repeated(report):
                return False
            if not self._numbered:
                report = replace(report, sequence=self.ledger.last_sequence + 1)
        self._store(report, unit)
        return True

    def contradicts(self, report: Report, ledger: str) -> bool:
        """Return whether a different report with the same number was recorded before."""
        if report.sequence == UNNUMBERED:
            return False
        number = self.ledgers.number(ledger, report.sequence)
        known = self.ledger.reports(number, count=1)
        if not known or known[0].sequence != number:
            return False
        return known[0] != replace(report, sequence=number, utc_s=known[0].utc_s)

    def active_stop(self) -> Identity | None:
        """Return the active stop; None for a brick, which has no stop latch."""
        return self.ledger.last_stop() if self._numbered else None

    def prune(self, utc_s: float) -> None:
        """Prune the excess above the limits."""
        self._history.prune(utc_s)

    def _has(self, number: int) -> bool:
        return bool(self.ledger.rows("SELECT 1 FROM reports WHERE sequence = ?", (number,)))

    def _is_forgotten(self, report: Report, number: int) -> bool:
        """Return whether a report may have been pruned; never true for a known command."""
        identity = report.identity
        known = identity is not None and self.ledger.digest_of(identity) is not None
        return self._history.was_pruned(number) and not known

    def _is_known(self, unit: str) -> bool:
        return bool(self.ledger.rows("SELECT 1 FROM received_units WHERE unit = ?", (unit,)))

    def _is_repeated(self, report: Report) -> bool:
        identity = report.identity
        if identity is None or report.stage is None:
            return False
        rows = self.ledger.rows(
            "SELECT 1 FROM reports WHERE source = ? AND command_id = ? AND stage = ? AND text = ?"
            " AND reason IS ? AND step IS ?",
            (
                *_key(identity),
                report.stage.value,
                report.text,
                report.reason.value if report.reason else None,
                report.step,
            ),
        )
        return bool(rows)

    def _store(self, report: Report, unit: str) -> None:
        """Record a report and its consequences in one commit."""
        identity, stage = report.identity, report.stage
        if identity is not None and stage is not None and self._is_new(report, identity):
            self.ledger.set_stage(identity, stage)
            if stage.terminal:
                self.outstanding.end(identity)
        self.ledger.append_report(report)
        if not self._numbered or report.sequence == UNNUMBERED:
            newest = "SELECT ?, number FROM recorded ORDER BY cursor DESC LIMIT 1"
            self.ledger.write(f"INSERT INTO received_units {newest}", (unit,))
        self.ledger.commit()

    def _is_new(self, report: Report, identity: Identity) -> bool:
        """Return whether a report is the newest; without numbers none follows a terminal stage."""
        rows = self.ledger.rows(
            "SELECT sequence, stage FROM reports WHERE source = ? AND command_id = ?"
            " AND stage IS NOT NULL ORDER BY sequence DESC LIMIT 1",
            _key(identity),
        )
        return all(
            sequence < report.sequence if self._numbered else not Stage(stage).terminal
            for sequence, stage in rows
        )

    def add_telemetry(self, message: bytes, utc_s: float) -> None:
        """Record telemetry, unless newer telemetry was received before."""
        self.ledger.write(
            "INSERT INTO telemetry VALUES (1, ?, ?) ON CONFLICT DO UPDATE SET"
            " utc_s = excluded.utc_s, message = excluded.message WHERE utc_s <= excluded.utc_s",
            (utc_s, message),
        )
        self.ledger.commit()

    def set_authority(self, epoch: int | None, source: str) -> None:
        """Record the authority epoch that a source gave the orbiter; None removes it.

        The commands of that source are uplinked under it. Other sources are not affected.
        """
        self.ledger.write("DELETE FROM authorities WHERE source = ?", (source,))
        if epoch is not None:
            values = (source, epoch)
            self.ledger.write("INSERT INTO authorities (source, epoch) VALUES (?, ?)", values)
            age_text = (
                "DELETE FROM authorities WHERE number <= (SELECT max(number) - ? FROM authorities)"
            )
            self.ledger.write(age_text, (MAX_AUTHORITIES,))
        self.ledger.commit()

    def authority(self, source: str) -> int | None:
        """Return the epoch that applies to the commands of a source."""
        rows = self.ledger.rows("SELECT epoch FROM authorities WHERE source = ?", (source,))
        return int(rows[0][0]) if rows else None

    def last_telemetry(self) -> tuple[float, bytes] | None:
        """Return the last telemetry with its creation time, or None."""
        rows = self.ledger.rows("SELECT utc_s, message FROM telemetry")
        return (float(rows[0][0]), bytes(rows[0][1])) if rows else None


def _key(identity: Identity) -> tuple[str, int]:
    return identity.source, identity.command_id
