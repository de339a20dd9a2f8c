"""Stand-in of a navigation such as Nav2, honest or lying, without ROS and without physics.

`navigation_server.py` beside it serves one by the action names of Nav2.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from math import atan2, cos, hypot, inf, pi, sin
from random import Random

from executive.values.geometry import STANDING, Pose, Velocity, wrap_rad

POSITION_TOLERANCE_M = 0.15
HEADING_TOLERANCE_RAD = 0.15
FINE_TOLERANCE = 0.05
"""Metres or radians, of relative actions: spin, backup and drive_on_heading."""
VIA_TOLERANCE_M = 0.25
FEEDBACK_S = 0.1


class GoalEnd(Enum):
    """Terminal statuses of action_msgs/GoalStatus."""

    SUCCEEDED = 4
    CANCELLED = 5
    ABORTED = 6


@dataclass(frozen=True, slots=True)
class GoalFeedback:
    key: object
    remaining_m: float
    recoveries: int
    poses_remaining: int


@dataclass(frozen=True, slots=True)
class GoalResult:
    """End of a goal: code and text are error_code and error_msg of Nav2."""

    key: object
    end: GoalEnd
    code: int = 0
    text: str = ""


@dataclass(frozen=True, slots=True)
class ServerRestarted:
    """The server process is another one, which knows nothing of the goal."""

    key: object


NavigationEvent = GoalFeedback | GoalResult | ServerRestarted


@dataclass
class RunningGoal:
    """A goal in execution.

    Attributes:
        key: identifies the goal; its UUID with ROS.
        index: of the next pose.
        tolerance: in metres and radians, at the last pose; None for that of poses.
        at_position: whether the last position was reached; then only the heading counts.
        marks: values that a behaviour stores with the goal.
    """

    key: object
    poses: list[Pose]
    accepted_s: float
    index: int = 0
    reverse: bool = False
    tolerance: float | None = None
    at_position: bool = False
    recoveries: int = 0
    cancelled: bool = False
    feedback_sent_s: float = -inf
    marks: dict[str, float] = field(default_factory=dict)


class Navigation:
    """Drives a robot to poses, in turns and lines; each method `_do_NAME` is a behaviour.

    One goal is in execution at a time: a new one preempts it, which aborts it with code 0.

    Attributes:
        active: as the state of a lifecycle node; an inactive one rejects goals.
        obeys_cancel: whether it cancels goals, and motion after their end, on request.
        goal: the one in execution.
        events: feedback and results; the caller of `step` takes them.
    """

    def __init__(self, behaviour: str = "honest", seed: int = 0, speed_mps: float = 0.6) -> None:
        if behaviour not in self.behaviours():
            raise ValueError(f"no behaviour {behaviour!r}: {', '.join(self.behaviours())}")
        self.behaviour, self.speed_mps = behaviour, speed_mps
        self.random = Random(seed)
        self.active = self.obeys_cancel = True
        self.goal: RunningGoal | None = None
        self.events: list[NavigationEvent] = []
        self._last = STANDING
        self._drives_on_until_s = self._moves_later_s = -inf

    @classmethod
    def behaviours(cls) -> list[str]:
        """Return the names of the behaviours."""
        return sorted(name.removeprefix("_do_") for name in dir(cls) if name.startswith("_do_"))

    @classmethod
    def description(cls, behaviour: str) -> str:
        """Return a behaviour in one sentence."""
        return str(getattr(cls, f"_do_{behaviour}").__doc__)

    # Requests of clients

    def submit(self, key: object, poses: Sequence[Pose], now_s: float) -> bool | None:
        """Return whether the goal is accepted; None if the request is never answered."""
        if self.behaviour == "never_answers":
            return None
        if self.behaviour == "rejects" or not self.active:
            return False
        if self.goal is not None:
            self._end(GoalEnd.ABORTED, text="preempted")
        self.goal = RunningGoal(key, list(poses), now_s)
        return True

    def cancel(self, key: object | None = None) -> list[object]:
        """Cancel a goal, or all; return the keys of the goals that are cancelling."""
        if not self.obeys_cancel:
            return []
        if self.goal is None or key not in (None, self.goal.key):
            if self.behaviour != "aborts_and_drives_on":
                self._drives_on_until_s = -inf
            return []
        if self.behaviour == "deaf_to_cancel":
            return []
        self.goal.cancelled = True
        return [self.goal.key]

    def step(self, now_s: float, pose: Pose) -> Velocity | None:
        """Return the velocity that it publishes now; None if it publishes none."""
        goal = self.goal
        if goal is None:
            later_s = now_s - self._moves_later_s
            if 0.0 <= later_s < 2.0:
                return Velocity(0.4, 0.0)
            return self._last if now_s < self._drives_on_until_s else None
        if goal.cancelled:
            self._end(GoalEnd.CANCELLED)
            return self._give(STANDING)
        behave: Callable[[RunningGoal, float, Pose], Velocity | None]
        behave = getattr(self, f"_do_{self.behaviour}")
        return behave(goal, now_s, pose)

    # Behaviours

    def _do_honest(self, goal: RunningGoal, now_s: float, pose: Pose) -> Velocity | None:
        """Drives there, and succeeds there."""
        self._feed(goal, now_s, self._remaining_m(goal, pose))
        velocity = self._follow(goal, pose)
        if velocity is None:
            self._end(GoalEnd.SUCCEEDED)
        return self._give(velocity or STANDING)

    def _do_slow_start(self, goal: RunningGoal, now_s: float, pose: Pose) -> Velocity | None:
        """Plans for two seconds, with feedback, then is honest."""
        if now_s - goal.accepted_s < 2.0:
            self._feed(goal, now_s, self._remaining_m(goal, pose))
            return None
        return self._do_honest(goal, now_s, pose)

    def _do_recovers(self, goal: RunningGoal, now_s: float, pose: Pose) -> Velocity | None:
        """Backs up and spins halfway, as recovery behaviours do, then drives there."""
        if self._is_halfway(goal, pose) and "recovery" not in goal.marks:
            goal.marks["recovery"] = now_s
            goal.recoveries += 1
        since_s = now_s - goal.marks.get("recovery", -inf)
        if since_s >= 4.0:
            return self._do_honest(goal, now_s, pose)
        self._feed(goal, now_s, self._remaining_m(goal, pose))
        return self._give(Velocity(-0.15, 0.0) if since_s < 2.0 else Velocity(0.0, 0.78))

    def _do_rejects(self, goal: RunningGoal, now_s: float, pose: Pose) -> Velocity | None:
        """Rejects each goal, as an inactive server does."""
        raise AssertionError("it accepts no goal")

    def _do_never_answers(self, goal: RunningGoal, now_s: float, pose: Pose) -> Velocity | None:
        """Does not answer the request."""
        raise AssertionError("it accepts no goal")

    def _do_aborts(self, goal: RunningGoal, now_s: float, pose: Pose) -> Velocity | None:
        """Aborts standing after a second, since there is no path."""
        if now_s - goal.accepted_s > 1.0:
            self._end(GoalEnd.ABORTED, 208, "No valid path found")
            return self._give(STANDING)
        self._feed(goal, now_s, self._remaining_m(goal, pose))
        return None

    def _do_succeeds_off_target(
        self, goal: RunningGoal, now_s: float, pose: Pose
    ) -> Velocity | None:
        """Succeeds up to three metres beside the target."""
        if "moved" not in goal.marks:
            goal.marks["moved"] = 1.0
            off_m, direction_rad = self.random.uniform(0.3, 3.0), self.random.uniform(-pi, pi)
            goal.poses[-1] = beside(
                goal.poses[-1], off_m * cos(direction_rad), off_m * sin(direction_rad)
            )
        return self._do_honest(goal, now_s, pose)

    def _do_succeeds_at_once(self, goal: RunningGoal, now_s: float, pose: Pose) -> Velocity | None:
        """Succeeds without having moved."""
        self._end(GoalEnd.SUCCEEDED)
        return None

    def _do_succeeds_moving(self, goal: RunningGoal, now_s: float, pose: Pose) -> Velocity | None:
        """Succeeds as it passes the target, and drives on for four seconds."""
        self._feed(goal, now_s, self._remaining_m(goal, pose))
        velocity = self._follow(goal, pose)
        if velocity is None or self._remaining_m(goal, pose) < 0.3:
            self._drives_on_until_s = now_s + 4.0
            self._end(GoalEnd.SUCCEEDED)
            velocity = Velocity(0.4, 0.2)
        return self._give(velocity)

    def _do_succeeds_then_moves(
        self, goal: RunningGoal, now_s: float, pose: Pose
    ) -> Velocity | None:
        """Succeeds at the target, and a second later drives on for two seconds."""
        velocity = self._do_honest(goal, now_s, pose)
        if self.goal is None:
            self._moves_later_s = now_s + 1.0
        return velocity

    def _do_aborts_and_drives_on(
        self, goal: RunningGoal, now_s: float, pose: Pose
    ) -> Velocity | None:
        """Aborts halfway, and repeats its last velocity for six seconds."""
        self._feed(goal, now_s, self._remaining_m(goal, pose))
        velocity = self._follow(goal, pose) or Velocity(0.3, 0.0)
        if self._is_halfway(goal, pose) or now_s - goal.accepted_s > 6.0:
            velocity = velocity if abs(velocity.travel_mps) > 0.1 else Velocity(0.3, 0.0)
            self._drives_on_until_s = now_s + 6.0
            self._end(GoalEnd.ABORTED, 105, "Failed to make progress")
        return self._give(velocity)

    def _do_never_ends(self, goal: RunningGoal, now_s: float, pose: Pose) -> Velocity | None:
        """Drives there, and sends feedback for ever, but no result."""
        self._feed(goal, now_s, self._remaining_m(goal, pose))
        return self._give(self._follow(goal, pose) or STANDING)

    def _do_silent_midway(self, goal: RunningGoal, now_s: float, pose: Pose) -> Velocity | None:
        """Sends nothing any more from halfway, and repeats its last velocity."""
        if self._is_halfway(goal, pose):
            return self._last
        self._feed(goal, now_s, self._remaining_m(goal, pose))
        return self._give(self._follow(goal, pose) or Velocity(0.3, 0.0))

    def _do_frozen_midway(self, goal: RunningGoal, now_s: float, pose: Pose) -> Velocity | None:
        """Sends neither feedback nor velocities from halfway, as a process that hangs."""
        if self._is_halfway(goal, pose):
            return None
        self._feed(goal, now_s, self._remaining_m(goal, pose))
        return self._give(self._follow(goal, pose) or Velocity(0.3, 0.0))

    def _do_restarts_midway(self, goal: RunningGoal, now_s: float, pose: Pose) -> Velocity | None:
        """Restarts halfway, knows nothing of the goal, and does not move."""
        self._feed(goal, now_s, self._remaining_m(goal, pose))
        if self._is_halfway(goal, pose):
            self.goal = None
            self.events.append(ServerRestarted(goal.key))
            return None
        return self._give(self._follow(goal, pose) or STANDING)

    def _do_another_takes_over(
        self, goal: RunningGoal, now_s: float, pose: Pose
    ) -> Velocity | None:
        """Lets the goal of another client preempt this one halfway, and drives there."""
        if goal.key != "another" and self._is_halfway(goal, pose):
            self._end(GoalEnd.ABORTED)
            target = goal.poses[-1]
            self.goal = RunningGoal("another", [Pose(target.x_m + 3.0, target.y_m - 3.0)], now_s)
            return self._last
        return self._do_honest(goal, now_s, pose)

    def _do_deaf_to_cancel(self, goal: RunningGoal, now_s: float, pose: Pose) -> Velocity | None:
        """Refuses to be cancelled, and drives there."""
        return self._do_honest(goal, now_s, pose)

    def _do_feedback_lies(self, goal: RunningGoal, now_s: float, pose: Pose) -> Velocity | None:
        """Claims in its feedback to come nearer, does not move, and succeeds."""
        first_m = goal.marks.setdefault("first_m", self._remaining_m(goal, pose))
        remaining_m = max(0.0, first_m - 0.5 * (now_s - goal.accepted_s))
        self._feed(goal, now_s, remaining_m)
        if remaining_m == 0.0:
            self._end(GoalEnd.SUCCEEDED)
        return None

    # Parts of behaviours

    def _give(self, velocity: Velocity) -> Velocity:
        self._last = velocity
        return velocity

    def _remaining_m(self, goal: RunningGoal, pose: Pose) -> float:
        x_m, y_m, remaining_m = pose.x_m, pose.y_m, 0.0
        for each in goal.poses[goal.index :]:
            remaining_m += hypot(each.x_m - x_m, each.y_m - y_m)
            x_m, y_m = each.x_m, each.y_m
        return remaining_m

    def _is_halfway(self, goal: RunningGoal, pose: Pose) -> bool:
        """Whether less than half of the path remained, now or before."""
        remaining_m = self._remaining_m(goal, pose)
        if remaining_m < goal.marks.setdefault("first_m", remaining_m) / 2:
            goal.marks["halfway"] = 1.0
        return "halfway" in goal.marks

    def _feed(self, goal: RunningGoal, now_s: float, remaining_m: float) -> None:
        if now_s - goal.feedback_sent_s >= FEEDBACK_S - 1e-6:
            goal.feedback_sent_s = now_s
            left = len(goal.poses) - goal.index
            self.events.append(GoalFeedback(goal.key, remaining_m, goal.recoveries, left))

    def _end(self, end: GoalEnd, code: int = 0, text: str = "") -> None:
        goal, self.goal = self.goal, None
        if goal is not None:
            self.events.append(GoalResult(goal.key, end, code, text))

    def _follow(self, goal: RunningGoal, pose: Pose) -> Velocity | None:
        """Return the velocity towards the remaining poses; None at the last."""
        target, last = goal.poses[goal.index], goal.index + 1 == len(goal.poses)
        distance_m = hypot(target.x_m - pose.x_m, target.y_m - pose.y_m)
        tolerance_m = (goal.tolerance or POSITION_TOLERANCE_M) if last else VIA_TOLERANCE_M
        if distance_m > tolerance_m and not goal.at_position:
            toward_rad = atan2(target.y_m - pose.y_m, target.x_m - pose.x_m)
            off_rad = wrap_rad(toward_rad - pose.heading_rad + (pi if goal.reverse else 0.0))
            speed_mps = min(self.speed_mps, 0.1 + 0.8 * distance_m)
            travel_mps = speed_mps * (-1.0 if goal.reverse else 1.0) if abs(off_rad) < 0.4 else 0.0
            return Velocity(travel_mps, max(-1.0, min(1.0, 2.0 * off_rad)))
        if not last:
            goal.index += 1
            return self._follow(goal, pose)
        goal.at_position = True
        off_rad = wrap_rad(target.heading_rad - pose.heading_rad)
        if abs(off_rad) > (goal.tolerance or HEADING_TOLERANCE_RAD):
            faster_radps = 1.5 * off_rad + (0.1 if off_rad > 0.0 else -0.1)
            return Velocity(0.0, max(-0.8, min(0.8, faster_radps)))
        return None


def beside(pose: Pose, x_m: float, y_m: float) -> Pose:
    """Return a pose moved along the axes of its frame, with the same heading."""
    return Pose(pose.x_m + x_m, pose.y_m + y_m, heading_rad=pose.heading_rad)
