"""Reports that the orbiter makes itself: implied stages, departures and losses.

A brick tells the ends of commands only (thesis 6.1); the stages before are implied. A loss is told
of a command of which nobody may ever tell the end. That, and that a command has left the orbiter,
is no stage of its life: kind LINK, without a number.
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
"""The stages that a command must have had (`executive.commands.lifecycle`)."""


def with_implied_stages(report: Report, last: Report | None) -> Sequence[Report]:
    """Return a report with those that it implies, so that the ground hears whole lives.

    The flags RECEIVED and EXECUTED of a reply say more than its stage: what is executed was
    accepted and started before.

    Args:
        report: of a rover that does not number its reports.
        last: the last report before it on the same command.

    Returns:
        The report, after those of the stages between the last one and its own.
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
    """Why no report on a command is expected any more, as its text says."""

    EXPIRED = "may not have reached the rover: its lifetime ended at the orbiter"
    DELETED = "may not have reached the rover: a node on its way deleted it"
    GIVEN_UP = "may not have reached the rover: it was given up at the orbiter"
    UNHEARD = "may not have reached the rover: nothing came down on it within its lifetime"
    FORGOTTEN = "may never be heard of again: the rover came back with a new ledger"

    def report(self, identity: Identity, utc_s: float) -> Report:
        """Return the report that tells it."""
        text = f"{identity} {self.value}"
        return Report(UNNUMBERED, utc_s, ReportKind.LINK, Severity.ALARM, text, identity)


LOSS_BY_STATUS: Final = {DeliveryStatus.EXPIRED: Loss.EXPIRED, DeliveryStatus.DELETED: Loss.DELETED}
"""The delivery statuses of a bundle that are a loss."""
