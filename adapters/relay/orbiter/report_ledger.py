"""`ReportLedger` at the orbiter: a rover's reports by number, and in the order of recording.

Bundles overtake each other, and a refusal by the rover's end of the link has no number. So a client
cannot catch up by the rover's numbers. It uses the cursor, which increases with each recorded
report.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from adapters.mops import UNNUMBERED
from executive.record import Connect, Ledger
from executive.values.reports import Identity, Report

_VERSION: Final = 1
"""Version of the tables of the orbiter; increase it with each change."""
_SCHEMA: Final = """
CREATE TABLE IF NOT EXISTS recorded (
    cursor INTEGER PRIMARY KEY, number INTEGER NOT NULL UNIQUE
);
"""


@dataclass(frozen=True, slots=True)
class RecordedReport:
    """A report in its published form.

    Attributes:
        cursor: counts from 1 in the order of recording; unique in one file.
        report: its sequence is `UNNUMBERED` if it has no number.
    """

    cursor: int
    report: Report


class ReportLedger(Ledger):
    """A ledger that also stores the order of recording.

    Args:
        path: the file; it and its folders are created if missing.
        schema: SQL of further tables.
        connect: opens the file.

    Raises:
        LedgerError: by every method, if the file cannot be read or written.
    """

    def __init__(self, path: Path, schema: str, connect: Connect) -> None:
        super().__init__(path, connect=connect, version=_VERSION)
        self.make_tables(schema + _SCHEMA)
        ((lowest,),) = self.rows("SELECT min(sequence) FROM reports")
        ((cursor,),) = self.rows("SELECT max(cursor) FROM recorded")
        self._lowest, self._cursor = min(lowest or 0, 0), cursor or 0
        self._new: list[RecordedReport] = []

    def append_report(self, report: Report, foreign: bool = False) -> None:
        """Add a report with the next commit; one without a number is stored below 0."""
        if report.sequence == UNNUMBERED:
            self._lowest -= 1
            report = replace(report, sequence=self._lowest)
        maximum = self.last_sequence
        super().append_report(report, foreign)
        self.last_sequence = max(maximum, report.sequence)
        self._cursor += 1
        self.write("INSERT INTO recorded VALUES (?, ?)", (self._cursor, report.sequence))
        self._new.append(RecordedReport(self._cursor, _as_published(report)))

    def newly_recorded(self) -> Sequence[RecordedReport]:
        """Return the reports recorded since the last call; none while a commit is pending."""
        if not self.settled:
            return ()
        new, self._new = self._new, []
        return new

    def last(self) -> RecordedReport | None:
        """Return the report that was recorded last, or None."""
        found = self._recorded("ORDER BY cursor DESC LIMIT 1")
        return found[0] if found else None

    def recorded(self, since: int, command_id: int | None, count: int) -> Sequence[RecordedReport]:
        """Return reports from a cursor on, in the order of recording.

        Args:
            since: the first cursor.
            command_id: only reports on commands of this number, of any source.
            count: the maximum number of reports.
        """
        if command_id is None:
            return self._recorded("WHERE cursor >= ? ORDER BY cursor LIMIT ?", since, count)
        where = "WHERE cursor >= ? AND command_id = ? ORDER BY cursor LIMIT ?"
        return self._recorded(where, since, command_id, count)

    def recorded_on(self, identity: Identity) -> Sequence[RecordedReport]:
        """Return the reports on a command, in the order of their numbers."""
        where = "WHERE source = ? AND command_id = ? ORDER BY sequence"
        return self._recorded(where, identity.source, identity.command_id)

    def _recorded(self, where: str, *values: object) -> Sequence[RecordedReport]:
        rows = self.rows(
            f"SELECT cursor, number FROM recorded JOIN reports ON sequence = number {where}", values
        )
        return [
            RecordedReport(cursor, _as_published(report))
            for cursor, number in rows
            for report in self._select("WHERE sequence = ?", (number,))
        ]


def _as_published(report: Report) -> Report:
    return report if report.sequence > 0 else replace(report, sequence=UNNUMBERED)
