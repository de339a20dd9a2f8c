"""Reports of the core as MRS notifications."""

from typing import Any, Final

from adapters.mal import AttributeType, NamedValue, Typed
from adapters.mrs.headers import to_ns
from adapters.mrs.types import Notification, NotificationKind, Severity, Stage
from executive.reports import Identity, Kind, Report

_SOURCE: Final = "source"
_NUMBER: Final = "commandId"


def notification_of(report: Report) -> Notification:
    """Return the notification that carries a report; figures become parameters.

    Only what is of a command's life has its source and commandId: a LINK that is of one command
    names it in its parameters.
    """
    named = () if report.kind is Kind.COMMAND else _named(report.identity)
    whose = None if named else report.identity
    figures = tuple(
        NamedValue(name=figure.name, value=Typed(AttributeType.DOUBLE, float(figure.value)))
        for figure in report.figures
    )
    return Notification(
        kind=NotificationKind(report.kind.value),
        severity=Severity(report.severity.value),
        timestamp=to_ns(report.utc_s),
        sequence=report.sequence,
        commandId=whose.command_id if whose else None,
        source=whose.source if whose else None,
        stage=Stage(report.stage.value) if report.stage else None,
        step=report.step,
        stepCount=report.step_count,
        code=report.reason.value if report.reason else None,
        text=report.text,
        parameters=(*named, *figures) or None,
    )


def given_up(notification: Notification) -> Identity | None:
    """Return the command that a relay says it has given up; None if it says no such thing.

    This is no stage of its life, which the rover tells: it may not have reached the rover.
    """
    if (notification.kind, notification.severity) != (NotificationKind.LINK, Severity.ALARM):
        return None
    said = {each.name: each.value.value for each in notification.parameters or () if each.value}
    source, number = said.get(_SOURCE), said.get(_NUMBER)
    if not isinstance(source, str) or not isinstance(number, int):
        return None
    return Identity(source, number)


def _named(identity: Identity | None) -> tuple[NamedValue, ...]:
    if identity is None:
        return ()
    return (
        NamedValue(name=_SOURCE, value=Typed(AttributeType.IDENTIFIER, identity.source)),
        NamedValue(name=_NUMBER, value=Typed(AttributeType.LONG, identity.command_id)),
    )


def notification_keys(asset: str, notification: Notification) -> tuple[Any, ...]:
    """Return the subscription keys of a notification.

    What is of no command has no commandId: a 0 would be taken for "any" by brokers.
    """
    return (
        asset,
        notification.kind.value,
        notification.severity.value,
        notification.commandId or None,
        notification.stage.value if notification.stage else None,
    )
