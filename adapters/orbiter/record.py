"""What the orbiter knows of one rover and must still know after a restart."""

from dataclasses import replace
from pathlib import Path
from typing import Final

from adapters.mops.reports import UNNUMBERED
from adapters.orbiter.asked import Asked
from adapters.orbiter.history import History
from adapters.orbiter.ledgers import Ledgers
from executive.commands import Identity
from executive.ledger import Ledger
from executive.recovery import stopped_by
from executive.reports import Report

MOST_REPORTS: Final = 100_000
_SCHEMA: Final = """
CREATE TABLE IF NOT EXISTS heard (unit TEXT PRIMARY KEY, number INTEGER NOT NULL) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS telemetry (
    one INTEGER PRIMARY KEY CHECK (one = 1), utc_s REAL NOT NULL, message BLOB NOT NULL
);
"""


class Record:
    """The commands that went to a rover, its reports, and its last telemetry.

    Commands and reports are kept as aboard, in a ledger of their own. What a method returned from
    survives `kill -9`.

    Args:
        path: the file, made with its folders if missing.
        numbered: whether the rover numbers its reports; else they are numbered here.
        most_reports: how many of them are kept.

    Attributes:
        ledger: the commands and the reports.
        asked: what has become of the commands.
        ledgers: in which ledgers the rover numbered its reports.

    Raises:
        LedgerError: from every method, if the file cannot be read or written.
    """

    def __init__(self, path: Path, numbered: bool = True, most_reports: int = MOST_REPORTS) -> None:
        """Open or make the file."""
        self._numbered = numbered
        self.ledger = Ledger(path)
        self.ledger.extend(_SCHEMA)
        self.asked, self.ledgers = Asked(self.ledger), Ledgers(self.ledger)
        self._history = History(self.ledger, most_reports, self.stopped_by)
        self._unwritten: dict[str, Report] = {}

    def close(self) -> None:
        """Close the file."""
        self.ledger.close()

    def came(self, report: Report, unit: str, ledger: str = "") -> Report | None:
        """Remember a report; return it as it is to be told, or None if it was told before.

        A refusal by a rover that numbers its reports may have no number, for nothing was taken in:
        it is kept below 0, and has no place among the others. What a rover that does not number
        says again of the same command is nothing new.

        Args:
            report: what the rover says.
            unit: which message of which bundle it is, by which it is known when it comes again
                because it could not be written down.
            ledger: name of the ledger in which the rover numbered it.
        """
        if self.ledger.failing:
            self.ledger.commit()
        if unit in self._unwritten:
            return self._unwritten.pop(unit)
        if report.sequence != UNNUMBERED:
            number = self.ledgers.number(ledger, report.sequence)
            if self._history.forgot(number) or self._has(number):
                return None
        else:
            if self._is_known(unit) or (not self._numbered and self._is_repeated(report)):
                return None
            number = self._next_number()
        self._keep(replace(report, sequence=number), unit)
        return self._unwritten.pop(unit)

    def contradicted(self, report: Report, ledger: str) -> bool:
        """Return whether something else was reported under the number of a report before."""
        if report.sequence == UNNUMBERED:
            return False
        number = self.ledgers.number(ledger, report.sequence)
        known = self.ledger.reports(number, count=1)
        if not known or known[0].sequence != number:
            return False
        return known[0] != replace(report, sequence=number, utc_s=known[0].utc_s)

    def last_report(self, identity: Identity) -> Report | None:
        """Return the last report on a command, as it is told."""
        last = self.ledger.last_report(identity)
        return None if last is None else _as_told(last)

    def active(self) -> int | None:
        """Return the number of the command that the rover works on, as far as is known."""
        return self.asked.active()

    def stopped_by(self) -> Identity | None:
        """Return the stop that holds: no brick has one, for it moves again when it is told to."""
        return stopped_by(self.ledger) if self._numbered else None

    def queued(self) -> int:
        """Return how many commands were sent of which the rover has begun none."""
        return self.asked.queued()

    def prune(self, utc_s: float) -> None:
        """Forget what is more than is to be kept."""
        self._history.prune(utc_s)

    def _has(self, number: int) -> bool:
        return bool(self.ledger.rows("SELECT 1 FROM reports WHERE sequence = ?", (number,)))

    def _next_number(self) -> int:
        if not self._numbered:
            return self.ledger.last_sequence + 1
        ((lowest,),) = self.ledger.rows("SELECT min(sequence) FROM reports")
        return min(lowest or 0, 0) - 1

    def _is_known(self, unit: str) -> bool:
        return bool(self.ledger.rows("SELECT 1 FROM heard WHERE unit = ?", (unit,)))

    def _is_repeated(self, report: Report) -> bool:
        identity = report.identity
        if identity is None or report.stage is None:
            return False
        rows = self.ledger.rows(
            "SELECT 1 FROM reports WHERE source = ? AND command_id = ? AND stage = ? AND text = ?"
            " AND reason IS ? AND step IS ?",
            (
                identity.source,
                identity.command_id,
                report.stage.value,
                report.text,
                report.reason.value if report.reason else None,
                report.step,
            ),
        )
        return bool(rows)

    def _keep(self, report: Report, unit: str) -> None:
        """Write a report down, in one commit with what follows from it."""
        identity, stage = report.identity, report.stage
        if identity is not None and stage is not None and self._is_news(report, identity):
            self.ledger.reach(identity, stage)
            if stage.terminal:
                self.asked.end(identity)
        self.ledger.append(report)
        if not self._numbered or report.sequence < 0:
            self.ledger.write("INSERT INTO heard VALUES (?, ?)", (unit, report.sequence))
        self._unwritten[unit] = _as_told(report)
        self.ledger.commit()

    def _is_news(self, report: Report, identity: Identity) -> bool:
        """Return whether a command has come further; where that has no number, an end is an end."""
        last = self.ledger.last_report(identity)
        if last is None or last.stage is None:
            return True
        return last.sequence < report.sequence if self._numbered else not last.stage.terminal

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


def _as_told(report: Report) -> Report:
    return report if report.sequence > 0 else replace(report, sequence=UNNUMBERED)
