"""How a command went, as its notifications tell."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from adapters.mal.errors import MalError
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
    """

    command: Command
    life: tuple[Notification, ...]
    refusal: MalError | None = None

    @property
    def executed(self) -> bool:
        """Whether this command was carried out, with success."""
        return self.refusal is None and self.stage is Stage.EXECUTED

    @property
    def stage(self) -> Stage | None:
        """The last stage reached, if any is known."""
        return self.life[-1].stage if self.life else None


class Watch:
    """Gathers the notifications of one command until its life ends.

    Attributes:
        command_id: the number of the command.
        life: what came so far.
        ended: completes with the terminal notification.
    """

    def __init__(self, command: Command, on_notification: OnNotification) -> None:
        """Watch for a command of this client."""
        self.command_id = command.identity.command_id
        self._identity = (command.identity.source, command.identity.command_id)
        self._on_notification = on_notification
        self.life: list[Notification] = []
        self.ended: asyncio.Future[Notification] = asyncio.get_running_loop().create_future()

    def see(self, notification: Notification) -> None:
        """Take a notification of this command; what its listener raises ends the watch."""
        if (notification.source, notification.commandId) != self._identity or self.ended.done():
            return
        if any(known.sequence == notification.sequence for known in self.life):
            return
        self.life.append(notification)
        try:
            self._on_notification(notification)
        except Exception as fault:
            self.fail(fault)
        if self.ended.done():
            return
        if notification.stage in TERMINAL:
            self.ended.set_result(notification)

    def fail(self, fault: Exception) -> None:
        """End the watch without knowing how the command ended."""
        if not self.ended.done():
            self.ended.set_exception(fault)
            self.ended.exception()  # whoever waits still gets it; nobody has to
