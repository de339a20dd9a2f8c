"""`Preconditions` checks the precondition of a command on its arrival and at its start."""

from dataclasses import replace

from executive.commands import (
    CameraWork,
    Command,
    InstantCommand,
    Mode,
    Motion,
    OnlyAt,
    Precondition,
    PreemptionPolicy,
    Stop,
)
from executive.commands.intake import check_localized
from executive.commands.lifecycle import CommandLifecycle
from executive.goals import Context, Goal
from executive.record import Ledger, LedgerError
from executive.state import Uncertainty
from executive.values.geometry import Point, Pose, wrap_rad
from executive.values.quantities import angle_text
from executive.values.reasons import Figure, Identity, Reason, Refusal
from executive.values.reports import Stage

_BY_MOTION = frozenset({Mode.IDLE, Mode.MOVING, Mode.TELEOP})
"""Modes that differ by the motion goals only."""


class Preconditions:
    """Compares preconditions with the pose, the ledger and the mode.

    Args:
        context: the state of the asset.
        ledger: the ends of earlier commands.
    """

    def __init__(self, context: Context, ledger: Ledger) -> None:
        self._context, self._ledger = context, ledger

    def check_arrival(self, command: Command, start: Pose) -> Refusal | None:
        """Return a refusal of a command on its arrival, or None.

        Args:
            command: any command; a stop is never refused.
            start: where the motions before it end.
        """
        only = command.precondition
        if only is None or isinstance(command.request, Stop):
            return None
        pending = self.pending(command)
        waits = pending is not None and _may_follow(command, pending)
        if not waits and (refusal := self._check_after(command, pending)):
            return refusal
        if only.mode is not None and self._context.mode is not only.mode:
            return self._wrong_mode(only.mode)
        if isinstance(command.request, Motion):
            return self._check_pose(only, start)
        return None if waits else self._check_pose(only, self._context.status.pose)

    def pending(self, command: Command) -> CommandLifecycle | None:
        """Return the life cycle of the unfinished command that a command must follow, or None."""
        ahead, latches = _predecessor(command), self._context.latches
        goals = (goal.lifecycle for queue in self._context.goals for goal in queue)
        found = (each for each in (*goals, *latches.stopping) if each.command.identity == ahead)
        return next(found, None)

    def check_start(self, goal: Goal) -> Refusal | None:
        """Return a refusal of a goal at its start, or None.

        Its own motion decides between IDLE and MOVING by now: on arrival those were compared.
        """
        only, mode = goal.command.precondition, self._context.mode
        if only is None:
            return None
        if goal.after is not None and goal.after.stage is not Stage.EXECUTED:
            return _not_executed(goal.after.command.identity, goal.after.stage)
        by_motion = isinstance(goal.request, Motion) and {only.mode, mode} <= _BY_MOTION
        if only.mode is not None and mode is not only.mode and not by_motion:
            return self._wrong_mode(only.mode)
        return self._check_pose(only, self._context.status.pose)

    def _check_after(self, command: Command, pending: CommandLifecycle | None) -> Refusal | None:
        ahead = _predecessor(command)
        if ahead is None:
            return None
        if pending is not None:
            return _not_executed(ahead, pending.stage)
        try:
            last = self._ledger.last_report(ahead)
        except LedgerError:
            text = f"only after {ahead}, but the ledger cannot be read"
            return Refusal(Reason.LEDGER_FAILED, text)
        stage = None if last is None or ahead == command.identity else last.stage
        return None if stage is Stage.EXECUTED else _not_executed(ahead, stage)

    def _wrong_mode(self, required: Mode) -> Refusal:
        text = f"only in mode {required.name}, but the mode is {self._context.mode.name}"
        return Refusal(Reason.PRECONDITION_MODE, text)

    def _check_pose(self, only: Precondition, pose: Pose) -> Refusal | None:
        """Return a refusal if a pose, with its uncertainty, is not within the bounds, or None."""
        if only.at is None:
            return None
        status = self._context.status
        if refusal := check_localized(status, self._context.settings):
            return refusal
        uncertainty, driven_m = status.uncertainty, status.pose.point.distance_m(pose.point)
        if uncertainty:
            grown_m = uncertainty.position_at_m(driven_m)
            return _outside(only.at, pose, replace(uncertainty, position_m=grown_m))
        return _outside(only.at, pose, Uncertainty())


def _predecessor(command: Command) -> Identity | None:
    only = command.precondition
    if only is None or only.after is None:
        return None
    return Identity(command.identity.source, only.after)


def _may_follow(command: Command, pending: CommandLifecycle) -> bool:
    """Return whether a command waits in a queue until an unfinished one ends."""
    replaces = command.preemption is PreemptionPolicy.REPLACE
    queued = isinstance(command.request, Motion | CameraWork | InstantCommand)
    return queued and not (replaces and isinstance(pending.command.request, Motion))


def _not_executed(ahead: Identity, stage: Stage | None) -> Refusal:
    found = "is not known aboard" if stage is None else f"is {stage.name}, not EXECUTED"
    return Refusal(
        Reason.PRECONDITION_COMMAND,
        f"only after {ahead}, which {found}",
        (Figure("command", ahead.command_id),),
        cause=None if stage is None else ahead,
    )


def _outside(at: OnlyAt, pose: Pose, uncertainty: Uncertainty) -> Refusal | None:
    """Return a refusal if an uncertain pose may be outside the bounds, or None."""
    distance_m = pose.point.distance_m(Point(at.x_m, at.y_m))
    figures: tuple[Figure, ...] = (
        Figure("x", pose.x_m, "m"),
        Figure("y", pose.y_m, "m"),
        Figure("distance", distance_m, "m"),
        Figure("bound", at.within_m, "m"),
    )
    texts = []
    if distance_m + uncertainty.position_m > at.within_m:
        texts.append(f"{distance_m:.2f} m away, at x {pose.x_m:.2f} m, y {pose.y_m:.2f} m")
    if at.heading_rad is not None and at.heading_within_rad is not None:
        off_rad = abs(wrap_rad(pose.heading_rad - at.heading_rad))
        figures += (
            Figure("heading", pose.heading_rad, "rad"),
            Figure("heading difference", off_rad, "rad"),
            Figure("heading bound", at.heading_within_rad, "rad"),
        )
        if off_rad + uncertainty.heading_rad > at.heading_within_rad:
            texts.append(f"turned by {angle_text(off_rad)}")
    if not texts:
        return None
    text = f"only {at}, but {' and '.join(texts)}"
    if uncertainty:
        figures += uncertainty.figures
        text += f"; the pose is uncertain by {uncertainty}, since {uncertainty.cause}"
    return Refusal(Reason.PRECONDITION_POSE, text, figures)
