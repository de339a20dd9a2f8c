"""Motion primitives: take a leg of a goal, turn, drive, hold a velocity, finish the leg."""

from py_trees.common import Status

from executive.commands import (
    DriveFor,
    FollowPath,
    MoveForward,
    MoveTo,
    RotateBy,
    RotateTo,
    Waypoint,
)
from executive.geometry import STANDING
from executive.goals import Context, Goal
from executive.motion import Motion, Step, leg_errors, plan_leg
from executive.path_check import check_request
from executive.reasons import Figure, Reason, Refusal
from executive.state import listed
from trees.leaf import GoalLeaf

MARGIN_S = 5.0
ATTEMPTS = 3
HEARING_S = 0.5
"""In which a rover that moves by itself may say that it carries the command out already."""


def _step(goal: Goal) -> Step:
    match goal.command.request:
        case MoveTo(target):
            return target
        case FollowPath(waypoints):
            return waypoints[goal.step]
        case MoveForward() | RotateTo() | RotateBy() as step:
            return step
        case other:
            raise TypeError(f"{other} has no leg")


class _MotionLeaf(GoalLeaf):
    late = Reason.DRIVE_DEADLINE

    def __init__(self, name: str, context: Context) -> None:
        super().__init__(name, context, context.goals.motion)
        self.late_text = f"{name}: not done"

    @property
    def _elsewhere(self) -> bool:
        """Whether the rover received the command over another link, and executes it."""
        return self.context.status.elsewhere == self.goal.command.identity

    @property
    def _known_by(self) -> str:
        """By which sources it is known where the rover is."""
        return listed(["odometry"])

    @property
    def _where(self) -> tuple[Figure, ...]:
        """Where the rover is."""
        pose = self.context.status.pose
        return (
            Figure("x", pose.x_m, "m"),
            Figure("y", pose.y_m, "m"),
            Figure("heading", pose.heading_rad, "rad"),
        )

    def _allow(self, expected_s: float) -> float:
        return 2.0 * expected_s + MARGIN_S

    def _begin(self, motion: Motion | None) -> float:
        self._motion = motion
        return self._allow(0.0 if motion is None else motion.expected_s)

    def _go_on(self, standing: bool) -> Status:
        """Give the intents of a motion until it has ended, or another may take over."""
        motion = self._motion
        if motion is None or (motion.done if standing else motion.ending):
            return Status.SUCCESS
        if motion.fault is not None:
            return self.fail(motion.fault)
        now_s = self.context.clock.now_s()
        if motion.renew(now_s) or self._elsewhere:
            self.allow(self._allow(motion.expected_s))
        self.context.intents.motion = motion.want(now_s)
        self.feedback_message = motion.left
        return Status.RUNNING


class PlanLeg(_MotionLeaf):
    """Waits until the rover stands, then plans the leg from there."""

    def begin(self) -> float:
        """Allow the time of a stop from full speed."""
        self._begun_s = self.context.clock.now_s()
        return self._allow(0.0)

    def act(self) -> Status:
        """Stand, unless this command moves the rover already; then plan."""
        now_s = self.context.clock.now_s()
        if self._elsewhere:
            self.allow(self._allow(0.0))
            self.feedback_message = "carried out by another way"
            return Status.RUNNING
        if not self.context.status.standing:
            if now_s - self._begun_s >= HEARING_S:
                self.context.intents.motion = STANDING
            return Status.RUNNING
        step, pose, settings = _step(self.goal), self.context.status.pose, self.context.settings
        request = MoveTo(step) if isinstance(step, Waypoint) else step
        blocked = check_request(request, pose, settings)
        if blocked is not None:
            return self.fail(blocked)
        self.goal.leg = plan_leg(step, settings, self.context.status)
        return Status.SUCCESS


class Turn(_MotionLeaf):
    """Turns on the spot: towards the target, or to the final heading."""

    late = Reason.TURN_DEADLINE

    def __init__(self, name: str, context: Context, final: bool) -> None:
        super().__init__(name, context)
        self._final = final

    def begin(self) -> float:
        """Begin the turn, if the leg has one."""
        return self._begin(
            self.context.locomotion.turn(self.goal.command, self.goal.leg, self._final)
        )

    def act(self) -> Status:
        """Go on until the rover is there; a final turn ends standing."""
        return self._go_on(standing=self._final)


class Drive(_MotionLeaf):
    """Drives a straight line."""

    def begin(self) -> float:
        """Begin the line, if the leg has one."""
        return self._begin(self.context.locomotion.line(self.goal.command, self.goal.leg))

    def act(self) -> Status:
        """Go on until the rover is there; it stands if no turn follows."""
        return self._go_on(standing=self.goal.leg.heading_rad is None)


class FinishLeg(_MotionLeaf):
    """Moves the goal on to its next step, or ends it with success.

    A waypoint that was missed is tried again from where the rover stands, up to `ATTEMPTS` times;
    no goal ends with success away from its target.
    """

    def begin(self) -> float:
        """Take no time."""
        return self._allow(0.0)

    def act(self) -> Status:
        """Count the step, unless the rover ended away from its target."""
        goal, leg = self.goal, self.goal.leg
        place_m, heading_rad = leg_errors(leg, self.context.settings, self.context.status)
        if place_m > leg.tolerance_m:
            goal.attempts += 1
            relative = isinstance(goal.command.request, MoveForward)
            if not relative and goal.attempts < ATTEMPTS:
                return Status.FAILURE
            text = f"the rover stands {place_m:.3f} m from its target"
            figures = Figure("position error", place_m, "m"), Figure("bound", leg.tolerance_m, "m")
            return self.fail(Refusal(Reason.OFF_TARGET, text, figures))
        goal.step += 1
        goal.attempts = 0
        if goal.step < goal.step_count:
            text = f"waypoint {goal.step} of {goal.step_count} reached"
            goal.life.advance(goal.step, goal.step_count, text)
            return Status.SUCCESS
        took_s = self.context.clock.now_s() - goal.started_s
        self.queue.execute(
            f"{goal.command.name} done in {took_s:.2f} s, {self._known_by}",
            (
                Figure("duration", took_s, "s"),
                Figure("position error", place_m, "m"),
                Figure("heading error", heading_rad, "rad"),
                *self._where,
            ),
        )
        return Status.SUCCESS


class HoldVelocity(_MotionLeaf):
    """Holds a velocity for its time, then stands."""

    def begin(self) -> float:
        """Begin to hold it."""
        command, request = self.goal.command, self.goal.command.request
        if not isinstance(request, DriveFor):
            raise TypeError(f"{request} holds no velocity")
        pose, settings = self.context.status.pose, self.context.settings
        self._blocked = check_request(request, pose, settings)
        return self._begin(self.context.locomotion.hold(command, request))

    def act(self) -> Status:
        """Go on until its time is over and the rover stands."""
        if self._blocked is not None:
            return self.fail(self._blocked)
        status = self._go_on(standing=True)
        if status is Status.SUCCESS:
            self.queue.execute(f"velocity held for its time, {self._known_by}", self._where)
        return status
