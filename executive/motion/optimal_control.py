"""The minimum-time motion as a non-linear programme, built and solved by casadi.

Direct multiple shooting with free durations, to each via point and to the end. Each interval is one
step of the rover's model; the controls are the accelerations of the commanded velocity. Fatrop
solves it stage by stage, or ipopt if casadi has no fatrop. casadi is the extra `mpc`, imported when
a programme is built.
"""

from collections.abc import Sequence
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
EFFORT_COST: Final = 2e-3
"""Cost of full acceleration throughout, s: smooths plans. Chosen, not measured."""
FASTER_RADPS: Final = 0.05
"""Increase of the yaw rate allowed to a rover that turns at its limit or faster."""
MAX_DURATION_S: Final = 600.0
ITERATIONS: Final = 40
MIN_INTERVALS: Final = 10
"""Minimum number of intervals to each via point."""
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
        model: the rover.
        limits: its maximum accelerations, of travel in m/s² and of rotation in rad/s².
        steps: intervals of a plan without via points.
        passes: number of via points.
        obstacles: whether it has obstacle constraints.

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
    ) -> None:
        self._model = model
        self._limits = limits
        self._passes = passes
        self._obstacles = obstacles
        self._count = steps if not passes else max(steps // 2, MIN_INTERVALS)
        self._durations = slice(_STATE, _STATE + passes + 1)
        self._miss = _STATE + passes + 1
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
        end = [target.x_m, target.y_m, guess.heading_rad, target.aim_m, target.aim_rad]
        passed = [
            figure
            for each in problem.via_points
            for figure in (each.x_m, each.y_m, each.aim_m, each.behind_m)
        ]
        rows: list[float] = []
        if problem.obstacles is not None:
            halves = resample(guess.at, guess.passes_s, guess.duration_s, 2 * self._count).states
            rows = problem.obstacles.rows(
                [each.point_behind(self._model.ahead_m) for each in halves]
            )
        low, high = self._bounds(problem, least_s)
        found = self._solver(
            x0=self._vector(guess),
            p=[*start.figures, *end, target.behind_m, fastest_radps, *passed, *rows],
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

        def keep_away(at: tuple[Any, Any], miss: Any) -> None:
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
                moved = self._model.advance(ca.vertsplit(state), pair, step_s, ca)
                require(True, nodes[index + 1] - ca.vertcat(*moved, durations, miss))
            if index == 0:
                require(True, state - parameters[:_STATE])
            else:
                turning = self._model.true_rotation(state[4], state[5], ca)
                require(False, turning - fastest_radps, -turning - fastest_radps)
                keep_away(self._base(ca, ca.vertsplit(state)), miss)
            if index < steps:
                midway = self._midway(ca, ca.vertsplit(state), moved, step_s)
                keep_away(midway, miss)
            if 0 < index < steps and index % count == 0:
                at = _FIXED + _PASS * (index // count - 1)
                position_x_m, position_y_m, near_m, back_m = ca.vertsplit(
                    parameters[at : at + _PASS]
                )
                require(False, beyond(node, position_x_m, position_y_m, back_m, near_m))
        end, miss = nodes[-1], nodes[-1][self._miss]
        off_rad = end[2] - heading_rad
        require(True, end[3], end[4])
        require(
            False,
            beyond(end, x_m, y_m, behind_m, aim_m),
            off_rad - aim_rad - miss,
            -off_rad - aim_rad - miss,
        )
        effort = sum(ca.sumsqr(each / ca.DM(self._limits)) for each in controls) / steps
        takes_s = ca.sum1(nodes[0][self._durations])
        cost = takes_s + MISS_COST * nodes[0][self._miss] + EFFORT_COST * effort
        pairs = zip(nodes, [*controls, ca.SX(0, 1)], strict=True)
        problem = {
            "x": ca.vertcat(*(part for pair in pairs for part in pair)),
            "f": cost,
            "g": ca.vertcat(*rows),
            "p": parameters,
        }
        self._lowest = [0.0 if each else -inf for each in equal]
        return _nlpsol(ca, problem, equal)

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
        edges_s = (0.0, *plan.passes_s, plan.duration_s)
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
        self, problem: TrajectoryProblem, least_s: Sequence[float]
    ) -> tuple[list[float], list[float]]:
        """Return bounds of the variables; speeds above their limit now may only decrease."""
        start, shared = problem.start, self._passes + 2
        travel = max(problem.travel_mps, abs(start.travel_mps))
        rotate = max(problem.rotate_radps, abs(start.rotate_radps))
        first_low = [*[-inf] * _STATE, *least_s, 0.0]
        first_high = [*[inf] * _STATE, *[MAX_DURATION_S] * len(least_s), inf]
        limits = list(self._limits)
        high = [*limits, inf, inf, inf, travel, rotate, inf, *[inf] * shared]
        low = [-each for each in high]
        steps = self._count * (self._passes + 1)
        return [*first_low, *low * steps], [*first_high, *high * steps]

    def _vector(self, guess: Trajectory) -> list[float]:
        """Return the variables of a plan."""
        edges_s = (0.0, *guess.passes_s, guess.duration_s)
        durations_s = [end_s - begin_s for begin_s, end_s in pairwise(edges_s)]
        states = resample(guess.at, guess.passes_s, guess.duration_s, self._count).states
        vector: list[float] = []
        for index, state in enumerate(states):
            vector += [*state.figures, *durations_s, guess.miss]
            if index < len(states) - 1:
                step_s = durations_s[index // self._count] / self._count
                pair = (state.travel_mps, state.rotate_radps)
                after = (states[index + 1].travel_mps, states[index + 1].rotate_radps)
                for low, high, maximum in zip(pair, after, self._limits, strict=True):
                    vector.append(max(-maximum, min(maximum, (high - low) / step_s)))
        return vector

    def _read(self, figures: list[float], heading_rad: float) -> Trajectory:
        stage = self._miss + 1 + 2
        states = tuple(
            MotionState(*figures[at : at + _STATE]) for at in range(0, len(figures), stage)
        )
        *passes_s, duration_s = accumulate(figures[self._durations])
        return Trajectory(duration_s, states, heading_rad, figures[self._miss], tuple(passes_s))


def _casadi() -> Any:
    """Return casadi.

    Raises:
        SettingsError: it is not installed.
    """
    try:
        return import_module("casadi")
    except ImportError as error:
        raise SettingsError(
            "controller: mpc needs casadi, which is not installed: install the extra mpc"
            " (pip install 'rover-executive[mpc]'); controller: turn_drive needs no extra"
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
