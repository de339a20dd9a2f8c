"""`Trajectory` from a state to rest at a target; `TrajectoryProblem` and its solver's interface."""

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from math import pi
from typing import Final, Protocol

from executive.motion.motion_model import MotionState
from executive.motion.obstacle_constraints import ObstacleConstraints
from executive.values.geometry import Point, Pose, Velocity

MIN_DURATION_S: Final = 0.05
MAX_VIA_POINTS: Final = 1
"""Maximum number of via points of a trajectory before its end."""
ANY_HEADING_TOLERANCE_RAD: Final = 10.0
"""A tolerance of the heading that admits every heading."""


@dataclass(frozen=True, slots=True)
class TrajectoryTarget:
    """End position of the control point, or a via point.

    Attributes:
        heading_rad: of the rover; with a guess, not wrapped.
        position_tolerance_m, heading_tolerance_rad: tolerances of the trajectory's end. They are
            narrower than those of the motion: stopping at their edge takes less time.
            `ANY_HEADING_TOLERANCE_RAD`: the heading is free.
        base_offset_m: distance of the point to be placed there, behind the control point.
    """

    x_m: float
    y_m: float
    heading_rad: float
    position_tolerance_m: float = 0.012
    heading_tolerance_rad: float = pi / 180
    base_offset_m: float = 0.0

    @property
    def point(self) -> Point:
        """The position."""
        return Point(self.x_m, self.y_m)

    def base(self, ahead_m: float) -> Point:
        """Return the position of base_link at the target, `ahead_m` behind the control point."""
        pose = Pose(self.x_m, self.y_m, heading_rad=self.heading_rad)
        return pose.ahead(self.base_offset_m - ahead_m)

    @property
    def polyline_rad(self) -> float | None:
        """The heading at the end of a polyline; None where it is free."""
        return self.heading_rad if self.heading_tolerance_rad < ANY_HEADING_TOLERANCE_RAD else None


@dataclass(frozen=True, slots=True)
class Trajectory:
    """States from the start to rest, at equal intervals between the via points.

    Attributes:
        heading_rad: of the target, continued beyond pi as the headings are.
        terminal_error: error beyond the tolerance at the end or a via point, metres and radians.
        via_times_s: times of the via points; each has the same number of intervals.
    """

    duration_s: float
    states: tuple[MotionState, ...]
    heading_rad: float
    terminal_error: float = 0.0
    via_times_s: tuple[float, ...] = ()

    def at(self, time_s: float) -> MotionState:
        """Return the state at a time after the start; the last one beyond the end."""
        edges_s = (0.0, *self.via_times_s, self.duration_s)
        segment = min(max(bisect_right(edges_s, time_s) - 1, 0), len(self.via_times_s))
        begin_s, end_s = edges_s[segment : segment + 2]
        count = (len(self.states) - 1) // len(edges_s[1:])
        coordinate = min(max((time_s - begin_s) / (end_s - begin_s), 0.0), 1.0) * count
        before = segment * count + min(int(coordinate), count - 1)
        part = coordinate - (before - segment * count)
        pair = zip(self.states[before].figures, self.states[before + 1].figures, strict=True)
        return MotionState(*(low + part * (high - low) for low, high in pair))

    def velocity(self, time_s: float) -> Velocity:
        """Return the commanded velocity at a time after the start."""
        state = self.at(time_s)
        return Velocity(state.travel_mps, state.rotate_radps)

    def remainder(self, time_s: float, maximum: int = 0) -> "Trajectory":
        """Return the remainder from a time after the start.

        A via point passed within `MIN_DURATION_S` of that time is left out.

        Args:
            time_s: seconds after the start.
            maximum: maximum number of via points; the first ones are left out.
        """
        left_s = max(self.duration_s - time_s, MIN_DURATION_S)
        retained_s = self.via_times_s[max(len(self.via_times_s) - maximum, 0) :]
        via_times_s = tuple(each - time_s for each in retained_s if each - time_s > MIN_DURATION_S)
        count = (len(self.states) - 1) // (len(self.via_times_s) + 1)
        rest = resample(lambda at_s: self.at(time_s + at_s), via_times_s, left_s, count)
        return replace(rest, heading_rad=self.heading_rad, terminal_error=self.terminal_error)

    def joined_with(self, onward: "Trajectory") -> "Trajectory":
        """Return it joined with the next trajectory, which starts where this one ends."""

        def at(time_s: float) -> MotionState:
            left_s = time_s - self.duration_s
            return self.at(time_s) if left_s < 0.0 else onward.at(left_s)

        via_times_s = (*self.via_times_s, self.duration_s)
        via_times_s += tuple(self.duration_s + each for each in onward.via_times_s)
        count = len(onward.states) - 1
        whole = resample(at, via_times_s, self.duration_s + onward.duration_s, count)
        return replace(whole, heading_rad=onward.heading_rad, terminal_error=self.terminal_error)


def resample(
    at: Callable[[float], MotionState],
    via_times_s: tuple[float, ...],
    duration_s: float,
    count: int,
) -> Trajectory:
    """Return a trajectory with `count` equal intervals to each via point, and to the end."""
    edges_s = (0.0, *via_times_s, duration_s)
    times_s = [
        begin_s + (end_s - begin_s) * index / count
        for begin_s, end_s in pairwise(edges_s)
        for index in range(count)
    ]
    states = tuple(at(time_s) for time_s in (*times_s, duration_s))
    return Trajectory(duration_s, states, states[-1].heading_rad, via_times_s=via_times_s)


@dataclass(frozen=True, slots=True)
class TrajectoryProblem:
    """The problem that a trajectory solves.

    Attributes:
        travel_mps, rotate_radps: speed limits.
        guess: a trajectory near the solution, possibly with fewer via points; None: start from
            rest, with polylines as guesses.
        via_points: via points before the target, at any heading: `MAX_VIA_POINTS` at most.
        obstacles: obstacles to avoid; None without any.
        detour_points: corners of a detour to the first of the targets, for the first guess.
    """

    start: MotionState
    target: TrajectoryTarget
    travel_mps: float
    rotate_radps: float
    guess: Trajectory | None
    via_points: tuple[TrajectoryTarget, ...] = ()
    obstacles: ObstacleConstraints | None = None
    detour_points: tuple[Point, ...] = ()

    @property
    def targets(self) -> tuple[TrajectoryTarget, ...]:
        """The via points, and the target."""
        return *self.via_points, self.target


class TrajectorySolver(Protocol):
    """Solves problems within the call, or on another thread.

    Attributes:
        lead_ticks: number of ticks between a request and the use of its result.
    """

    lead_ticks: int

    @property
    def busy(self) -> bool:
        """Whether a request is in progress; it accepts no other."""

    def request(self, problem: TrajectoryProblem) -> None:
        """Request the solution of a problem."""

    def take_result(self) -> Trajectory | None:
        """Return the result of the last request, once; None without a result."""


class SharedSolver(TrajectorySolver, Protocol):
    """A `TrajectorySolver` that several clients can use."""

    def fork(self, apart: bool = False) -> "SharedSolver":
        """Return another solver, for the requests of another client.

        Args:
            apart: whether the requests are outside of the core, possibly on another thread.
        """
