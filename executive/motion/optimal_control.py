"""`OptimalControlProblem`: the minimum-time motion as non-linear programme, solved by casadi.

Direct multiple shooting with free durations, to each via point and to the end. Each interval is one
step of the rover's model; the controls are the accelerations of the commanded velocity. Fatrop
solves it stage by stage, or ipopt if casadi has no fatrop. casadi is the extra `mpc`, imported when
a programme is built.

For a base with a minimum turning radius a state has the curvature of the path in place of the
rotation: its bounds then hold forward, backward and where the direction changes.
"""

from collections.abc import Sequence
from dataclasses import replace
from importlib import import_module
from itertools import accumulate, islice, pairwise
from math import inf, isfinite
from typing import Any, Final

from executive.motion.motion_model import MotionModel, MotionState
from executive.motion.obstacle_constraints import ROW, SLOTS, ObstacleConstraints
from executive.motion.trajectory import Trajectory, TrajectoryProblem, resample
from executive.settings import SettingsError
from executive.values.geometry import Point

MISS_COST: Final = 30.0
"""Cost of the miss (soft constraint), s per metre and radian. Chosen, not measured."""
MANOEUVRE_MISS_COST: Final = 300.0
"""The same of a base that corrects a miss by a manoeuvre of seconds."""
EFFORT_COST: Final = 2e-3
"""Cost of full acceleration throughout, s: smooths plans. Chosen, not measured."""
FASTER_RADPS: Final = 0.05
"""Increase of the yaw rate allowed to a rover that turns at its limit or faster."""
MAX_DURATION_S: Final = 600.0
ITERATIONS: Final = 40
MIN_INTERVALS: Final = 10
"""Minimum number of intervals to each via point."""
STEER_S: Final = 1.0
"""Time to steer from one end to the other. Chosen, not measured."""
MIN_STEERED_MPS: Final = 0.05
"""Speed above which a plan starts at the curvature of the rover."""
STEERED: Final = 0.02
"""Tolerance of that curvature, rad/m."""
_STATE: Final = 6
_PASS: Final = 4
"""Parameters of a via point: x, y, tolerance, and its distance behind the control point."""
_FIXED: Final = _STATE + 7
"""Parameters before those of the via points: of the start, and of the end."""


class OptimalControlProblem:
    """The programme for a number of via points, among obstacles or on free ground.

    Each node holds a state, the durations to each via point and to the end, and the miss. All
    except the state are equal in every node.

    Args:
        limits: its maximum accelerations, of travel in m/s² and of rotation in rad/s².
        steps: intervals of a plan without via points.
        passes: number of via points.
        obstacles: whether it has obstacle constraints.
        radius_m: minimum turning radius; None for a rover that turns on the spot.

    Raises:
        SettingsError: casadi is not installed.
    """

    def __init__(
        self,
        model: MotionModel,
        limits: tuple[float, float],
        steps: int,
        passes: int,
        obstacles: bool,
        radius_m: float | None = None,
    ) -> None:
        self._model = model
        self._limits = limits
        self._passes = passes
        self._obstacles = obstacles
        self._curvature = None if radius_m is None else 1.0 / radius_m
        self._count = steps if not passes else max(steps // 2, MIN_INTERVALS)
        self._durations = slice(_STATE, _STATE + passes + 1)
        self._miss = _STATE + passes + 1
        steering = limits[1] if radius_m is None else 2.0 / radius_m / STEER_S
        self._controls = limits[0], steering
        given = range(_STATE) if radius_m is None else (0, 1, 2, 3, 5)  # not the curvature
        self._given = list(given)
        self._lowest: list[float] = []  # lower bounds of its constraints; all upper bounds are 0
        self._solver = self._build(_casadi())

    def solve(
        self, problem: TrajectoryProblem, guess: Trajectory, least_s: Sequence[float]
    ) -> Trajectory | None:
        """Return the plan of a problem with `passes` via points; None if none is found.

        Args:
            problem: the problem.
            guess: near the solution, with all via points.
            least_s: minimum duration to each via point and to the end.
        """
        start, target = problem.start, problem.target
        present_radps = abs(self._model.true_rotation(start.rotate_radps, start.lag_radps))
        fastest_radps = max(problem.rotate_radps, present_radps + FASTER_RADPS)
        end = [
            target.x_m,
            target.y_m,
            guess.heading_rad,
            target.position_tolerance_m,
            target.heading_tolerance_rad,
        ]
        passed = [
            figure
            for each in problem.via_points
            for figure in (each.x_m, each.y_m, each.position_tolerance_m, each.base_offset_m)
        ]
        figures = self._figures(start, guess.states)
        rows: list[float] = []
        if problem.obstacles is not None:
            halves = resample(guess.at, guess.via_times_s, guess.duration_s, 2 * self._count).states
            rows = problem.obstacles.rows(
                [each.point_behind(self._model.ahead_m) for each in halves]
            )
        low, high = self._bounds(problem, least_s, figures)
        found = self._solver(
            x0=self._vector(guess),
            p=[*figures, *end, target.base_offset_m, fastest_radps, *passed, *rows],
            lbx=low,
            ubx=high,
            lbg=self._lowest,
            ubg=0.0,
        )
        figures = found["x"].nonzeros()
        if not self._solver.stats()["success"] or not all(map(isfinite, figures)):
            return None
        return self._read(figures, guess.heading_rad)

    def is_clear_of_obstacles(
        self, plan: Trajectory, obstacles: ObstacleConstraints | None
    ) -> bool:
        """Return whether a plan is clear of all obstacles."""
        return obstacles is None or obstacles.is_free(self._path(plan))

    def _build(self, ca: Any) -> Any:
        """Return the solver of casadi."""
        count, steps = self._count, self._count * (self._passes + 1)
        nodes = [ca.SX.sym(f"x{index}", self._miss + 1) for index in range(steps + 1)]
        controls = [ca.SX.sym(f"u{index}", 2) for index in range(steps)]
        first_row = _FIXED + _PASS * self._passes
        row_count = 2 * steps * SLOTS if self._obstacles else 0
        parameters = ca.SX.sym("p", first_row + row_count * ROW)
        away_rows = iter(ca.vertsplit(parameters[first_row:], ROW)) if self._obstacles else iter(())
        x_m, y_m, heading_rad, aim_m, aim_rad, behind_m, fastest_radps = ca.vertsplit(
            parameters[_STATE:_FIXED]
        )
        rows: list[Any] = []
        equal: list[bool] = []

        def require(kind: bool, *expressions: Any) -> None:
            row = ca.vertcat(*expressions)
            rows.append(row)
            equal.extend([kind] * row.shape[0])

        def beyond(node: Any, x_m: Any, y_m: Any, behind_m: Any, aim_m: Any) -> Any:
            off_x_m = node[0] - behind_m * ca.cos(node[2]) - x_m
            off_y_m = node[1] - behind_m * ca.sin(node[2]) - y_m
            return off_x_m**2 + off_y_m**2 - (aim_m + node[self._miss]) ** 2

        def avoid(at: tuple[Any, Any], miss: Any) -> None:
            for row in islice(away_rows, SLOTS):
                x_m, y_m, curvature, away_x, away_y, clearance_m = ca.vertsplit(row)
                off_x_m, off_y_m = at[0] - x_m, at[1] - y_m
                gap_m = curvature * (off_x_m**2 + off_y_m**2) + away_x * off_x_m + away_y * off_y_m
                require(False, clearance_m - gap_m - miss)

        for index, node in enumerate(nodes):
            state, durations, miss = node[:_STATE], node[self._durations], node[self._miss]
            if index < steps:
                pair = tuple(ca.vertsplit(controls[index]))
                step_s = durations[index // count] / count
                moved, rotate_radps2 = self._advance(ca, ca.vertsplit(state), pair, step_s)
                require(True, nodes[index + 1] - ca.vertcat(*moved, durations, miss))
                if self._curvature is not None:
                    limit = self._limits[1]
                    require(False, rotate_radps2 - limit, -rotate_radps2 - limit)
            if index == 0:
                require(True, *(state[each] - parameters[each] for each in self._given))
            else:
                rotate = state[4] if self._curvature is None else state[3] * state[4]
                turning = self._model.true_rotation(rotate, state[5], ca)
                require(False, turning - fastest_radps, -turning - fastest_radps)
                avoid(self._base(ca, ca.vertsplit(state)), miss)
            if index < steps:
                midway = self._midway(ca, ca.vertsplit(state), moved, step_s)
                avoid(midway, miss)
            if 0 < index < steps and index % count == 0:
                at = _FIXED + _PASS * (index // count - 1)
                position_x_m, position_y_m, near_m, back_m = ca.vertsplit(
                    parameters[at : at + _PASS]
                )
                require(False, beyond(node, position_x_m, position_y_m, back_m, near_m))
        end, miss = nodes[-1], nodes[-1][self._miss]
        off_rad = end[2] - heading_rad
        require(True, *(end[each] for each in self._given if each in (3, 4)))
        require(
            False,
            beyond(end, x_m, y_m, behind_m, aim_m),
            off_rad - aim_rad - miss,
            -off_rad - aim_rad - miss,
        )
        effort = sum(ca.sumsqr(each / ca.DM(self._controls)) for each in controls) / steps
        takes_s = ca.sum1(nodes[0][self._durations])
        miss_cost = MISS_COST if self._curvature is None else MANOEUVRE_MISS_COST
        cost = takes_s + miss_cost * nodes[0][self._miss] + EFFORT_COST * effort
        pairs = zip(nodes, [*controls, ca.SX(0, 1)], strict=True)
        problem = {
            "x": ca.vertcat(*(part for pair in pairs for part in pair)),
            "f": cost,
            "g": ca.vertcat(*rows),
            "p": parameters,
        }
        self._lowest = [0.0 if each else -inf for each in equal]
        return _nlpsol(ca, problem, equal)

    def _advance(
        self, ca: Any, state: Sequence[Any], pair: tuple[Any, Any], step_s: Any
    ) -> tuple[list[Any], Any]:
        """Return the state after a step, and the acceleration of the rotation."""
        if self._curvature is None:
            return self._model.advance(state, pair, step_s, ca), pair[1]
        x_m, y_m, heading_rad, travel, curvature, lag = state
        travel_mps2, steering = pair
        rotate_radps2 = steering * (travel + travel_mps2 * step_s) + curvature * travel_mps2
        rotating = x_m, y_m, heading_rad, travel, travel * curvature, lag
        moved = self._model.advance(rotating, (travel_mps2, rotate_radps2), step_s, ca)
        return [*moved[:4], curvature + steering * step_s, moved[5]], rotate_radps2

    def _figures(self, state: MotionState, following: Sequence[MotionState]) -> list[float]:
        """Return the figures of a state; its curvature at rest is that of the states after it."""
        figures = list(state.figures)
        if self._curvature is not None:
            moving = (
                each for each in (state, *following) if abs(each.travel_mps) > MIN_STEERED_MPS
            )
            steered = next(moving, MotionState(0.0, 0.0, 0.0, 1.0))
            curvature = steered.rotate_radps / steered.travel_mps
            figures[4] = max(-self._curvature, min(self._curvature, curvature))
        return figures

    def _base(self, ca: Any, state: Sequence[Any]) -> tuple[Any, Any]:
        """Return the position of base_link in a state."""
        ahead_m = self._model.ahead_m
        return state[0] - ahead_m * ca.cos(state[2]), state[1] - ahead_m * ca.sin(state[2])

    def _midway(
        self, ca: Any, state: Sequence[Any], after: Sequence[Any], step_s: Any
    ) -> tuple[Any, Any]:
        """Return the position of base_link half a step later, from the speeds at both ends."""
        (x_m, y_m), (end_x_m, end_y_m) = self._base(ca, state), self._base(ca, after)
        slower_x = state[3] * ca.cos(state[2]) - after[3] * ca.cos(after[2])
        slower_y = state[3] * ca.sin(state[2]) - after[3] * ca.sin(after[2])
        return (
            (x_m + end_x_m) / 2 + step_s / 8 * slower_x,
            (y_m + end_y_m) / 2 + step_s / 8 * slower_y,
        )

    def _path(self, plan: Trajectory) -> list[Point]:
        """Return the positions of base_link at each node and midway between them, by the model."""
        edges_s = (0.0, *plan.via_times_s, plan.duration_s)
        ahead_m = self._model.ahead_m
        path = [plan.states[0].point_behind(ahead_m)]
        for index, (state, after) in enumerate(pairwise(plan.states)):
            segment = index // self._count
            step_s = (edges_s[segment + 1] - edges_s[segment]) / self._count
            controls = (
                (after.travel_mps - state.travel_mps) / step_s,
                (after.rotate_radps - state.rotate_radps) / step_s,
            )
            midway = self._model.advance(state.figures, controls, step_s / 2)
            path += [MotionState(*midway).point_behind(ahead_m), after.point_behind(ahead_m)]
        return path

    def _bounds(
        self, problem: TrajectoryProblem, least_s: Sequence[float], figures: Sequence[float]
    ) -> tuple[list[float], list[float]]:
        """Return bounds of the variables; speeds above their limit now may only decrease."""
        start, shared = problem.start, self._passes + 2
        travel = max(problem.travel_mps, abs(start.travel_mps))
        rotate = max(problem.rotate_radps, abs(start.rotate_radps))
        first_low = [*[-inf] * _STATE, *least_s, 0.0]
        first_high = [*[inf] * _STATE, *[MAX_DURATION_S] * len(least_s), inf]
        limits = list(self._controls)
        if self._curvature is not None:
            rotate = self._curvature
            steered = abs(start.travel_mps) > MIN_STEERED_MPS
            first_low[4] = figures[4] - STEERED if steered else -rotate
            first_high[4] = figures[4] + STEERED if steered else rotate
        high = [*limits, inf, inf, inf, travel, rotate, inf, *[inf] * shared]
        low = [-each for each in high]
        steps = self._count * (self._passes + 1)
        return [*first_low, *low * steps], [*first_high, *high * steps]

    def _vector(self, guess: Trajectory) -> list[float]:
        """Return the variables of a plan."""
        edges_s = (0.0, *guess.via_times_s, guess.duration_s)
        durations_s = [end_s - begin_s for begin_s, end_s in pairwise(edges_s)]
        states = resample(guess.at, guess.via_times_s, guess.duration_s, self._count).states
        figures = [self._figures(each, states[at + 1 :]) for at, each in enumerate(states)]
        vector: list[float] = []
        for index in range(len(states)):
            vector += [*figures[index], *durations_s, guess.terminal_error]
            if index < len(states) - 1:
                step_s = durations_s[index // self._count] / self._count
                pair, after = figures[index][3:5], figures[index + 1][3:5]
                for low, high, maximum in zip(pair, after, self._controls, strict=True):
                    vector.append(max(-maximum, min(maximum, (high - low) / step_s)))
        return vector

    def _read(self, figures: list[float], heading_rad: float) -> Trajectory:
        stage = self._miss + 1 + 2
        states = tuple(
            MotionState(*figures[at : at + _STATE]) for at in range(0, len(figures), stage)
        )
        if self._curvature is not None:
            states = tuple(
                replace(each, rotate_radps=each.travel_mps * each.rotate_radps) for each in states
            )
        *via_times_s, duration_s = accumulate(figures[self._durations])
        return Trajectory(duration_s, states, heading_rad, figures[self._miss], tuple(via_times_s))


def _casadi() -> Any:
    """Return casadi.

    Raises:
        SettingsError: it is not installed.
    """
    try:
        return import_module("casadi")
    except ImportError as error:
        raise SettingsError(
            "controller: mpc needs casadi, which is not installed: pip install"
            " 'rover-executive[mpc]', or in a checkout ./rover extras; controller: turn_drive needs"
            " no extra"
        ) from error


def _nlpsol(ca: Any, problem: dict[str, Any], equal: list[bool]) -> Any:
    common = {"expand": True, "print_time": False, "error_on_fail": False}
    if ca.has_nlpsol("fatrop"):
        fatrop = {"mu_init": 1e-3, "tol": 1e-3, "max_iter": ITERATIONS, "print_level": 0}
        return ca.nlpsol("minimum_time", "fatrop", problem, {
            **common, "structure_detection": "auto", "equality": equal, "fatrop": fatrop,
        })  # fmt: skip
    ipopt = {
        "print_level": 0, "sb": "yes", "mu_init": 1e-2, "tol": 1e-3, "max_iter": 2 * ITERATIONS,
    }  # fmt: skip
    return ca.nlpsol("minimum_time", "ipopt", problem, {**common, "ipopt": ipopt})
