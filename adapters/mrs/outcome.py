"""How a command went, as its notifications tell."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from adapters.mal import MalError
from adapters.mrs.reports import given_up
from adapters.mrs.types import Notification, Stage
from executive.commands import Command

TERMINAL: Final = frozenset(
    {Stage.REJECTED, Stage.EXECUTED, Stage.FAILED, Stage.CANCELLED, Stage.EXPIRED}
)

OnNotification = Callable[[Notification], None]


@dataclass(frozen=True, slots=True)
class Outcome:
    """The end of a command.

    Attributes:
        life: its notifications, as they came.
        refusal: the error that answered it, if it was not taken.
        given_up: what the relay said when it gave it up: whether the rover got it is not known.
    """

    command: Command
    life: tuple[Notification, ...]
    refusal: MalError | None = None
    given_up: Notification | None = None

    @property
    def executed(self) -> bool:
        """Whether this command was carried out, with success."""
        return self.refusal is None and self.stage is Stage.EXECUTED

    @property
    def stage(self) -> Stage | None:
        """The last stage reached, if any is known."""
        return self.life[-1].stage if self.life else None


class Watch:
    """Gathers the notifications of one command until its life ends, or a relay gives it up.

    Attributes:
        command_id: the number of the command.
        life: what came so far.
        given_up: what the relay said when it gave it up, if it did.
        ended: completes when nothing more is to come.
    """

    def __init__(self, command: Command, on_notification: OnNotification) -> None:
        """Watch for a command of this client."""
        self.command_id = command.identity.command_id
        self._identity = command.identity
        self._on_notification = on_notification
        self.life: list[Notification] = []
        self.given_up: Notification | None = None
        self.ended: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    @property
    def heard(self) -> bool:
        """Whether anything was said of it."""
        return bool(self.life) or self.ended.done()

    def see(self, notification: Notification) -> None:
        """Take a notification of this command; what its listener raises ends the watch."""
        if self.ended.done():
            return
        if given_up(notification) == self._identity:
            self.given_up = notification
        elif self._is_news(notification):
            self.life.append(notification)
        else:
            return
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
        return (notification.source, notification.commandId) == own and all(
            known.sequence != notification.sequence for known in self.life
        )
