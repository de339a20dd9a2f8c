"""What the orbiter knows of one rover and must still know after a restart."""

from dataclasses import replace
from pathlib import Path
from typing import Final

from adapters.bundle.identity import BundleId
from adapters.mops.reports import UNNUMBERED
from executive.commands import Command, Identity, Resume, Stop
from executive.ledger import Ledger
from executive.reports import Report, Stage

_SCHEMA: Final = """
CREATE TABLE IF NOT EXISTS underway (
    bundle TEXT PRIMARY KEY, source TEXT NOT NULL, command_id INTEGER NOT NULL,
    utc_s REAL NOT NULL
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS came (unit TEXT PRIMARY KEY) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS telemetry (
    one INTEGER PRIMARY KEY CHECK (one = 1), utc_s REAL NOT NULL, message BLOB NOT NULL
);
"""
_WORKING: Final = (Stage.STARTED, Stage.PROGRESS)
_WAITING: Final = (Stage.RECEIVED, Stage.ACCEPTED)


class Record:
    """The commands that went to a rover, its reports as it numbered them, and its last telemetry.

    Commands and reports are kept as aboard, in a ledger of their own. What a method returned from
    survives `kill -9`.

    Args:
        path: the file, made with its folders if missing.
        numbered: whether the rover numbers its reports; else they are numbered here.

    Attributes:
        ledger: the commands and the reports.

    Raises:
        LedgerError: from every method, if the file cannot be read or written.
    """

    def __init__(self, path: Path, numbered: bool = True) -> None:
        """Open or make the file."""
        self._numbered = numbered
        self.ledger = Ledger(path)
        self.ledger.extend(_SCHEMA)

    def close(self) -> None:
        """Close the file."""
        self.ledger.close()

    def sent(self, command: Command, bundle: BundleId, utc_s: float) -> None:
        """Remember that a command is in the outbox, in a bundle."""
        identity = command.identity
        self.ledger.record(command)
        self.ledger.write(
            "INSERT OR REPLACE INTO underway VALUES (?, ?, ?, ?)",
            (str(bundle), identity.source, identity.command_id, utc_s),
        )
        self.ledger.commit()

    def left(self, bundle: BundleId) -> Identity | None:
        """Remember that a bundle has left the outbox; return the command in it, the first time."""
        key = (str(bundle),)
        rows = self.ledger.rows("SELECT source, command_id FROM underway WHERE bundle = ?", key)
        if not rows:
            return None
        self.ledger.write("DELETE FROM underway WHERE bundle = ?", key)
        self.ledger.commit()
        return Identity(*rows[0])

    def all_left(self) -> None:
        """Remember that the outbox is empty."""
        if self.oldest_utc_s() is not None:
            self.ledger.write("DELETE FROM underway", ())
            self.ledger.commit()

    def oldest_utc_s(self) -> float | None:
        """Return since when the oldest command has been in the outbox; None if none is there."""
        ((oldest_utc_s,),) = self.ledger.rows("SELECT min(utc_s) FROM underway")
        return None if oldest_utc_s is None else float(oldest_utc_s)

    def came(self, report: Report, unit: str) -> Report | None:
        """Remember a report; return it as it is to be told, or None if it was told before.

        A refusal by a rover that numbers its reports may have no number, for nothing was taken in:
        it is kept below 0, and has no place among the others.

        Args:
            report: what the rover says.
            unit: which message of which bundle it is, by which one without a number is known when
                it comes again after a crash.
        """
        if report.sequence == UNNUMBERED:
            return self._came_unnumbered(report, unit)
        if self.ledger.rows("SELECT 1 FROM reports WHERE sequence = ?", (report.sequence,)):
            return None
        self._keep(report)
        self.ledger.commit()
        return report

    def last_report(self, identity: Identity) -> Report | None:
        """Return the last report on a command, as it is told."""
        last = self.ledger.last_report(identity)
        return None if last is None else _as_told(last)

    def _came_unnumbered(self, report: Report, unit: str) -> Report | None:
        if self.ledger.rows("SELECT 1 FROM came WHERE unit = ?", (unit,)):
            return None
        ((lowest,),) = self.ledger.rows("SELECT min(sequence) FROM reports")
        number = min(lowest or 0, 0) - 1 if self._numbered else self.ledger.last_sequence + 1
        kept = replace(report, sequence=number)
        self._keep(kept)
        self.ledger.write("INSERT INTO came VALUES (?)", (unit,))
        self.ledger.commit()
        return _as_told(kept)

    def _keep(self, report: Report) -> None:
        self._reach(report)
        self.ledger.append(report)

    def _reach(self, report: Report) -> None:
        """Remember the stage of a report, unless a later one of its command came before it."""
        if report.identity is None or report.stage is None:
            return
        last = self.ledger.last_report(report.identity)
        if last is None or last.sequence < report.sequence:
            self.ledger.reach(report.identity, report.stage)

    def measured(self, message: bytes, utc_s: float) -> None:
        """Remember telemetry as the last, unless later telemetry came before it."""
        self.ledger.write(
            "INSERT INTO telemetry VALUES (1, ?, ?) ON CONFLICT DO UPDATE SET"
            " utc_s = excluded.utc_s, message = excluded.message WHERE utc_s <= excluded.utc_s",
            (utc_s, message),
        )
        self.ledger.commit()

    def last_telemetry(self) -> tuple[float, bytes] | None:
        """Return the last telemetry, and when it was made."""
        rows = self.ledger.rows("SELECT utc_s, message FROM telemetry")
        return (float(rows[0][0]), bytes(rows[0][1])) if rows else None

    def active(self) -> int | None:
        """Return the number of the command that the rover works on, as far as is known."""
        rows = self.ledger.rows(
            "SELECT command_id FROM stages WHERE stage IN (?, ?) LIMIT 1",
            tuple(stage.value for stage in _WORKING),
        )
        return int(rows[0][0]) if rows else None

    def queued(self) -> int:
        """Return how many commands were sent of which the rover has begun none."""
        ((count,),) = self.ledger.rows(
            "SELECT count(*) FROM commands LEFT JOIN stages USING (source, command_id)"
            " WHERE stage IS NULL OR stage IN (?, ?)",
            tuple(stage.value for stage in _WAITING),
        )
        return int(count)

    def stopped(self) -> bool:
        """Whether the last stop or resume that went this way and was executed is a stop."""
        rows = self.ledger.rows(
            "SELECT name FROM commands JOIN reports USING (source, command_id)"
            " WHERE name IN (?, ?) AND stage = ? ORDER BY sequence DESC LIMIT 1",
            (Stop.__name__, Resume.__name__, Stage.EXECUTED.value),
        )
        return rows == [(Stop.__name__,)]


def _as_told(report: Report) -> Report:
    return report if report.sequence > 0 else replace(report, sequence=UNNUMBERED)
