"""`ReportLedger` at the orbiter, and the reports that the orbiter itself makes.

Bundles overtake each other, and a refusal by the rover's end of the link has no number. So a client
cannot catch up by the rover's numbers. It uses the cursor, which increases with each recorded
report.

A brick reports only the ends of commands (thesis 6.1); the earlier stages are implied. A loss is
reported for a command whose end may never be reported. Losses and departures from the orbiter are
no stages of the life cycle: kind LINK, without a number.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import Final

from adapters.bundle import DeliveryStatus
from adapters.mops import UNNUMBERED
from adapters.system import SYNCED_APART
from executive.record import Connect, Ledger
from executive.values.reports import Identity, Report, ReportKind, Severity, Stage

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

    Attributes:
        published: cursor of the last published report; those up to it survive loss of power.

    Raises:
        LedgerError: by every method, if the file cannot be read or written.
    """

    def __init__(self, path: Path, schema: str, connect: Connect) -> None:
        super().__init__(path, connect=connect, version=_VERSION)
        for setting in SYNCED_APART:
            self.rows(setting)
        self.make_tables(schema + _SCHEMA)
        ((lowest,),) = self.rows("SELECT min(sequence) FROM reports")
        ((cursor,),) = self.rows("SELECT max(cursor) FROM recorded")
        self._lowest, self._cursor = min(lowest or 0, 0), cursor or 0
        self._new: list[RecordedReport] = []
        self.published = self._cursor

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

    def unpublished(self) -> Sequence[RecordedReport]:
        """Return the reports that are not published yet; none while a commit is pending."""
        return tuple(self._new) if self.settled else ()

    def mark_published(self, reports: Sequence[RecordedReport]) -> None:
        """Note that the first unpublished reports are published."""
        self._new = self._new[len(reports) :]
        self.published = max([self.published, *(each.cursor for each in reports)])

    def last(self) -> RecordedReport | None:
        """Return the report that was published last, or None."""
        found = self._recorded("WHERE cursor = ?", self.published)
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


_TAKEN: Final = (Stage.RECEIVED, Stage.ACCEPTED)
_BEFORE: Final[Mapping[Stage, Sequence[Stage]]] = {
    Stage.RECEIVED: (),
    Stage.ACCEPTED: (Stage.RECEIVED,),
    Stage.REJECTED: (Stage.RECEIVED,),
    Stage.STARTED: _TAKEN,
    Stage.EXPIRED: _TAKEN,
    Stage.CANCELLED: _TAKEN,
    Stage.PROGRESS: (*_TAKEN, Stage.STARTED),
    Stage.EXECUTED: (*_TAKEN, Stage.STARTED),
    Stage.FAILED: (*_TAKEN, Stage.STARTED),
}
"""Stages that must precede each stage (`executive.commands.lifecycle`)."""


def with_implied_stages(report: Report, last: Report | None) -> Sequence[Report]:
    """Return a report after those that it implies, so that the ground gets whole life cycles.

    The flags RECEIVED and EXECUTED of a reply imply earlier stages: an executed command was
    accepted and started before.

    Args:
        report: report of a rover that does not number its reports.
        last: the preceding report on the same command.

    Returns:
        The report, preceded by those of the stages between the last one and its own.
    """
    stage = report.stage
    reached = last.stage if last is not None else None
    if stage is None or (reached is not None and reached.terminal):
        return (report,)
    passed = 0 if reached is None else reached.value
    implied = [each for each in _BEFORE[stage] if each.value > passed]
    bare = replace(report, severity=Severity.INFORMATIONAL, text="", reason=None, figures=())
    return (*(replace(bare, stage=each) for each in implied), report)


def departure(identity: Identity, utc_s: float) -> Report:
    """Return the report that a command has left the orbiter."""
    text = f"{identity} has left the orbiter"
    return Report(UNNUMBERED, utc_s, ReportKind.LINK, Severity.INFORMATIONAL, text, identity)


class Loss(Enum):
    """Reason of the loss of a command: no further report is expected. The value is its text."""

    EXPIRED = "may not have reached the rover: its lifetime ended at the orbiter"
    DELETED = "may not have reached the rover: a node on the path deleted it"
    ABANDONED = "may not have reached the rover: it was abandoned at the orbiter"
    UNREPORTED = "may not have reached the rover: no report within its lifetime"
    LEDGER_REPLACED = "may never be reported on again: the rover restarted with a new ledger"

    def report(self, identity: Identity, utc_s: float) -> Report:
        """Return the report of the loss."""
        text = f"{identity} {self.value}"
        return Report(UNNUMBERED, utc_s, ReportKind.LINK, Severity.ALARM, text, identity)


LOSS_BY_STATUS: Final = {DeliveryStatus.EXPIRED: Loss.EXPIRED, DeliveryStatus.DELETED: Loss.DELETED}
"""Loss of a command by the delivery status of its bundle."""
