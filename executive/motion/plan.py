"""A motion from a state to rest at a place: what is asked for, and the plan that answers it."""

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from math import pi
from typing import Final, Protocol

from executive.motion.motion_model import MotionState
from executive.motion.obstacles import ObstacleConstraints
from executive.values.geometry import Point, Pose, Velocity

SHORTEST_S: Final = 0.05
PASSED_AT_ONCE: Final = 1
"""Places that one plan leads through at most, before it ends."""
ANY_RAD: Final = 10.0
"""An aim of the heading that all headings are within."""


@dataclass(frozen=True, slots=True)
class TrajectoryTarget:
    """Where the control point is to stand, or to pass.

    Attributes:
        heading_rad: of the rover; with a guess beside it, not wrapped.
        aim_m, aim_rad: within which of it a plan ends: narrower than the tolerances, since less
            than a point takes less time. `ANY_RAD`: the heading is free.
        behind_m: how far behind the control point is what is to be there.
    """

    x_m: float
    y_m: float
    heading_rad: float
    aim_m: float = 0.012
    aim_rad: float = pi / 180
    behind_m: float = 0.0

    @property
    def point(self) -> Point:
        """The place."""
        return Point(self.x_m, self.y_m)

    def base(self, ahead_m: float) -> Point:
        """Return where base_link is there, so far behind the control point."""
        pose = Pose(self.x_m, self.y_m, heading_rad=self.heading_rad)
        return pose.ahead(self.behind_m - ahead_m)

    @property
    def polyline_rad(self) -> float | None:
        """The heading at the end of a polyline; None where it is free."""
        return self.heading_rad if self.aim_rad < ANY_RAD else None


@dataclass(frozen=True, slots=True)
class Trajectory:
    """States from the start to rest, at equal intervals between the places that are passed.

    Attributes:
        heading_rad: of the target, as its headings go on beyond pi.
        miss: metres and radians beyond the aim in which it ends, or passes a place.
        passes_s: when it passes the places before the end; as many intervals lead to each.
    """

    duration_s: float
    states: tuple[MotionState, ...]
    heading_rad: float
    miss: float = 0.0
    passes_s: tuple[float, ...] = ()

    def at(self, time_s: float) -> MotionState:
        """Return the state so many seconds after the start; the last one beyond the end."""
        edges_s = (0.0, *self.passes_s, self.duration_s)
        segment = min(max(bisect_right(edges_s, time_s) - 1, 0), len(self.passes_s))
        begin_s, end_s = edges_s[segment : segment + 2]
        count = (len(self.states) - 1) // len(edges_s[1:])
        place = min(max((time_s - begin_s) / (end_s - begin_s), 0.0), 1.0) * count
        before = segment * count + min(int(place), count - 1)
        part = place - (before - segment * count)
        pair = zip(self.states[before].figures, self.states[before + 1].figures, strict=True)
        return MotionState(*(low + part * (high - low) for low, high in pair))

    def velocity(self, time_s: float) -> Velocity:
        """Return the velocity that is commanded so many seconds after the start."""
        state = self.at(time_s)
        return Velocity(state.travel_mps, state.rotate_radps)

    def after(self, time_s: float, most: int = 0) -> "Trajectory":
        """Return the rest of it, from so many seconds after the start.

        A place that is passed within `SHORTEST_S` of that is behind it.

        Args:
            time_s: how many seconds after the start.
            most: how many places it may still pass; the first ones are left out.
        """
        left_s = max(self.duration_s - time_s, SHORTEST_S)
        kept_s = self.passes_s[max(len(self.passes_s) - most, 0) :]
        passes_s = tuple(each - time_s for each in kept_s if each - time_s > SHORTEST_S)
        count = (len(self.states) - 1) // (len(self.passes_s) + 1)
        rest = sampled(lambda at_s: self.at(time_s + at_s), passes_s, left_s, count)
        return replace(rest, heading_rad=self.heading_rad, miss=self.miss)

    def extended(self, onward: "Trajectory") -> "Trajectory":
        """Return it with another plan after it, which passes where this one ends."""

        def at(time_s: float) -> MotionState:
            left_s = time_s - self.duration_s
            return self.at(time_s) if left_s < 0.0 else onward.at(left_s)

        passes_s = (*self.passes_s, self.duration_s)
        passes_s += tuple(self.duration_s + each for each in onward.passes_s)
        count = len(onward.states) - 1
        whole = sampled(at, passes_s, self.duration_s + onward.duration_s, count)
        return replace(whole, heading_rad=onward.heading_rad, miss=self.miss)


def sampled(
    at: Callable[[float], MotionState], passes_s: tuple[float, ...], duration_s: float, count: int
) -> Trajectory:
    """Return a plan of so many equal intervals to each place that is passed, and to the end."""
    edges_s = (0.0, *passes_s, duration_s)
    times_s = [
        begin_s + (end_s - begin_s) * index / count
        for begin_s, end_s in pairwise(edges_s)
        for index in range(count)
    ]
    states = tuple(at(time_s) for time_s in (*times_s, duration_s))
    return Trajectory(duration_s, states, states[-1].heading_rad, passes_s=passes_s)


@dataclass(frozen=True, slots=True)
class TrajectoryProblem:
    """What a plan is asked for.

    Attributes:
        travel_mps, rotate_radps: greatest speeds.
        guess: a plan near the answer, to fewer places perhaps; None: from rest, where polylines
            are tried.
        through: places to pass before the target, of any heading: `PASSED_AT_ONCE` at most.
        obstacles: what to keep away from; None where there is nothing.
        around: corners of a way around that, to the first of the places: for the first guess.
    """

    start: MotionState
    target: TrajectoryTarget
    travel_mps: float
    rotate_radps: float
    guess: Trajectory | None
    through: tuple[TrajectoryTarget, ...] = ()
    obstacles: ObstacleConstraints | None = None
    around: tuple[Point, ...] = ()

    @property
    def targets(self) -> tuple[TrajectoryTarget, ...]:
        """The places to pass, and the target."""
        return *self.through, self.target


class TrajectorySolver(Protocol):
    """Answers problems, in the call that asks or beside the thread that does.

    Attributes:
        lead_ticks: how many ticks after its question an answer is used.
    """

    lead_ticks: int

    @property
    def busy(self) -> bool:
        """Whether it is at a question still, and takes no other."""

    def ask(self, problem: TrajectoryProblem) -> None:
        """Have a problem solved."""

    def answer(self) -> Trajectory | None:
        """Return the answer to the last question, once; None where there is none, or none yet."""


class SharedSolver(TrajectorySolver, Protocol):
    """A `TrajectorySolver` that others can use, too."""

    def beside(self, apart: bool = False) -> "SharedSolver":
        """Return another, for questions of somebody else.

        Args:
            apart: whether these are no part of what the core does, and may be another thread's.
        """
