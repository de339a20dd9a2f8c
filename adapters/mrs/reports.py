"""Reports of the core as MRS notifications."""

from typing import Any

from adapters.mal.mal_area import NamedValue
from adapters.mal.values import AttributeType, Typed
from adapters.mrs.headers import to_ns
from adapters.mrs.types import Notification, NotificationKind, Severity, Stage
from executive.reports import Report


def notification_of(report: Report) -> Notification:
    """Return the notification that carries a report; figures become parameters."""
    figures = tuple(
        NamedValue(name=figure.name, value=Typed(AttributeType.DOUBLE, float(figure.value)))
        for figure in report.figures
    )
    return Notification(
        kind=NotificationKind(report.kind.value),
        severity=Severity(report.severity.value),
        timestamp=to_ns(report.utc_s),
        sequence=report.sequence,
        commandId=report.identity.command_id if report.identity else None,
        source=report.identity.source if report.identity else None,
        stage=Stage(report.stage.value) if report.stage else None,
        step=report.step,
        stepCount=report.step_count,
        code=report.reason.value if report.reason else None,
        text=report.text,
        parameters=figures or None,
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
