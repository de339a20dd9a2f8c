"""The Notification service: the life of commands and events, now and in the past."""

import asyncio
from collections.abc import Awaitable, Callable
from math import isfinite
from typing import Final

from adapters.mal import AttributeType, Call, NamedValue, StandardError
from adapters.mrs.aboard.gateway import Gateway
from adapters.mrs.aboard.served_operations import ServedOperations
from adapters.mrs.spec import (
    LONGEST_SOURCE,
    LONGEST_TEXT,
    MOST_FIGURES,
    Notification,
    NotificationKind,
    invalid,
    notification_keys,
    notification_of,
    with_text,
)
from executive.reasons import Figure
from executive.reports import Report, Severity
from executive.runner import Executive

SERVICE: Final = "Notification"
PAGE: Final = 1000
"""Notifications that one getNotifications returns, at most."""
LAST_SEQUENCE: Final = (1 << 63) - 1
"""The highest sequence number that the ledger can hold."""

_NUMBERS: Final = {
    AttributeType.FLOAT,
    AttributeType.DOUBLE,
    AttributeType.OCTET,
    AttributeType.UOCTET,
    AttributeType.SHORT,
    AttributeType.USHORT,
    AttributeType.INTEGER,
    AttributeType.UINTEGER,
    AttributeType.LONG,
    AttributeType.ULONG,
    AttributeType.DURATION,
}


Found = tuple[tuple[Notification, ...]]
Past = Callable[[int | None, int | None, int], Found | Awaitable[Found]]


class NotificationService:
    """Broadcasts and returns what is reported; `publish` is called on the provider's loop.

    Args:
        past: called as `past(since, command_id, most)`, with what getNotifications is asked for.
        asset, domain: by which the asset is known.
        on_notification: called with each notification that is broadcast.
    """

    def __init__(
        self,
        offer: ServedOperations,
        past: Past,
        asset: str,
        domain: tuple[str, ...],
        on_notification: Callable[[Notification], None],
    ) -> None:
        """Put the operations up; events from outside are for `serve_events`."""
        self._asset = asset
        self._domain = domain
        self._on_notification = on_notification
        self._publisher = offer.publisher(SERVICE, "monitorNotification")
        offer.serve(SERVICE, "getNotifications", lambda _, *wanted: past(*wanted))

    def publish(self, report: Report) -> None:
        """Broadcast a report."""
        notification = notification_of(report)
        self._publisher.publish(
            notification,
            keys=notification_keys(self._asset, notification),
            domain=self._domain,
            source=self._asset,
            droppable=False,
        )
        self._on_notification(notification)


def serve_events(offer: ServedOperations, core: Gateway) -> None:
    """Let others hand events to the executive, which reports them."""

    def send(_: Call, notification: Notification) -> asyncio.Future[None]:
        text, parameters = notification.text, notification.parameters or ()
        if notification.kind is not NotificationKind.EVENT or not text:
            raise invalid(0)
        if len(text) > LONGEST_TEXT or len(parameters) > MOST_FIGURES:
            raise invalid(0)
        severity = Severity(notification.severity.value)
        figures = tuple(map(_figure, parameters))
        return core.ask(lambda executive: _report_event(executive, severity, text, figures))

    offer.serve(SERVICE, "sendNotification", send)


def past_notifications(
    core: Gateway, since: int | None, command_id: int | None, most: int
) -> asyncio.Future[Found]:
    """Return notifications of the asset's ledger, oldest first.

    Args:
        core: whose ledger.
        since: the first sequence number wanted.
        command_id: only of commands of this number.
        most: how many at most; 0 for as many as are returned at once.
    """
    first = min(since or 0, LAST_SEQUENCE)
    return core.ask(
        lambda executive: (
            tuple(
                notification_of(report)
                for report in executive.reports(first, command_id, page_size(most))
            ),
        )
    )


def page_size(most: int) -> int:
    """Return how many notifications are returned when so many are wanted at most, 0 for all."""
    return min(most, PAGE) or PAGE


def _report_event(
    executive: Executive, severity: Severity, text: str, figures: tuple[Figure, ...]
) -> None:
    """Report an event, unless it would only pile up behind a ledger that cannot be written."""
    if not executive.recording:
        raise with_text(StandardError.INTERNAL, "the ledger cannot be written")
    executive.event(severity, text, figures)


def _figure(parameter: NamedValue) -> Figure:
    value = parameter.value
    if len(parameter.name) > LONGEST_SOURCE or value is None:
        raise invalid(0)
    if value.type not in _NUMBERS or not isfinite(value.value):
        raise invalid(0)
    return Figure(parameter.name, float(value.value))
