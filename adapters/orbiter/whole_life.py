"""The life of a command of which a brick tells the ends only (thesis 6.1)."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

from executive.reports import Report, Severity, Stage

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
"""The stages that a command must have had (`executive.lifecycle`)."""


def whole_life(report: Report, last: Report | None) -> Sequence[Report]:
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
