"""Converts received MRS values into values of the core: reports, parameters, plans, modes."""

from collections.abc import Iterable
from typing import Final

from adapters.mrs.spec import types
from adapters.mrs.spec.mapping import NS_PER_S
from executive.commands import Mode
from executive.values.parameters import Parameter, ParameterValue
from executive.values.reasons import Figure, Reason
from executive.values.reports import Identity, PlanUpdate, Report

REASONS: Final = {each.value: each for each in Reason}
_NAMES: Final = {each.value for each in Parameter}


def report_of(notification: types.Notification) -> Report:
    """Return a notification as a report, without link and without units of its figures."""
    return Report(
        sequence=notification.sequence,
        utc_s=utc_s_of(notification.timestamp),
        kind=notification.kind,
        severity=notification.severity,
        text=notification.text or "",
        identity=identity_of(notification.source, notification.commandId),
        stage=notification.stage,
        step=notification.step,
        step_count=notification.stepCount,
        reason=REASONS.get(notification.code or 0),
        figures=tuple(
            Figure(each.name, each.value.value)
            for each in notification.parameters or ()
            if each.value is not None and isinstance(each.value.value, float)
        ),
    )


def rover_values_of(values: Iterable[types.ParameterValue]) -> list[ParameterValue]:
    """Return the values of rover parameters, without those of links; None if not valid."""
    return [_parameter_value(each) for each in values if each.name in _NAMES]


def _parameter_value(value: types.ParameterValue) -> ParameterValue:
    known = value.value if value.validity is types.Validity.VALID else None
    figure = None if known is None else float(known.value)
    return ParameterValue(Parameter(value.name), utc_s_of(value.timestamp), figure)


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
