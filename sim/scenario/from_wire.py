"""What came over the MRS, as the core says it, so that verdicts need to know one kind only."""

from collections.abc import Sequence
from typing import Final

from adapters.mal import MalError
from adapters.mrs import spec as wire
from adapters.mrs.spec import AreaError
from executive.commands import Mode
from executive.reasons import Reason
from executive.reports import Identity, Kind, PlanStatus, PlanUpdate, Report, Severity, Stage
from executive.state import Parameter, ParameterValue
from sim.scenario.record import Answer

_NS_PER_S: Final = 1e9
_NAMES: Final = {parameter.value for parameter in Parameter}


def utc_s(timestamp: int) -> float:
    """Return seconds since 1970-01-01 UTC."""
    return timestamp / _NS_PER_S


def report(notification: wire.Notification) -> Report:
    """Return the report that a notification carries, without its figures."""
    source, number = notification.source, notification.commandId
    return Report(
        sequence=notification.sequence,
        utc_s=utc_s(notification.timestamp),
        kind=Kind(notification.kind.value),
        severity=Severity(notification.severity.value),
        text=notification.text or "",
        identity=None if source is None or number is None else Identity(source, number),
        stage=Stage(notification.stage.value) if notification.stage else None,
        step=notification.step,
        step_count=notification.stepCount,
        reason=Reason(notification.code) if notification.code else None,
    )


def parameter_values(values: Sequence[wire.ParameterValue]) -> list[ParameterValue]:
    """Return those values that are of the rover, not of its links."""
    return [_parameter_value(value) for value in values if value.name in _NAMES]


def plan_update(update: wire.PlanUpdate) -> PlanUpdate:
    """Return how far a plan has come."""
    return PlanUpdate(
        update.planId,
        PlanStatus(update.status.value),
        utc_s(update.timestamp),
        update.node or "",
        update.done or 0,
        update.total or 0,
        update.text or "",
    )


def _parameter_value(value: wire.ParameterValue) -> ParameterValue:
    """Return a parameter value; None is what is not valid."""
    known = value.value if value.validity is wire.Validity.VALID else None
    return ParameterValue(
        Parameter(value.name), utc_s(value.timestamp), None if known is None else float(known.value)
    )


def mode(mode: wire.AssetMode) -> Mode | None:
    """Return the mode aboard, or None where nobody is."""
    return None if mode is wire.AssetMode.OFFLINE else Mode(mode.value)


def answer(error: MalError | None) -> Answer:
    """Return what the error that answered a command, or none, says."""
    if error is None:
        return Answer.ADMITTED
    return Answer.DUPLICATE if error.number == AreaError.DUPLICATE.value else Answer.REFUSED
