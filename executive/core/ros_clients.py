"""`RosClients` decides whether commands of ROS clients are accepted, and ends them.

Any node of the ROS domain can send them, so all have one source and link. They never take the
authority from its holder, and replace no motion of another source.
"""

from dataclasses import dataclass
from typing import Final

from executive.commands import (
    ROS_LINK,
    ROS_SOURCE,
    Command,
    ConfirmPose,
    Resume,
    SetPositionCompensation,
)
from executive.core.authority import Authority
from executive.goals import Context, Goal
from executive.record import Notifications
from executive.settings import RosCommands
from executive.values.reasons import Reason, Refusal
from executive.values.reports import Identity

OFF: Final = Refusal(
    Reason.NOT_SUPPORTED,
    "the settings of the asset accept no commands of ROS clients except a stop: set ros.commands",
)


@dataclass(frozen=True, slots=True)
class CancelRequest:
    """The cancel of one command by its ROS client, with its reason."""

    identity: Identity
    text: str


class RosClients:
    """Checks, cancels and authorizes the commands of ROS clients."""

    def __init__(
        self, context: Context, authority: Authority, notifications: Notifications
    ) -> None:
        self._context, self._authority = context, authority
        self._notifications = notifications

    def check(self, command: Command) -> Refusal | None:
        """Return a refusal of a command other than a stop, or None; None for other links."""
        commands = self._context.settings.ros.commands
        if command.link != ROS_LINK or commands is RosCommands.ALWAYS:
            return None
        if commands is RosCommands.OFF:
            return OFF
        busy = self._operator_activity or self._operator_decision(command)
        text = f"commands of ROS clients are accepted when the rover is free: {busy}"
        return None if busy is None else Refusal(Reason.OPERATOR_ACTIVE, text)

    @property
    def has_other_motion(self) -> bool:
        """Whether a motion goal of another link waits or is active."""
        return any(goal.command.link != ROS_LINK for goal in self._context.goals.motion)

    def replace_motion(self, refusal: Refusal) -> None:
        """Cancel the motions of ROS clients, active and waiting."""
        for goal in self._goals:
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
        for goal in self._goals:
            if goal.command.identity == request.identity:
                refusal = Refusal(Reason.CANCELLED_BY_CLIENT, request.text)
                self._context.goals.cancel(goal.lifecycle, refusal)

    def tick(self) -> None:
        """Renew the authority for the goals of ROS clients; cancel them once another holds it."""
        if (goals := self._goals) and not self.hold_authority():
            text = f"{self._authority.state.holder} took the authority from {ROS_SOURCE}"
            for goal in goals:
                self._context.goals.cancel(goal.lifecycle, Refusal(Reason.NO_AUTHORITY, text))

    @property
    def _goals(self) -> tuple[Goal, ...]:
        goals = (goal for queue in self._context.goals for goal in queue)
        return tuple(goal for goal in goals if goal.command.link == ROS_LINK)

    @property
    def _operator_activity(self) -> str | None:
        """The activity of an operator while the rover is not free; None if it is free."""
        for goal in (goal for queue in self._context.goals for goal in queue):
            if goal.command.link != ROS_LINK:
                return f"{goal.command.identity} {goal.command.name} is not finished"
        if (plan := self._context.plans.executing) is not None:
            return f"plan {plan} controls the rover"
        holder = self._authority.state.holder
        return None if holder in {None, ROS_SOURCE} else f"{holder} holds the authority"

    def _operator_decision(self, command: Command) -> str | None:
        """Return which decision of a command only an operator takes; None if there is none."""
        latches, stop = self._context.latches, self._context.latches.stop
        by_fault = latches.hazard is not None or latches.paused is not None
        other_stop = latches.stopped_by is not None and (stop is None or stop.source != ROS_SOURCE)
        match command.request:
            case Resume() if by_fault or other_stop:
                return "only an operator resumes it after a fault or a stop of another source"
            case SetPositionCompensation() | ConfirmPose():
                return "only an operator changes or confirms its pose"
            case _:
                return None
