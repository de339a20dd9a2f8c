"""Reports that the orbiter itself makes: implied stages, departures and losses of commands.

A brick reports only the ends of commands (thesis 6.1); the earlier stages are implied. A loss is
reported for a command whose end may never be reported. Losses and departures from the orbiter are
no stages of the life cycle: kind LINK, without a number.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from enum import Enum
from typing import Final

from adapters.bundle import DeliveryStatus
from adapters.mops import UNNUMBERED
from executive.values.reports import Identity, Report, ReportKind, Severity, Stage

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
