"""Converts received MRS values into values of the core: reports, parameters, plans, modes."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from adapters.mrs.spec import types
from adapters.mrs.spec.mapping import NS_PER_S, command_of_link
from executive.commands import Mode
from executive.values.parameters import Parameter, ParameterValue
from executive.values.reasons import Figure, Reason, UnknownReason
from executive.values.reports import Identity, PlanUpdate, Report, ReportKind, Severity

REASONS: Final = {each.value: each for each in Reason}
_NAMES: Final = {each.value for each in Parameter}


@dataclass(frozen=True, slots=True)
class ReceivedReport:
    """A report with its cursor.

    Attributes:
        cursor: position in the record of the peer, e.g. an orbiter; 0 if it is not recorded.
    """

    cursor: int
    report: Report


@dataclass(frozen=True, slots=True)
class ReceivedValue:
    """A value of any parameter: of the rover, of its executive or of the link.

    Attributes:
        utc_s: sampling time, seconds since 1970-01-01 UTC.
        value: None if no valid value is known.
    """

    name: str
    utc_s: float
    value: float | str | None


def received_report(notification: types.Notification) -> ReceivedReport:
    """Return a notification as a report with its cursor."""
    return ReceivedReport(notification.cursor or 0, report_of(notification))


def report_of(notification: types.Notification) -> Report:
    """Return a notification as a report, without link and without units of its figures."""
    return Report(
        sequence=notification.sequence,
        utc_s=utc_s_of(notification.timestamp),
        kind=notification.kind,
        severity=notification.severity,
        text=notification.text or "",
        identity=identity_of(notification.source, notification.commandId)
        or command_of_link(notification),
        stage=notification.stage,
        step=notification.step,
        step_count=notification.stepCount,
        reason=None if notification.code is None else reason_of(notification.code),
        figures=tuple(
            Figure(each.name, each.value.value)
            for each in notification.parameters or ()
            if each.value is not None and isinstance(each.value.value, float)
        ),
        fault=notification.fault,
        cause=identity_of(notification.causeSource, notification.causeCommandId),
        publishers=notification.publishers,
    )


def lost_command(report: Report) -> Identity | None:
    """Return the command that a relay reports as lost; None for any other report.

    This is no stage of its life cycle, which the rover reports: it may not have reached the rover.
    """
    return _command_of_link(report, Severity.ALARM)


def forwarded_command(report: Report) -> Identity | None:
    """Return the command that a relay reports as forwarded; None for any other report."""
    return _command_of_link(report, Severity.INFORMATIONAL)


def _command_of_link(report: Report, severity: Severity) -> Identity | None:
    of_link = (report.kind, report.severity) == (ReportKind.LINK, severity)
    return report.identity if of_link else None


def reason_of(code: int) -> Reason | UnknownReason:
    """Return the reason of a number; a newer rover may send unknown ones."""
    return REASONS.get(code) or UnknownReason(code)


def received_value(value: types.ParameterValue) -> ReceivedValue:
    """Return the value of a parameter; a figure as float."""
    known = value.value.value if value.validity is types.Validity.VALID and value.value else None
    figure = known if isinstance(known, str | None) else float(known)
    return ReceivedValue(value.name, utc_s_of(value.timestamp), figure)


def rover_values_of(values: Iterable[ReceivedValue]) -> list[ParameterValue]:
    """Return the values of rover parameters, without those of links."""
    return [
        ParameterValue(Parameter(each.name), each.utc_s, each.value)
        for each in values
        if each.name in _NAMES and not isinstance(each.value, str)
    ]


def plan_update_of(update: types.PlanUpdate) -> PlanUpdate:
    """Return the status of a plan."""
    return PlanUpdate(
        update.planId,
        update.status,
        utc_s_of(update.timestamp),
        update.node or "",
        update.done or 0,
        update.total or 0,
        update.text or "",
    )


def mode_of(mode: types.AssetMode) -> Mode | None:
    """Return the onboard mode, or None if the asset is OFFLINE."""
    return None if mode is types.AssetMode.OFFLINE else Mode(mode.value)


def identity_of(source: str | None, number: int | None) -> Identity | None:
    """Return a command id, or None if a part of it is missing."""
    return None if source is None or number is None else Identity(source, number)


def utc_s_of(time_ns: int) -> float:
    """Return seconds since 1970-01-01 UTC of a MAL time."""
    return time_ns / NS_PER_S
