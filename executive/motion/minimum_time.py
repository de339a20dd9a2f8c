"""`MinimumTimeSolver` finds the fastest trajectory from a state to rest at a target, for MPC.

A guess is a path of straight lines between turns on the spot, or, for a base that cannot turn on
the spot, of arcs and lines.
"""

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from itertools import islice, pairwise, product
from math import acos, atan2, cos, hypot, pi, sin, sqrt
from typing import Final

from executive.motion.locomotion import Bounds, duration_s
from executive.motion.motion_model import MotionModel, MotionState
from executive.motion.obstacle_constraints import ObstacleConstraints
from executive.motion.optimal_control import OptimalControlProblem
from executive.motion.polylines import LineSegment, Polyline, initial_guesses, make_polyline
from executive.motion.trajectory import (
    MAX_VIA_POINTS,
    MIN_DURATION_S,
    Trajectory,
    TrajectoryProblem,
    TrajectoryTarget,
)
from executive.values.geometry import Point, wrap_rad

MIN_TIME_FACTOR: Final = 0.6
"""Minimum ratio of a duration to that of the commanded limits; a driving rover turns faster."""
MAX_GUESSES: Final = 3
"""Maximum number of guesses; another is tried while the best plan misses the tolerance."""
OBSTACLE_REFINEMENTS: Final = 2
"""Number of solutions per guess, each with the obstacles near the one before."""
NO_MISS: Final = 1e-3
SLOW_MPS: Final = 0.01


Part = tuple[float, int]
"""Signed length in radii, and side: 1 left, 0 straight, -1 right."""
HEADINGS: Final = 8
"""Number of headings that are tried where the heading is free."""
MIN_PART: Final = 1e-6


def turning_paths(
    start: Point,
    start_rad: float,
    end: Point,
    end_rad: float | None,
    travel: Bounds,
    rotate: Bounds,
    around: Sequence[Point],
    radius_m: float,
) -> list[Polyline]:
    """Return the paths from one pose to another, the fastest first.

    Without `end_rad` the end heading is free. All pass through the points `around`. Each is of arcs
    of the minimum radius, and lines, with reversals: those of Reeds and Shepp (1990) with three
    parts. One of them reaches every pose; those with more parts are shorter by little, and left to
    the optimization.
    """
    begun: list[LineSegment] = []
    for point, after in pairwise((*around, end)):
        paths = _between(start, start_rad, point, point.bearing_rad(after), radius_m)
        begun += min(paths, key=lambda each: sum(abs(part.by_m) for part in each))
        start, start_rad = point, begun[-1].at(begun[-1].by_m)[1]
    turns = [index * 2 * pi / HEADINGS for index in range(HEADINGS)]
    headings_rad = (
        [start.bearing_rad(end) + each for each in turns] if end_rad is None else [end_rad]
    )
    found = [
        make_polyline(parts, parts[-1].at(parts[-1].by_m)[1], travel, rotate)
        for heading_rad in headings_rad
        for path in _between(start, start_rad, end, heading_rad, radius_m)
        if (parts := [*begun, *path])
    ]
    return sorted(found, key=lambda each: each.duration_s)


def _between(
    start: Point, start_rad: float, end: Point, end_rad: float, radius_m: float
) -> Iterator[list[LineSegment]]:
    """Yield the paths from one pose to another."""
    x_m, y_m = end.x_m - start.x_m, end.y_m - start.y_m
    cosine, sine = cos(start_rad), sin(start_rad)
    x, y = (x_m * cosine + y_m * sine) / radius_m, (y_m * cosine - x_m * sine) / radius_m
    for along, aside in product((1, -1), (1, -1)):
        turn_rad = along * aside * (end_rad - start_rad)
        for kind in _kinds(along * x, aside * y, turn_rad):
            parts, point, heading_rad = [], start, start_rad
            for length, side in kind:
                if abs(length) > MIN_PART:
                    by_m, curvature = along * length * radius_m, aside * side / radius_m
                    parts.append(LineSegment(point, heading_rad, by_m, curvature))
                    point, heading_rad = parts[-1].at(by_m)
            yield parts


def _kinds(x: float, y: float, turn_rad: float) -> Iterator[tuple[Part, ...]]:
    """Yield the paths that begin forward to the left, in radii from the origin."""
    sine, cosine = sin(turn_rad), cos(turn_rad)
    distance, bearing = hypot(x - sine, y - 1 + cosine), atan2(y - 1 + cosine, x - sine)
    yield (_turn(bearing), 1), (distance, 0), (_turn(turn_rad - bearing), 1)
    if distance <= 4.0:
        angle = acos(distance / 4)
        first, middle = _turn(bearing + pi / 2 + angle), pi - 2 * angle
        yield (first, 1), (-middle, -1), (_turn(turn_rad - first - middle), 1)
        yield (first, 1), (-middle, -1), (-_turn(first + middle - turn_rad), 1)
        first = _turn(bearing + pi / 2 - angle)
        yield (first, 1), (middle, -1), (-_turn(first - middle - turn_rad), 1)
    across, bearing = hypot(x + sine, y - 1 - cosine), atan2(y - 1 - cosine, x + sine)
    if across >= 2.0:
        line = sqrt(across**2 - 4)
        first = _turn(bearing + atan2(2.0, line))
        yield (first, 1), (line, 0), (_turn(first - turn_rad), -1)


def _turn(angle_rad: float) -> float:
    return angle_rad % (2 * pi)


class MinimumTimeSolver:
    """The optimal control problems of one rover: a `SharedSolver` that solves within the call.

    Args:
        travel: its maximum acceleration, m/s².
        rotate: its maximum rotational acceleration, rad/s².
        steps: intervals of a trajectory.
        obstacles: whether there may be obstacles.
        radius_m: minimum turning radius; None for a rover that turns on the spot.

    Attributes:
        pause: called between the slices of a search for a detour.

    Raises:
        SettingsError: casadi is not installed.
    """

    lead_ticks = 0
    busy = False

    def __init__(
        self,
        model: MotionModel,
        travel: float,
        rotate: float,
        steps: int,
        obstacles: bool = False,
        radius_m: float | None = None,
    ) -> None:
        self.pause: Callable[[], None] = lambda: None
        self._limits = (travel, rotate)
        self._steps = steps
        self._plan: Trajectory | None = None
        self._model = model
        self._radius_m = radius_m
        self._among_none = self._built(False)
        self._among_obstacles = self._built(True) if obstacles else []

    def request(self, problem: TrajectoryProblem) -> None:
        """Solve a problem."""
        self._plan = self.solve(problem)

    def take_result(self) -> Trajectory | None:
        """Return the result of the last request, once."""
        plan, self._plan = self._plan, None
        return plan

    def fork(self, apart: bool = False) -> "MinimumTimeSolver":
        """Return another solver that shares the compiled problems."""
        return copy(self)

    def solve(self, problem: TrajectoryProblem) -> Trajectory | None:
        """Return the trajectory of a problem, or None if none is found.

        If the guess collides with a newly detected obstacle, a detour around it is tried.
        """
        programmes = self._among_none if problem.obstacles is None else self._among_obstacles
        programme = programmes[len(problem.via_points)]
        if problem.guess is not None:
            least_s = (MIN_DURATION_S,) * len(problem.targets)
            plan = self._solve_clear_of_obstacles(
                programme, problem, self._guess_via_points(problem, problem.guess), least_s
            )
            if plan is not None or programme.is_clear_of_obstacles(
                problem.guess, problem.obstacles
            ):
                return plan
        maximum = MAX_GUESSES if problem.guess is None else 1
        first, around = problem.targets[0], self._around(problem)
        best: Trajectory | None = None
        for guess in self._guesses(problem, problem.start, first, around=around)[:maximum]:
            whole = self._guess_via_points(problem, guess)
            plan = self._solve_clear_of_obstacles(programme, problem, whole, self._least_s(problem))
            if plan is not None and (best is None or plan.terminal_error < best.terminal_error):
                best = plan
            if best is not None and best.terminal_error <= NO_MISS:
                break
        return best

    @staticmethod
    def _solve_clear_of_obstacles(
        programme: OptimalControlProblem,
        problem: TrajectoryProblem,
        guess: Trajectory,
        least_s: Sequence[float],
    ) -> Trajectory | None:
        """Return a trajectory clear of all obstacles, or None if none is found.

        If the first one approaches other obstacles than its guess, it is the next guess.
        """
        for _ in range(OBSTACLE_REFINEMENTS):
            plan = programme.solve(problem, guess, least_s)
            if plan is None or programme.is_clear_of_obstacles(plan, problem.obstacles):
                return plan
            guess = plan
        return None

    def _built(self, obstacles: bool) -> list[OptimalControlProblem]:
        """Return the optimal control problems for each number of via points."""
        return [
            OptimalControlProblem(
                self._model, self._limits, self._steps, passes, obstacles, self._radius_m
            )
            for passes in range(MAX_VIA_POINTS + 1)
        ]

    def _around(self, problem: TrajectoryProblem) -> tuple[Point, ...]:
        """Return the corners of a detour around obstacles to the first target of a problem."""
        if problem.detour_points or problem.obstacles is None:
            return problem.detour_points
        ahead_m, first = self._model.ahead_m, problem.targets[0]
        start, end = problem.start.point_behind(ahead_m), first.base(ahead_m)
        return problem.obstacles.detour(start, end, self.pause)

    def _guess_via_points(self, problem: TrajectoryProblem, guess: Trajectory) -> Trajectory:
        """Extend a guess by polylines to all targets of a problem."""
        for target in problem.targets[len(guess.via_times_s) + 1 :]:
            end, speeds_mps = guess.states[-1], [each.travel_mps for each in guess.states]
            along = next((each for each in reversed(speeds_mps) if abs(each) > SLOW_MPS), 0.0)
            guess = guess.joined_with(self._guesses(problem, end, target, along)[0])
        return guess

    def _guesses(
        self,
        problem: TrajectoryProblem,
        start: MotionState,
        target: TrajectoryTarget,
        along: float = 0.0,
        around: tuple[Point, ...] = (),
    ) -> list[Trajectory]:
        """Return the fastest guesses from rest, for a rover that arrived forward or backward.

        A guess that keeps the direction need not stop at the via point. Guesses that collide are
        left out, unless all do.
        """
        travel = Bounds(problem.travel_mps, self._limits[0])
        rotate = Bounds(problem.rotate_radps, self._limits[1])
        point, stop_s = Point(start.x_m, start.y_m), travel.speed / travel.acceleration
        guesses = []
        ends = point, start.heading_rad, target.point, target.polyline_rad, travel, rotate, around
        found = turning_paths(*ends, self._radius_m) if self._radius_m else initial_guesses(*ends)
        found.sort(key=lambda each: each.duration_s + stop_s * (each.direction * along < 0.0))
        for each in self._free(found, problem.obstacles) or found[:MAX_GUESSES]:
            times_s = (each.duration_s * index / self._steps for index in range(self._steps + 1))
            states = tuple(MotionState(*each.at(time_s, travel, rotate)) for time_s in times_s)
            guesses.append(Trajectory(each.duration_s, states, each.end_rad))
        return guesses or [
            Trajectory(MIN_DURATION_S, (start,) * (self._steps + 1), start.heading_rad)
        ]

    @staticmethod
    def _free(found: list[Polyline], obstacles: ObstacleConstraints | None) -> list[Polyline]:
        """Return the first polylines that are clear of obstacles."""
        if obstacles is None:
            return found[:MAX_GUESSES]
        return list(
            islice((each for each in found if obstacles.is_free(each.corners)), MAX_GUESSES)
        )

    def _least_s(self, problem: TrajectoryProblem) -> tuple[float, ...]:
        """Return lower bounds of the durations from rest, so that none is zero."""
        start, target = problem.start, problem.target
        travel = Bounds(problem.travel_mps, self._limits[0])
        targets = [TrajectoryTarget(start.x_m, start.y_m, start.heading_rad, 0.0), *problem.targets]
        distances_m = [
            max(
                before.point.distance_m(after.point)
                - before.position_tolerance_m
                - after.position_tolerance_m,
                0.0,
            )
            for before, after in pairwise(targets)
        ]
        if problem.via_points:
            times_s = [distance_m / travel.speed for distance_m in distances_m]
        else:
            turn_rad = (
                abs(wrap_rad(target.heading_rad - start.heading_rad)) - target.heading_tolerance_rad
            )
            rotate = Bounds(problem.rotate_radps, self._limits[1])
            times_s = [
                max(duration_s(distances_m[0], travel), duration_s(max(turn_rad, 0.0), rotate))
            ]
        return tuple(max(MIN_DURATION_S, MIN_TIME_FACTOR * time_s) for time_s in times_s)
