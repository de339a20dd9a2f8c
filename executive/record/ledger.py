"""`Ledger`: the durable record of commands and reports, for deduplication and after a restart."""

import hashlib
import json
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final, get_args

from cattrs.preconf.json import make_converter

from executive.commands import Command, Request, Resume, Setting, Stop
from executive.faults import Reaction
from executive.record.database import (
    Connect,
    Database,
    LedgerError,
    Synchronous,
    connect_to_file,
)
from executive.record.stop_latch import LatchChange
from executive.record.writer import Batch, BatchWriter, InlineWriter, ThreadWriter, WriterState
from executive.values.reasons import Figure, Reason, Refusal
from executive.values.reports import TERMINAL, Identity, Report, ReportKind, Severity, Stage

_SCHEMA = """
CREATE TABLE IF NOT EXISTS commands (
    source TEXT NOT NULL, command_id INTEGER NOT NULL, digest BLOB NOT NULL,
    name TEXT NOT NULL, request TEXT NOT NULL, link TEXT NOT NULL,
    PRIMARY KEY (source, command_id)
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS stages (
    source TEXT NOT NULL, command_id INTEGER NOT NULL, stage INTEGER NOT NULL,
    PRIMARY KEY (source, command_id)
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS reports (
    sequence INTEGER PRIMARY KEY, utc_s REAL NOT NULL, kind INTEGER NOT NULL,
    severity INTEGER NOT NULL, text TEXT NOT NULL, source TEXT, command_id INTEGER,
    stage INTEGER, link TEXT, step INTEGER, step_count INTEGER, reason INTEGER,
    figures TEXT NOT NULL, fault TEXT, cause_source TEXT, cause_command_id INTEGER,
    publishers TEXT
);
CREATE INDEX IF NOT EXISTS reports_by_command ON reports (command_id, source, sequence);
CREATE TABLE IF NOT EXISTS foreign_reports (sequence INTEGER PRIMARY KEY);
CREATE TABLE IF NOT EXISTS used (
    source TEXT NOT NULL, first INTEGER NOT NULL, last INTEGER NOT NULL,
    PRIMARY KEY (source, first)
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS remembered (
    name TEXT PRIMARY KEY, sequence INTEGER NOT NULL, source TEXT NOT NULL,
    command_id INTEGER NOT NULL, request TEXT NOT NULL
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS latched_faults (name TEXT PRIMARY KEY, fault TEXT NOT NULL);
"""
PRUNED: Final = b""
"""Placeholder for the digest of a command that `Retention` has pruned."""
MAX_RETAINED_REQUEST_OCTETS: Final = 16_384
"""Maximum octets of a request retained after its command has ended."""
MAX_REFUSED_REQUEST_OCTETS: Final = 256
"""Maximum octets of a refused request that is retained; chosen, not measured."""

TERMINAL_STAGES: Final = ",".join(str(stage.value) for stage in TERMINAL)
"""The numbers of terminal stages, as a list for SQL."""
STOP_AND_RESUME: Final = (Stop.__name__, Resume.__name__)
SETTINGS: Final = tuple(kind.__name__ for kind in get_args(Setting))
_REPORT_COLUMNS: Final = 17
LEDGER_VERSION: Final = 1
"""Version of the tables; it rises with each change of them."""
OnPrune = Callable[[Identity, Stage], None]

_CONVERTER = make_converter()


_REQUESTS: Final = {kind.__name__: kind for kind in get_args(Request)}


@dataclass(frozen=True, slots=True)
class LatchedFault:
    """A fault that only a resume ends.

    Attributes:
        reaction: reaction until then.
        begun_utc_s: begin of the fault, seconds since 1970-01-01 UTC.
    """

    name: str
    reaction: Reaction
    refusal: Refusal
    begun_utc_s: float


def digest(command: Command) -> bytes:
    """Return a digest of request and precondition, independent of link and time."""
    content = [type(command.request).__name__, _CONVERTER.unstructure(command.request)]
    if command.precondition is not None and not isinstance(command.request, Stop):
        content.append(command.precondition.wire_values)
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).digest()


@dataclass(slots=True)
class _Unwritten:
    """Data of a command that are not committed yet.

    Attributes:
        batch: number of the last batch with such data.
        digest: digest of the command; None if that is committed.
        last_report: its last report; None if that is committed.
    """

    batch: int = 0
    digest: bytes | None = None
    last_report: Report | None = None


class Ledger(Database):
    """Commands with their present stage, and every report; used by the core's thread only.

    Writes gather until `seal` hands them over to the writer as a batch. Digest and last report of
    a command are known before they are committed; all other queries return committed data.

    Args:
        path: the file, created with its folders if missing.
        synchronous: durability of a commit.
        connect: opens the file.
        version: as in `Database`.

    Attributes:
        writer: commits the batches.
        sealed: number of the last batch; 0 before the first.
        state: state of the writer at the last `poll`.

    Raises:
        LedgerError: from every method, if the file cannot be read or written.
    """

    def __init__(
        self,
        path: Path,
        synchronous: Synchronous = Synchronous.FULL,
        connect: Connect = connect_to_file,
        version: int = LEDGER_VERSION,
    ) -> None:
        super().__init__(path, _SCHEMA, synchronous, connect, version)
        # A commit that was not synced before a restart can be read, but is only in memory of the
        # operating system: it is copied and synced before it counts. On a full disk it stays so.
        with suppress(LedgerError):
            self.rows("PRAGMA wal_checkpoint")
        self._connection = partial(Database, path, "", synchronous, connect, version)
        self.writer: BatchWriter = InlineWriter(self)
        self.sealed = 0
        self.state = WriterState()
        self._unwritten: dict[Identity, _Unwritten] = {}
        self._on_prune: list[OnPrune] = []
        ((last,),) = self.rows("SELECT max(sequence) FROM reports")
        self.last_sequence: int = last or 0

    def digest_of(self, identity: Identity) -> bytes | None:
        """Return the digest of the command with this identity, if any.

        For a number that is only recorded as used, that is `PRUNED`.
        """
        known = self._unwritten.get(identity)
        if known is not None and known.digest is not None:
            return known.digest
        source, number = identity.source, identity.command_id
        rows = self.rows(
            "SELECT digest FROM commands WHERE source = ? AND command_id = ? UNION ALL"
            " SELECT x'' FROM (SELECT last FROM used WHERE source = ? AND first <= ?"
            " ORDER BY first DESC LIMIT 1) WHERE last >= ?",
            (source, number, source, number, number),
        )
        return rows[0][0] if rows else None

    def request(self, identity: Identity) -> Request | None:
        """Return the request of a committed command, if it is known and retained."""
        rows = self.rows(
            "SELECT name, request FROM commands WHERE source = ? AND command_id = ?",
            (identity.source, identity.command_id),
        )
        return _request_of(*rows[0]) if rows and rows[0][1] else None

    def record(self, command: Command) -> None:
        """Add a command to the next commit."""
        request = json.dumps(_CONVERTER.unstructure(command.request))
        identity, kind = command.identity, type(command.request).__name__
        mark = digest(command)
        self.write(
            "INSERT INTO commands VALUES (?, ?, ?, ?, ?, ?)",
            (identity.source, identity.command_id, mark, kind, request, command.link),
        )
        self._note(identity).digest = mark

    def set_stage(self, identity: Identity, stage: Stage) -> None:
        """Add the stage of a command to the next commit; a terminal stage drops a long request."""
        key = (identity.source, identity.command_id)
        self.write("INSERT OR REPLACE INTO stages VALUES (?, ?, ?)", (*key, stage.value))
        if stage in TERMINAL:
            is_refused = stage is Stage.REJECTED
            maximum = MAX_REFUSED_REQUEST_OCTETS if is_refused else MAX_RETAINED_REQUEST_OCTETS
            self.write(
                "UPDATE commands SET request = '' WHERE source = ? AND command_id = ?"
                " AND length(request) > ?",
                (*key, maximum),
            )

    def append_report(self, report: Report, foreign: bool = False) -> None:
        """Add a report to the next commit; foreign are reports that external senders can flood."""
        self.write(
            f"INSERT INTO reports VALUES ({', '.join('?' * _REPORT_COLUMNS)})", _row_of(report)
        )
        if foreign:
            self.write("INSERT INTO foreign_reports VALUES (?)", (report.sequence,))
        self.last_sequence = report.sequence
        if report.identity is not None and report.stage is not None:
            self._note(report.identity).last_report = report

    def add_tables(self, schema: str, on_prune: OnPrune | None = None) -> None:
        """Create further tables for a separate store, written in the same commits.

        Args:
            schema: creates the tables if missing.
            on_prune: called with each command that is about to be pruned and its terminal stage;
                updates the rows that belong to it.
        """
        self.make_tables(schema)
        if on_prune is not None:
            self._on_prune.append(on_prune)

    def prune(self, identity: Identity, stage: Stage) -> None:
        """Delete a command in this terminal stage; the caller records that its number was used."""
        for on_prune in self._on_prune:
            on_prune(identity, stage)
        for table in ("commands", "stages"):
            self.write(
                f"DELETE FROM {table} WHERE source = ? AND command_id = ?",
                (identity.source, identity.command_id),
            )

    @property
    def last_batch(self) -> int:
        """Number of the batch with the last write."""
        return self.sealed + bool(self._pending)

    @property
    def unwritten_batches(self) -> int:
        """Number of batches that are not committed yet."""
        return self.sealed - self.state.durable

    @property
    def settled(self) -> bool:
        """Whether everything that was written is committed."""
        return not self._pending and not self.unwritten_batches

    @property
    def failing(self) -> bool:
        """Whether the last attempt to commit failed; the writer tries again."""
        return self.state.error is not None

    def seal(self, latch: LatchChange | None = None) -> None:
        """Hand the pending writes, and a change of the stop latch, over to the writer."""
        if self._pending or latch is not None:
            self.sealed += 1
            self.writer.put(Batch(self.sealed, tuple(self._pending), latch))
            self._pending.clear()

    def write_on_thread(self, wake: Callable[[], None]) -> None:
        """Commit on a thread of its own from now on, so that nothing waits for the disk.

        Args:
            wake: called on that thread when a state of the writer is to be polled; must be quick.
        """
        self.commit()
        self.writer = ThreadWriter(self._connection, self.sealed, wake)

    def poll(self) -> WriterState:
        """Update and return `state`."""
        before, self.state = self.state, self.writer.poll()
        if self.state.durable > before.durable:
            durable = self.state.durable
            self._unwritten = {i: e for i, e in self._unwritten.items() if e.batch > durable}
        return self.state

    def commit(self) -> None:
        """Hand the pending writes over to the writer; raise its error, if any."""
        self.seal()
        if (error := self.poll().error) is not None:
            raise error

    def close(self) -> None:
        """Commit pending writes and close the file."""
        self.seal()
        self.writer.close()
        super().close()

    def abandon(self) -> None:
        """Close the file as a crash would: uncommitted batches are lost."""
        self.writer.abandon()
        super().abandon()

    def _note(self, identity: Identity) -> "_Unwritten":
        """Return the note on the command of the last write."""
        note = self._unwritten.setdefault(identity, _Unwritten())
        note.batch = self.last_batch
        return note

    def last_command_id(self, source: str) -> int:
        """Return the maximum number of a source's commands, or 0."""
        rows = self.rows(
            "SELECT max(number) FROM (SELECT max(command_id) AS number FROM commands"
            " WHERE source = ? UNION ALL SELECT max(last) FROM used WHERE source = ?)",
            (source, source),
        )
        unwritten = (known.command_id for known in self._unwritten if known.source == source)
        return max(rows[0][0] or 0, *unwritten, 0)

    def unfinished(self) -> Sequence[tuple[Command, Stage]]:
        """Return commands before a terminal stage, in order of arrival."""
        rows = self.rows(
            "SELECT source, command_id, name, request, link, stage,"
            " (SELECT min(sequence) FROM reports r WHERE r.source = c.source"
            "  AND r.command_id = c.command_id) AS first"
            " FROM commands c JOIN stages USING (source, command_id)"
            f" WHERE stage NOT IN ({TERMINAL_STAGES}) ORDER BY first"
        )
        return [
            (Command(Identity(source, number), _request_of(name, request), link), Stage(stage))
            for source, number, name, request, link, stage, _ in rows
        ]

    def last_stop(self) -> Identity | None:
        """Return the last accepted stop, unless a resume was accepted after it."""
        rows = self.rows(
            "SELECT c.source, c.command_id, c.name, r.sequence"
            " FROM commands c CROSS JOIN reports r"
            " ON r.command_id = c.command_id AND r.source = c.source AND r.stage = ?"
            " WHERE c.name IN (?, ?) UNION ALL"
            " SELECT source, command_id, name, sequence FROM remembered WHERE name IN (?, ?)"
            " ORDER BY sequence DESC LIMIT 1",
            (Stage.ACCEPTED.value, *STOP_AND_RESUME, *STOP_AND_RESUME),
        )
        return next((Identity(*row[:2]) for row in rows if row[2] == Stop.__name__), None)

    def last_settings(self) -> Sequence[Setting]:
        """Return the last executed setting of each kind, in order."""
        marks = ", ".join("?" * len(SETTINGS))
        rows = self.rows(
            "SELECT name, request, max(sequence) AS last FROM ("
            "SELECT c.name, c.request, r.sequence FROM commands c CROSS JOIN reports r"
            " ON r.command_id = c.command_id AND r.source = c.source AND r.stage = ?"
            f" WHERE c.name IN ({marks}) UNION ALL"
            f" SELECT name, request, sequence FROM remembered WHERE name IN ({marks})"
            ") GROUP BY name ORDER BY last",
            (Stage.EXECUTED.value, *SETTINGS, *SETTINGS),
        )
        return [_request_of(name, request) for name, request, _ in rows]  # type: ignore[misc]

    def latch(self, fault: LatchedFault) -> None:
        """Store a fault in the next commit, with its report, until `unlatch`."""
        text = json.dumps(_CONVERTER.unstructure(fault))
        self.write("INSERT OR REPLACE INTO latched_faults VALUES (?, ?)", (fault.name, text))

    def unlatch(self, name: str) -> None:
        """Delete a fault with the next commit."""
        self.write("DELETE FROM latched_faults WHERE name = ?", (name,))

    def latched_faults(self) -> Sequence[LatchedFault]:
        """Return the committed faults that have not ended, oldest first."""
        rows = self.rows("SELECT fault FROM latched_faults ORDER BY rowid")
        return [_CONVERTER.loads(text, LatchedFault) for (text,) in rows]

    def last_report(self, identity: Identity) -> Report | None:
        """Return the last life cycle report of a command."""
        known = self._unwritten.get(identity)
        if known is not None and known.last_report is not None:
            return known.last_report
        found = self._select(
            "WHERE source = ? AND command_id = ? AND stage IS NOT NULL"
            " ORDER BY sequence DESC LIMIT 1",
            (identity.source, identity.command_id),
        )
        return found[0] if found else None

    def reports(
        self, since: int = 1, command_id: int | None = None, count: int = 1000
    ) -> Sequence[Report]:
        """Return committed reports from a sequence number on, oldest first.

        Args:
            since: the first sequence number.
            command_id: only reports on commands of this number, from any source.
            count: maximum number of reports.
        """
        if command_id is None:
            return self._select("WHERE sequence >= ? ORDER BY sequence LIMIT ?", (since, count))
        return self._select(
            "WHERE sequence >= ? AND command_id = ? ORDER BY sequence LIMIT ?",
            (since, command_id, count),
        )

    def _select(self, where: str, values: tuple[object, ...]) -> list[Report]:
        return [_report_of(row) for row in self.rows(f"SELECT * FROM reports {where}", values)]


def _row_of(report: Report) -> tuple[object, ...]:
    """Convert a report to a row of the table `reports`."""
    identity, cause = report.identity, report.cause
    return (
        report.sequence,
        report.utc_s,
        report.kind.value,
        report.severity.value,
        report.text,
        identity.source if identity else None,
        identity.command_id if identity else None,
        report.stage.value if report.stage else None,
        report.link,
        report.step,
        report.step_count,
        report.reason.value if report.reason else None,
        json.dumps([[f.name, f.value, f.unit] for f in report.figures]),
        report.fault,
        cause.source if cause else None,
        cause.command_id if cause else None,
        None if report.publishers is None else json.dumps(report.publishers),
    )


def _report_of(row: tuple[Any, ...]) -> Report:
    """Convert a row of the table `reports` to a report."""
    (
        sequence, utc_s, kind, severity, text, source, command_id,
        stage, link, step, step_count, reason, figures,
        fault, cause_source, cause_id, publishers,
    ) = row  # fmt: skip
    return Report(
        sequence=sequence,
        utc_s=utc_s,
        kind=ReportKind(kind),
        severity=Severity(severity),
        text=text,
        identity=None if source is None else Identity(source, command_id),
        stage=None if stage is None else Stage(stage),
        link=link,
        step=step,
        step_count=step_count,
        reason=None if reason is None else Reason(reason),
        figures=tuple(Figure(*figure) for figure in json.loads(figures)),
        fault=fault,
        cause=None if cause_source is None else Identity(cause_source, cause_id),
        publishers=None if publishers is None else tuple(json.loads(publishers)),
    )


def _request_of(name: str, text: str) -> Request:
    """Return a request from its stored form."""
    request: Request = _CONVERTER.structure(json.loads(text), _REQUESTS[name])
    return request
