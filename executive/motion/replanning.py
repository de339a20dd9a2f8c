"""Plans anew each tick: which problems the solver is given, and whether its plans lead on."""

from dataclasses import dataclass, replace
from math import hypot
from typing import Final

from executive.motion.motion_model import MotionState
from executive.motion.obstacles import ObstacleConstraints
from executive.motion.plan import Trajectory, TrajectoryProblem, TrajectorySolver
from executive.motion.route import Route
from executive.state import Status
from executive.values.geometry import Point, wrap_rad

OVER_S: Final = 0.15
"""Left of a plan, at the end of which the rover stands."""
AT_REST: Final = 0.01
"""Below so many metres and radians per second a command is none: plans are exact to less."""
MISSES: Final = 5
"""Ticks without a usable plan after which turn-then-drive takes over."""
LATEST_S: Final = 1.0
"""For a plan to come: the one before is driven on meanwhile, then turn-then-drive takes over."""
STANDS: Final = 3
"""How often a plan may be made from rest before turn-then-drive takes over."""
OFF_M: Final = 0.1
OFF_RAD: Final = 0.2
"""From where the plan had it now: beyond it the odometry jumped, or something moved the rover."""
MISSED: Final = 0.05
"""Metres and radians beyond its aim by which a plan does not lead there."""


@dataclass(frozen=True, slots=True)
class SolverRequest:
    """The last request to the solver.

    Attributes:
        asked_s: when it was made.
        from_s: from when on the plan is to be driven.
        end: which place of the route it is to end at.
        waits: whether the rover stands, so that the plan leads from when it is there.
    """

    asked_s: float
    from_s: float
    end: int
    waits: bool


@dataclass(frozen=True, slots=True)
class ActiveTrajectory:
    """The plan that is driven, and the request that it answers.

    Attributes:
        from_s: from when on it is driven.
    """

    plan: Trajectory
    from_s: float
    request: SolverRequest


class Replanning:
    """Requests plans along a route, each with the rest of the one before as a guess.

    Attributes:
        course: the last plan that leads on; None before the first.
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
        """Whether no plan was usable for too many ticks."""
        return self._misses > MISSES

    def request(
        self,
        state: MotionState,
        from_s: float,
        now_s: float,
        obstacles: ObstacleConstraints | None,
        around: tuple[Point, ...],
    ) -> None:
        """Have a plan made from a state, unless the solver is busy.

        Where the rover stands at the end of the plan before, polylines are tried anew.

        Args:
            state: at `from_s`.
            from_s: from when on the plan is to be driven.
            now_s: the time.
            obstacles: what it keeps away from.
            around: a detour, as the guess of the first plan.
        """
        if self._solver.busy:
            return
        course, route, guess = self.course, self._route, None
        at_rest = max(abs(state.travel_mps), abs(state.rotate_radps)) < AT_REST
        if course is not None:
            ahead = course.request.end - route.passed
            rest = course.plan.after(from_s - course.from_s, max(ahead, 0))
            over = at_rest and self._status.standing and rest.duration_s < OVER_S
            if not over and ahead >= 0:
                guess = rest
                near_rad = guess.states[0].heading_rad
                heading_rad = near_rad + wrap_rad(state.heading_rad - near_rad)
                state = replace(state, heading_rad=heading_rad)
        if course is None or guess is None:
            self._starts += 1
            first = route.passed
        else:
            first = course.request.end - len(guess.passes_s)
        *through, target = route.plan_from(first, now_s)
        waits = guess is None and at_rest
        limits = self._status.travel_limit_mps, self._status.rotate_limit_radps
        detour = around if self._request is None else ()
        self._request = SolverRequest(now_s, from_s, first + len(through), waits)
        self._solver.ask(
            TrajectoryProblem(state, target, *limits, guess, tuple(through), obstacles, detour)
        )

    def receive(self, state: MotionState, effect_s: float, now_s: float, late_s: float) -> None:
        """Go on with the answer to the last request, if there is one that leads there.

        Args:
            state: of the rover at `effect_s`.
            effect_s: when the last command is in effect.
            now_s: the time.
            late_s: when a tick last came so late that the rover was not led meanwhile.
        """
        if self._received_s is None or not self._solver.busy:
            self._received_s = now_s
        if self.course is not None and _jumped(self.course, state, effect_s, late_s):
            self._misses += 1
            return
        if self._solver.busy or self._request is None:
            return
        plan = self._solver.answer()
        if plan is None or plan.miss > MISSED:
            self._misses += 1
            return
        self._misses = 0
        from_s = effect_s if self._request.waits else self._request.from_s
        self.course = ActiveTrajectory(plan, from_s, self._request)

    def failure(self, now_s: float) -> str | None:
        """Return why turn-then-drive is to take over, if it is."""
        if self.misses_all:
            return "no plan leads there"
        if self._starts > STANDS:
            return "it stands beside its target"
        if self._received_s is not None and now_s - self._received_s > LATEST_S:
            return "no plan comes in time"
        return None


def _jumped(course: ActiveTrajectory, state: MotionState, effect_s: float, late_s: float) -> bool:
    """Return whether the rover is elsewhere, though it was led since the plan was requested."""
    if late_s > course.request.asked_s:
        return False
    planned = course.plan.at(effect_s - course.from_s)
    off_m = hypot(state.x_m - planned.x_m, state.y_m - planned.y_m)
    return off_m > OFF_M or abs(wrap_rad(state.heading_rad - planned.heading_rad)) > OFF_RAD
