"""`RosClients` decides whether commands of ROS clients are accepted, and ends them.

Any node of the ROS domain can send them, so all have one source and link. They never take the
authority from its holder, and replace no motion of another source.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import assert_never

from executive.commands import (
    ROS_LINK,
    ROS_SOURCE,
    Command,
    ConfirmPose,
    Request,
    Resume,
    SetPositionCompensation,
)
from executive.core.authority import Authority
from executive.goals import Context, Goal
from executive.record import Notifications
from executive.settings import RosCommands
from executive.values.reasons import Reason, Refusal
from executive.values.reports import Identity

OFF = Refusal(
    Reason.NOT_SUPPORTED,
    "the settings of the asset accept no commands of ROS clients except a stop: set ros.commands",
)


@dataclass(frozen=True, slots=True)
class CancelRequest:
    """The cancel of one command by its ROS client.

    Attributes:
        text: reason of the client.
    """

    identity: Identity
    text: str


class RosClients:
    """Checks, cancels and authorizes the commands of ROS clients."""

    def __init__(
        self, context: Context, authority: Authority, notifications: Notifications
    ) -> None:
        self._context = context
        self._authority = authority
        self._notifications = notifications

    def check(self, command: Command) -> Refusal | None:
        """Return a refusal of a command other than a stop, or None; None for other links."""
        if command.link != ROS_LINK:
            return None
        commands = self._context.settings.ros.commands
        match commands:
            case RosCommands.OFF:
                return OFF
            case RosCommands.WHEN_FREE:
                busy = self._operator_activity or _operator_decision(command.request, self._context)
                text = f"commands of ROS clients are accepted when the rover is free: {busy}"
                return None if busy is None else Refusal(Reason.OPERATOR_ACTIVE, text)
            case RosCommands.ALWAYS:
                return None
            case _:
                assert_never(commands)

    @property
    def has_other_motion(self) -> bool:
        """Whether a motion goal of another link waits or is active."""
        return any(goal.command.link != ROS_LINK for goal in self._context.goals.motion)

    def replace_motion(self, refusal: Refusal) -> None:
        """Cancel the motions of ROS clients, active and waiting."""
        for goal in tuple(self._context.goals.motion):
            if goal.command.link == ROS_LINK:
                self._context.goals.motion.cancel(goal.lifecycle, refusal)

    def hold_authority(self) -> bool:
        """Request the authority or renew it, if commands need it; return whether they may run."""
        before = self._authority.grant
        held = self._authority.hold(ROS_SOURCE)
        if (grant := self._authority.grant) is not before:
            self._notifications.answer(lambda written: self._authority.settle(grant, written))
        return held

    def cancel(self, request: CancelRequest) -> None:
        """Cancel one command of a ROS client; without effect once it has ended."""
        refusal = Refusal(Reason.CANCELLED_BY_CLIENT, request.text)
        for goal in tuple(self._goals()):
            if goal.command.identity == request.identity:
                self._context.goals.cancel(goal.lifecycle, refusal)

    def tick(self) -> None:
        """Renew the authority for the goals of ROS clients; cancel them once another holds it."""
        goals = tuple(self._goals())
        if not goals or self.hold_authority():
            return
        text = f"{self._authority.state.holder} took the authority from {ROS_SOURCE}"
        for goal in goals:
            self._context.goals.cancel(goal.lifecycle, Refusal(Reason.NO_AUTHORITY, text))

    def _goals(self) -> Iterator[Goal]:
        for queue in self._context.goals:
            yield from (goal for goal in queue if goal.command.link == ROS_LINK)

    @property
    def _operator_activity(self) -> str | None:
        """The activity of an operator while the rover is not free; None if it is free."""
        for queue in self._context.goals:
            for goal in queue:
                if goal.command.link != ROS_LINK:
                    return f"{goal.command.identity} {goal.command.name} is not finished"
        if (plan := self._context.plans.executing) is not None:
            return f"plan {plan} controls the rover"
        holder = self._authority.state.holder
        return None if holder in {None, ROS_SOURCE} else f"{holder} holds the authority"


def _operator_decision(request: Request, context: Context) -> str | None:
    """Return which decision of a request only an operator takes; None if there is none."""
    latches = context.latches
    stopped = latches.stopped_by is not None
    own_stop = latches.stop is not None and latches.stop.source == ROS_SOURCE
    held_by_fault = latches.hazard is not None or latches.paused is not None
    match request:
        case Resume() if held_by_fault or (stopped and not own_stop):
            return "only an operator resumes it after a fault or after the stop of another source"
        case SetPositionCompensation() | ConfirmPose():
            return "only an operator changes or confirms its pose"
        case _:
            return None
