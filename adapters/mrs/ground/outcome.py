"""Outcome of a command from its notifications, and its storage at an orbiter."""

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from math import inf, isinf
from typing import Final

from adapters.mal import MalError
from adapters.mrs.spec import Notification, ParameterValue, Stage, lost_command
from executive.commands import Command
from executive.values.reports import TERMINAL

OnNotification = Callable[[Notification], None]


@dataclass(frozen=True, slots=True)
class CommandOutcome:
    """The outcome of a command.

    Attributes:
        notifications: its notifications, in the order of reception.
        refusal: the error answer, if it was not accepted.
        loss: the relay's notification of its loss: whether the rover received it is unknown.
        prediction: the rover's motion prediction; None without one.
    """

    command: Command
    notifications: tuple[Notification, ...]
    refusal: MalError | None = None
    loss: Notification | None = None
    prediction: Notification | None = None

    @property
    def executed(self) -> bool:
        """Whether this command was executed with success."""
        return self.refusal is None and self.stage is Stage.EXECUTED

    @property
    def stage(self) -> Stage | None:
        """The last known stage, or None."""
        return self.notifications[-1].stage if self.notifications else None


class CommandWatch:
    """Collects the notifications of one command until it ends or is lost at a relay.

    Attributes:
        command, command_id: the command and its number.
        notifications: the received notifications.
        loss: the relay's notification of its loss, or None.
        prediction: the rover's motion prediction, or None.
        ended: completes at the last expected notification.
    """

    def __init__(self, command: Command, on_notification: OnNotification) -> None:
        self.command_id = command.identity.command_id
        self.command = command
        self._identity = command.identity
        self._on_notification = on_notification
        self.notifications: list[Notification] = []
        self.loss: Notification | None = None
        self.prediction: Notification | None = None
        self.ended: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    @property
    def has_notifications(self) -> bool:
        """Whether a notification was received, or the watch has ended."""
        return bool(self.notifications) or self.ended.done()

    def outcome(self, refusal: MalError | None = None) -> CommandOutcome:
        """Return the outcome from the received notifications and the error answer, if any."""
        return CommandOutcome(
            self.command, tuple(self.notifications), refusal, self.loss, self.prediction
        )

    def on_notification(self, notification: Notification) -> None:
        """Process a notification of this command; an exception of the callback ends the watch."""
        if self.ended.done():
            return
        if lost_command(notification) == self._identity:
            self.loss = notification
        elif not self._is_new(notification):
            return
        elif notification.stage is None:
            self.prediction = notification
        else:
            self.notifications.append(notification)
        try:
            self._on_notification(notification)
        except Exception as fault:
            self.fail(fault)
        if self.ended.done():
            return
        if self.loss is not None or notification.stage in TERMINAL:
            self.ended.set_result(None)

    def fail(self, fault: Exception) -> None:
        """End the watch with an unknown result of the command."""
        if not self.ended.done():
            self.ended.set_exception(fault)
            self.ended.exception()  # marks it as retrieved; waiting tasks still receive it

    def _is_new(self, notification: Notification) -> bool:
        own = (self._identity.source, self._identity.command_id)
        received = (*self.notifications, *([] if self.prediction is None else [self.prediction]))
        return (notification.source, notification.commandId) == own and all(
            known.sequence != notification.sequence for known in received
        )


DTN_QUEUED: Final = "DTN_QUEUED"
DTN_OLDEST: Final = "DTN_OLDEST"
NEXT_CONTACT: Final = "DTN_NEXT_CONTACT"
"""Parameter of every relay: time until the next contact in s, 0 during one."""
LAST_RECEIVED: Final = "DTN_LAST_HEARD"
"""Parameter: time since the last contact with the rover, in s."""
OVERRIDE: Final = "DTN_OVERRIDE"
"""Parameter: operator's override of the contact: 1 up, -1 down, 0 as planned."""


async def describe_storage(
    get_value: Callable[..., Awaitable[Sequence[ParameterValue]]],
) -> str | None:
    """Return the storage of an accepted command without report; None without a relay.

    Args:
        get_value: queries the peer for parameters by name.

    Raises:
        ConnectionError: the link does not recover.
    """
    try:
        values = await get_value(NEXT_CONTACT, LAST_RECEIVED, OVERRIDE)
    except MalError:
        return None
    left, age, override = (None if each.value is None else each.value.value for each in values)
    when = describe_next_contact(inf if left is None else float(left), values[0].timestamp / 1e9)
    if override is not None and override < 0:
        when = "contact disabled by the operator until CONTACT PLAN"
    elif age is None:
        when += "; no contact with the rover yet"
    return f"at the orbiter; {when}"


def describe_next_contact(left_s: float, utc_s: float) -> str:
    """Return a text on the next contact, `left_s` seconds after a UTC time."""
    if isinf(left_s):
        return "no contact, and none is planned"
    if left_s <= 0.0:
        return "contact now"
    return f"next contact at {datetime.fromtimestamp(utc_s + left_s, UTC):%Y-%m-%d %H:%M:%S} UTC"
