"""The life of one command of the session, as its notifications tell it."""

import time
from dataclasses import dataclass

from adapters.mal import MalError
from adapters.mrs.ground import TERMINAL
from adapters.mrs.spec import AreaError, Notification, Stage, describe_error, given_up
from executive.commands import Command
from sim.demo.script import Ending, Link, Step, spelled


@dataclass(frozen=True, slots=True)
class Told:
    """A notification, and when the ground had it."""

    notification: Notification
    utc_s: float

    @property
    def aboard_utc_s(self) -> float:
        """When it was made, by the clock aboard."""
        return self.notification.timestamp / 1e9


class Life:
    """What became of a command so far.

    Attributes:
        step: what the script says of it.
        sent_utc_s: when this was made, just before it is sent.
        told: the notifications of its life that came by its link, each once, in their order aboard.
        taken_utc_s: when it was answered that it is taken: by the rover, or stored at the orbiter.
        answer: the error that answered it, if it was not taken.
        lost: what the relay said when it gave it up.
    """

    def __init__(self, step: Step, command: Command, first: Link | None = None) -> None:
        self.step = step
        self.command = command
        self.sent_utc_s = time.time()
        self.told: list[Told] = []
        self.taken_utc_s: float | None = None
        self.answer: MalError | None = None
        self.lost: Told | None = None
        self._again = first is step.link

    @property
    def spelled(self) -> str:
        """The command for people."""
        return spelled(self.command.request)

    @property
    def ending(self) -> Ending | None:
        """How it ended, if it has."""
        if self.answer is not None and self.answer.number == AreaError.DUPLICATE.value:
            return Ending.DUPLICATE
        if self.stage in TERMINAL:
            return Ending[self.stage.name]
        if self.lost is not None:
            return Ending.EXPIRED
        return None if self.answer is None else Ending.REJECTED

    @property
    def stage(self) -> Stage | None:
        """The last stage that it reached."""
        return self.told[-1].notification.stage if self.told else None

    @property
    def stored(self) -> bool:
        """Whether it is, or was, in the hands of the orbiter."""
        return self.step.link is Link.RELAY and self.taken_utc_s is not None

    @property
    def as_expected(self) -> bool:
        """Whether it ended as the script says."""
        return self.ending is self.step.expected

    @property
    def text(self) -> str:
        """What was last said of it: why it ended, or how far it is."""
        if self.ending is Ending.DUPLICATE and self.answer is not None:
            known = describe_error(self.answer).partition(": ")[2]
            return f"told again: {self._last}" if self.told else known
        if self.lost is not None:
            return (self.lost.notification.text or "").partition(": ")[2]
        if not self.told:
            return "" if self.answer is None else describe_error(self.answer)
        return self._last

    @property
    def _last(self) -> str:
        last = self.told[-1].notification
        if last.text in (None, self.command.name):
            return ""
        return f"{last.text} (reason {last.code})" if last.code else last.text or ""

    def reached(self, stage: Stage) -> Told | None:
        """Return what was told of a stage, if it was."""
        return next((told for told in self.told if told.notification.stage is stage), None)

    @property
    def ended(self) -> Told | None:
        """What was told of its end."""
        return self.told[-1] if self.stage in TERMINAL else self.lost

    def see(self, told: Told) -> bool:
        """Take a notification of this link if it is of this life; return whether it is.

        To a repeat the rover sends the last notification of the first once more: it is not taken
        twice by the same link.
        """
        identity, new = self.command.identity, told.notification
        if given_up(new) == identity:
            self.lost = told
            return True
        if self._again or (new.source, new.commandId) != (identity.source, identity.command_id):
            return False
        if any(known.notification.sequence == new.sequence for known in self.told):
            return False
        self.told.append(told)
        self.told.sort(key=lambda known: known.notification.sequence)
        return True
