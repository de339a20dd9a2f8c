"""`Replanning` requests a new trajectory each tick, and judges whether the result is usable."""

from dataclasses import dataclass, replace
from math import hypot
from typing import Final

from executive.motion.motion_model import MotionState
from executive.motion.obstacle_constraints import ObstacleConstraints
from executive.motion.route import Route
from executive.motion.trajectory import Trajectory, TrajectoryProblem, TrajectorySolver
from executive.state import Status
from executive.values.geometry import Point, wrap_rad

END_OF_TRAJECTORY_S: Final = 0.15
"""Remaining duration of a plan, below which a stationary rover is at its end."""
REST_SPEED: Final = 0.01
"""Speed in m/s and rad/s that counts as zero: plans are accurate to less."""
MAX_FAILED_TICKS: Final = 5
"""Maximum number of ticks without a usable plan, before the fallback to turn-then-drive."""
MAX_SOLVE_S: Final = 1.0
"""Maximum solving time: the previous plan is followed, then turn-then-drive."""
MAX_STARTS_FROM_REST: Final = 3
"""Maximum number of plans from rest, before the fallback to turn-then-drive."""
MAX_DEVIATION_M: Final = 0.1
MAX_DEVIATION_RAD: Final = 0.2
"""Maximum deviation from the plan; above it the odometry jumped or the rover was pushed."""
TERMINAL_ERROR_LIMIT: Final = 0.05
"""Miss in metres and radians, above which a plan is not usable. Chosen, not measured."""


@dataclass(frozen=True, slots=True)
class SolverRequest:
    """The last request to the solver.

    Attributes:
        from_s: start time of the plan.
        end: index of the route's point where the plan ends.
        waits: whether the rover is stationary, so that the plan starts when it is received.
    """

    requested_s: float
    from_s: float
    end: int
    waits: bool


@dataclass(frozen=True, slots=True)
class ActiveTrajectory:
    """The plan in execution, and its request.

    Attributes:
        from_s: its start time.
    """

    plan: Trajectory
    from_s: float
    request: SolverRequest


class Replanning:
    """Requests plans along a route, each with the rest of the previous one as a guess.

    Attributes:
        course: the last usable plan; None before the first.
    """

    def __init__(self, solver: TrajectorySolver, route: Route, status: Status) -> None:
        self._solver, self._route, self._status = solver, route, status
        self._request: SolverRequest | None = None
        self._received_s: float | None = None  # when the solver last was free
        self._misses = 0
        self._starts = 0
        self.course: ActiveTrajectory | None = None

    @property
    def misses_all(self) -> bool:
        """Whether too many ticks passed without a usable plan."""
        return self._misses > MAX_FAILED_TICKS

    def request(
        self,
        state: MotionState,
        from_s: float,
        now_s: float,
        obstacles: ObstacleConstraints | None,
        around: tuple[Point, ...],
    ) -> None:
        """Request a plan from a state, unless the solver is busy.

        If the rover is stationary at the end of the previous plan, polylines are the guesses again.

        Args:
            state: at `from_s`.
            from_s: start time of the plan.
            now_s: the time.
            obstacles: the obstacles to avoid.
            around: a detour, as the guess of the first plan.
        """
        if self._solver.busy:
            return
        course, route, guess = self.course, self._route, None
        at_rest = max(abs(state.travel_mps), abs(state.rotate_radps)) < REST_SPEED
        if course is not None:
            ahead = course.request.end - route.passed
            rest = course.plan.remainder(from_s - course.from_s, max(ahead, 0))
            over = at_rest and self._status.standing and rest.duration_s < END_OF_TRAJECTORY_S
            if not over and ahead >= 0:
                guess = rest
                near_rad = guess.states[0].heading_rad
                heading_rad = near_rad + wrap_rad(state.heading_rad - near_rad)
                state = replace(state, heading_rad=heading_rad)
        if course is None or guess is None:
            self._starts += 1
            first = route.passed
        else:
            first = course.request.end - len(guess.via_times_s)
        *through, target = route.plan_from(first, now_s)
        waits = guess is None and at_rest
        limits = self._status.travel_limit_mps, self._status.rotate_limit_radps
        detour = around if self._request is None else ()
        self._request = SolverRequest(now_s, from_s, first + len(through), waits)
        self._solver.request(
            TrajectoryProblem(state, target, *limits, guess, tuple(through), obstacles, detour)
        )

    def receive(self, state: MotionState, effect_s: float, now_s: float, late_s: float) -> None:
        """Continue with the result of the last request, if it is usable.

        Args:
            state: of the rover at `effect_s`.
            effect_s: when the last command is in effect.
            now_s: the time.
            late_s: time of the last tick that was too late, so that control was interrupted.
        """
        if self._received_s is None or not self._solver.busy:
            self._received_s = now_s
        if self.course is not None and _jumped(self.course, state, effect_s, late_s):
            self._misses += 1
            return
        if self._solver.busy or self._request is None:
            return
        plan = self._solver.take_result()
        if plan is None or plan.terminal_error > TERMINAL_ERROR_LIMIT:
            self._misses += 1
            return
        self._misses = 0
        from_s = effect_s if self._request.waits else self._request.from_s
        self.course = ActiveTrajectory(plan, from_s, self._request)

    def failure(self, now_s: float) -> str | None:
        """Return the reason to fall back to turn-then-drive, or None."""
        if self.misses_all:
            return "no usable plan"
        if self._starts > MAX_STARTS_FROM_REST:
            return "stationary off the target"
        if self._received_s is not None and now_s - self._received_s > MAX_SOLVE_S:
            return "no plan in time"
        return None


def _jumped(course: ActiveTrajectory, state: MotionState, effect_s: float, late_s: float) -> bool:
    """Return whether the pose jumped off the plan, without an interruption of control."""
    if late_s > course.request.requested_s:
        return False
    planned = course.plan.at(effect_s - course.from_s)
    off_m = hypot(state.x_m - planned.x_m, state.y_m - planned.y_m)
    return (
        off_m > MAX_DEVIATION_M
        or abs(wrap_rad(state.heading_rad - planned.heading_rad)) > MAX_DEVIATION_RAD
    )
