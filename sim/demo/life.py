"""The life of one command of the session, as its notifications tell it."""

from adapters.mal.errors import MalError
from adapters.mrs.errors import AreaError, in_words
from adapters.mrs.outcome import TERMINAL
from adapters.mrs.types import Notification, Stage
from executive.commands import Command
from sim.demo.script import Ending, Step, spelled


class Life:
    """What became of a command so far.

    Attributes:
        step: what the script says of it.
        notifications: those of its life, each once, as they came.
        answer: the error that answered it, if it was not taken.
    """

    def __init__(self, step: Step, command: Command) -> None:
        """Begin before it is sent."""
        self.step = step
        self.command = command
        self.notifications: list[Notification] = []
        self.answer: MalError | None = None

    @property
    def spelled(self) -> str:
        """The command for people."""
        return spelled(self.command.request)

    @property
    def ending(self) -> Ending | None:
        """How it ended, if it has."""
        if self.stage in TERMINAL:
            return Ending[self.stage.name]
        if self.answer is None:
            return None
        known = self.answer.number == AreaError.DUPLICATE.value
        return Ending.DUPLICATE if known else Ending.REJECTED

    @property
    def stage(self) -> Stage | None:
        """The last stage that it reached."""
        return self.notifications[-1].stage if self.notifications else None

    @property
    def as_expected(self) -> bool:
        """Whether it ended as the script says."""
        return self.ending is self.step.expected

    @property
    def text(self) -> str:
        """What was last said of it: why it ended, or how far it is."""
        if self.ending is Ending.DUPLICATE and self.answer is not None:
            return in_words(self.answer).partition(": ")[2]
        if not self.notifications:
            return "" if self.answer is None else in_words(self.answer)
        last = self.notifications[-1]
        if last.text in (None, self.command.name):
            return ""
        return f"{last.text} (reason {last.code})" if last.code else last.text or ""

    def utc_s(self, stage: Stage) -> float | None:
        """Return when it reached a stage, by the clock aboard."""
        for notification in self.notifications:
            if notification.stage is stage:
                return notification.timestamp / 1e9
        return None

    @property
    def ended_utc_s(self) -> float | None:
        """When it ended, by the clock aboard."""
        return self.notifications[-1].timestamp / 1e9 if self.stage in TERMINAL else None

    def see(self, notification: Notification) -> bool:
        """Take a notification if it is of this life; return whether it is.

        To a repeat the rover sends the last notification of the first once more: it is not taken.
        """
        identity = self.command.identity
        if self.step.repeats or self.stage in TERMINAL:
            return False
        if (notification.source, notification.commandId) != (identity.source, identity.command_id):
            return False
        self.notifications.append(notification)
        return True
