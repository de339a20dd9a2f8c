"""How a command went, as its notifications tell, and where it waits if an orbiter stores it."""

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from math import inf, isinf
from typing import Final

from adapters.mal import MalError
from adapters.mrs.spec import Notification, ParameterValue, Stage, given_up
from executive.commands import Command
from executive.values.reports import TERMINAL

OnNotification = Callable[[Notification], None]


@dataclass(frozen=True, slots=True)
class CommandOutcome:
    """The end of a command.

    Attributes:
        life: its notifications, as they came.
        refusal: the error that answered it, if it was not taken.
        given_up: what the relay said when it gave it up: whether the rover got it is not known.
        prediction: what the rover predicted of its motion; None where it predicted nothing.
    """

    command: Command
    life: tuple[Notification, ...]
    refusal: MalError | None = None
    given_up: Notification | None = None
    prediction: Notification | None = None

    @property
    def executed(self) -> bool:
        """Whether this command was carried out, with success."""
        return self.refusal is None and self.stage is Stage.EXECUTED

    @property
    def stage(self) -> Stage | None:
        """The last stage reached, if any is known."""
        return self.life[-1].stage if self.life else None


class CommandWatch:
    """Gathers the notifications of one command until its life ends, or a relay gives it up.

    Attributes:
        command, command_id: it, and its number.
        life: what came so far.
        given_up: what the relay said when it gave it up, if it did.
        prediction: what the rover predicted of its motion, if it did.
        ended: completes when nothing more is to come.
    """

    def __init__(self, command: Command, on_notification: OnNotification) -> None:
        self.command_id = command.identity.command_id
        self.command = command
        self._identity = command.identity
        self._on_notification = on_notification
        self.life: list[Notification] = []
        self.given_up: Notification | None = None
        self.prediction: Notification | None = None
        self.ended: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    @property
    def has_news(self) -> bool:
        """Whether anything was notified of it."""
        return bool(self.life) or self.ended.done()

    def outcome(self, refusal: MalError | None = None) -> CommandOutcome:
        """Return what came so far as the end, with the error that answered it, if one did."""
        return CommandOutcome(
            self.command, tuple(self.life), refusal, self.given_up, self.prediction
        )

    def take(self, notification: Notification) -> None:
        """Take a notification of this command; what its listener raises ends the watch."""
        if self.ended.done():
            return
        if given_up(notification) == self._identity:
            self.given_up = notification
        elif not self._is_news(notification):
            return
        elif notification.stage is None:
            self.prediction = notification
        else:
            self.life.append(notification)
        try:
            self._on_notification(notification)
        except Exception as fault:
            self.fail(fault)
        if self.ended.done():
            return
        if self.given_up is not None or notification.stage in TERMINAL:
            self.ended.set_result(None)

    def fail(self, fault: Exception) -> None:
        """End the watch without knowing how the command ended."""
        if not self.ended.done():
            self.ended.set_exception(fault)
            self.ended.exception()  # whoever waits still gets it; nobody has to

    def _is_news(self, notification: Notification) -> bool:
        own = (self._identity.source, self._identity.command_id)
        told = (*self.life, *([] if self.prediction is None else [self.prediction]))
        return (notification.source, notification.commandId) == own and all(
            known.sequence != notification.sequence for known in told
        )


DTN_QUEUED: Final = "DTN_QUEUED"
DTN_OLDEST: Final = "DTN_OLDEST"
NEXT_CONTACT: Final = "DTN_NEXT_CONTACT"
"""The parameter by which a relay is known: time until the next contact, 0 during one."""
LAST_HEARD: Final = "DTN_LAST_HEARD"
"""Time since something was heard of the rover."""
OVERRIDE: Final = "DTN_OVERRIDE"
"""What the operator says of contact: 1 up, -1 down, 0 as planned."""


async def where_stored(get_value: Callable[..., Awaitable[Sequence[ParameterValue]]]) -> str | None:
    """Return where a command is that was taken and not heard of; None if the rover itself took it.

    Args:
        get_value: asks the other end for parameters, by their names.

    Raises:
        ConnectionError: the other end does not come back.
    """
    try:
        values = await get_value(NEXT_CONTACT, LAST_HEARD, OVERRIDE)
    except MalError:
        return None
    left, heard, override = (None if each.value is None else each.value.value for each in values)
    when = describe_next_contact(inf if left is None else float(left), values[0].timestamp / 1e9)
    if override is not None and override < 0:
        when = "the way is held closed by the operator until CONTACT PLAN"
    elif heard is None:
        when += "; nothing was heard of the rover yet"
    return f"at the orbiter; {when}"


def describe_next_contact(left_s: float, utc_s: float) -> str:
    """Return in words when there is contact: in so many seconds from a time on."""
    if isinf(left_s):
        return "there is no contact, and none is planned"
    if left_s <= 0.0:
        return "there is contact now"
    return f"next contact at {datetime.fromtimestamp(utc_s + left_s, UTC):%Y-%m-%d %H:%M:%S} UTC"
