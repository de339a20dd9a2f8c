"""The fastest motion from a state to rest at a pose, as a non-linear programme solved by casadi.

Multiple shooting over a free duration: one Runge-Kutta step of the rover's model in each of so many
intervals, with the accelerations of the commanded velocity as controls. Fatrop solves it stage by
stage; ipopt does where casadi comes without fatrop. casadi is the extra `mpc`, imported when a
solver is made.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from math import cos, exp, inf, isfinite, pi, sin, sqrt, tanh
from types import SimpleNamespace
from typing import Any, Final, Protocol

from executive.geometry import Point, Velocity, wrap_rad
from executive.motion.locomotion import Bounds, duration_s
from executive.motion.polylines import polylines
from executive.settings import SideSlip, YawResponse
from executive.settings_files import SettingsError

MISS_COST: Final = 30.0
"""Seconds for each metre and radian beyond the aim: so there is an answer to every problem."""
EFFORT_COST: Final = 2e-3
"""Seconds for full acceleration all the time: smooths plans among which time does not decide."""
FASTER_RADPS: Final = 0.05
"""By how much a rover that turns at its limit or faster may turn faster still."""
SHORTEST_S: Final = 0.05
LONGEST_S: Final = 600.0
FASTEST_SHARE: Final = 0.6
"""Of the least time by what is commanded: a rover that drives turns faster than commanded."""
ITERATIONS: Final = 60
STARTS: Final = 3
"""Guesses that are tried at most, where those before them end beyond the aim or nowhere."""
NO_MISS: Final = 1e-3
_SMOOTH: Final = 1e-6
_SLIP_FROM: Final = 0.02
"""Squares of speeds, below which magnitudes and the root of the side slip are smoothed."""


@dataclass(frozen=True, slots=True)
class MotionState:
    """How the control point moves.

    Attributes:
        heading_rad: not wrapped: turning goes on beyond pi.
        travel_mps, rotate_radps: the commanded velocity that is in effect.
        lag_radps: the part of the true rotation that follows the command late.
    """

    x_m: float
    y_m: float
    heading_rad: float
    travel_mps: float = 0.0
    rotate_radps: float = 0.0
    lag_radps: float = 0.0

    @property
    def figures(self) -> tuple[float, ...]:
        """All of it, in its order."""
        speeds = (self.travel_mps, self.rotate_radps, self.lag_radps)
        return self.x_m, self.y_m, self.heading_rad, *speeds


@dataclass(frozen=True, slots=True)
class Target:
    """Where the control point is to stand.

    Attributes:
        heading_rad: of the rover; with a guess beside it, not wrapped.
        aim_m, aim_rad: within which of it a plan ends: narrower than the tolerances, since less
            than a point takes less time.
    """

    x_m: float
    y_m: float
    heading_rad: float
    aim_m: float = 0.012
    aim_rad: float = pi / 180


@dataclass(frozen=True, slots=True)
class Plan:
    """States at equal intervals, from the start to rest.

    Attributes:
        heading_rad: of the target, as its headings go on beyond pi.
        miss: metres and radians beyond the aim in which it ends.
    """

    duration_s: float
    states: tuple[MotionState, ...]
    heading_rad: float
    miss: float = 0.0

    def at(self, time_s: float) -> MotionState:
        """Return the state so many seconds after the start; the last one beyond the end."""
        count = len(self.states) - 1
        place = min(max(time_s / self.duration_s, 0.0), 1.0) * count
        before = min(int(place), count - 1)
        part = place - before
        pair = zip(self.states[before].figures, self.states[before + 1].figures, strict=True)
        return MotionState(*(low + part * (high - low) for low, high in pair))

    def velocity(self, time_s: float) -> Velocity:
        """Return the velocity that is commanded so many seconds after the start."""
        state = self.at(time_s)
        return Velocity(state.travel_mps, state.rotate_radps)

    def after(self, time_s: float) -> "Plan":
        """Return the rest of it, from so many seconds after the start."""
        left_s = max(self.duration_s - time_s, SHORTEST_S)
        count = len(self.states) - 1
        states = (self.at(time_s + left_s * index / count) for index in range(count + 1))
        return Plan(left_s, tuple(states), self.heading_rad, self.miss)


@dataclass(frozen=True, slots=True)
class Problem:
    """What a plan is asked for.

    Attributes:
        travel_mps, rotate_radps: greatest speeds.
        guess: a plan near the answer; None: from rest, where polylines are tried.
    """

    start: MotionState
    target: Target
    travel_mps: float
    rotate_radps: float
    guess: Plan | None


class PlanSolver(Protocol):
    """Answers problems, in the call that asks or beside the thread that does.

    Attributes:
        lead_ticks: how many ticks after its question an answer is used.
        busy: whether it is at a question still, and takes no other.
    """

    lead_ticks: int
    busy: bool

    def ask(self, problem: Problem) -> None:
        """Have a problem solved."""

    def answer(self) -> Plan | None:
        """Return the answer to the last question, once; None where there is none, or none yet."""


_PLAIN: Final = SimpleNamespace(sin=sin, cos=cos, sqrt=sqrt, tanh=tanh, exp=exp)


@dataclass(frozen=True, slots=True)
class MotionModel:
    """How a rover answers to commands: with numbers, or with the expressions of a module `ops`.

    Attributes:
        ahead_m: of the control point, from base_link.
    """

    yaw: YawResponse
    slip: SideSlip
    ahead_m: float

    def true_rotation(self, rotate: Any, lag: Any, ops: Any = _PLAIN) -> Any:
        """Return how fast the rover turns, in rad/s, with a rotation commanded and a lag."""
        yaw = self.yaw
        return yaw.gain * rotate - yaw.drag_radps * ops.tanh(rotate / yaw.drag_at_radps) + lag

    def advance(
        self, state: Sequence[Any], controls: tuple[Any, Any], step: Any, ops: Any = _PLAIN
    ) -> list[Any]:
        """Return a state after a step of so many seconds, of fourth order.

        Args:
            state: the figures of a `MotionState`, in its order.
            controls: the accelerations of the commanded travel and rotation.
            step: how long.
            ops: has `sin`, `cos`, `sqrt`, `tanh` and `exp` of these figures.
        """
        travel_mps2, rotate_radps2 = controls
        *pose, travel, rotate, lag = state
        midway = travel + travel_mps2 * step / 2, rotate + rotate_radps2 * step / 2
        late, lag_s = self._late(*midway, travel_mps2, ops), self.yaw.lag_s
        decay = ops.exp(-step / lag_s)  # exact: a step may be many times longer than the lag
        mean = late + (lag - late) * (1 - decay) * lag_s / step
        end = travel + travel_mps2 * step, rotate + rotate_radps2 * step

        def along(rates: Sequence[Any], part: Any) -> list[Any]:
            return [figure + part * rate for figure, rate in zip(pose, rates, strict=True)]

        first = self._rates(pose[2], travel, rotate, mean, ops)
        second = self._rates(along(first, step / 2)[2], *midway, mean, ops)
        third = self._rates(along(second, step / 2)[2], *midway, mean, ops)
        fourth = self._rates(along(third, step)[2], *end, mean, ops)
        slopes = zip(first, second, third, fourth, strict=True)
        moved = along([(a + 2 * b + 2 * c + d) / 6 for a, b, c, d in slopes], step)
        return [*moved, *end, late + (lag - late) * decay]

    def _late(self, travel: Any, rotate: Any, travel_mps2: Any, ops: Any) -> Any:
        """Return what the lag goes to."""
        yaw = self.yaw
        of_turning = (
            yaw.travel * travel
            + yaw.travel_squared * travel**2
            + yaw.speed * ops.sqrt(travel**2 + _SMOOTH)
            - (yaw.acceleration + yaw.acceleration_travel * travel) * travel_mps2
        )
        late = rotate * ops.sqrt(rotate**2 + _SMOOTH) * of_turning
        return late - yaw.load * travel_mps2 * rotate

    def _rates(self, heading: Any, travel: Any, rotate: Any, lag: Any, ops: Any) -> list[Any]:
        """Return the rates of x, y and heading."""
        true = self.true_rotation(rotate, lag, ops)
        magnitude = ops.sqrt(travel**2 + _SLIP_FROM)
        root = ops.sqrt(ops.sqrt(true**2 + _SLIP_FROM) / magnitude)
        across = (self.ahead_m - self.slip.offset_m - self.slip.gain_m * travel * root) * true
        cosine, sine = ops.cos(heading), ops.sin(heading)
        return [travel * cosine - across * sine, travel * sine + across * cosine, true]


_STATE: Final = 6
_NODE: Final = _STATE + 2
"""A state, the duration and the miss; the last two are the same in every node."""
_DURATION, _MISS = _STATE, _STATE + 1


class MinimumTime:
    """The programme of one rover: a `PlanSolver` that answers in the call that asks.

    Args:
        model: the rover.
        travel: its greatest acceleration, m/s².
        rotate: its greatest acceleration of rotation, rad/s².
        steps: intervals of a plan.

    Raises:
        SettingsError: casadi is not installed.
    """

    lead_ticks = 0
    busy = False

    def __init__(self, model: MotionModel, travel: float, rotate: float, steps: int) -> None:
        self._most = (travel, rotate)
        self._steps = steps
        self._plan: Plan | None = None
        self._model = model
        self._solver, self._lowest = self._build()

    def ask(self, problem: Problem) -> None:
        """Solve a problem."""
        self._plan = self.solve(problem)

    def answer(self) -> Plan | None:
        """Return the answer to the last question, once."""
        plan, self._plan = self._plan, None
        return plan

    def solve(self, problem: Problem) -> Plan | None:
        """Return the plan of a problem, or None where none is found."""
        if problem.guess is not None:
            return self._from_guess(problem, problem.guess)
        best: Plan | None = None
        for guess in self._guesses(problem)[:STARTS]:
            plan = self._from_guess(problem, guess, self._least_s(problem))
            if plan is not None and (best is None or plan.miss < best.miss):
                best = plan
            if best is not None and best.miss <= NO_MISS:
                break
        return best

    def _guesses(self, problem: Problem) -> list[Plan]:
        start, target = problem.start, problem.target
        travel = Bounds(problem.travel_mps, self._most[0])
        rotate = Bounds(problem.rotate_radps, self._most[1])
        place, end = Point(start.x_m, start.y_m), Point(target.x_m, target.y_m)
        guesses = []
        found = polylines(place, start.heading_rad, end, target.heading_rad, travel, rotate)
        for each in found[:STARTS]:
            times_s = (each.duration_s * index / self._steps for index in range(self._steps + 1))
            states = tuple(MotionState(*each.at(time_s, travel, rotate)) for time_s in times_s)
            guesses.append(Plan(each.duration_s, states, each.end_rad))
        return guesses

    def _least_s(self, problem: Problem) -> float:
        """Return a time that no plan from rest is shorter than, so that none is of no length."""
        start, target = problem.start, problem.target
        place, end = Point(start.x_m, start.y_m), Point(target.x_m, target.y_m)
        way_m = max(place.distance_m(end) - target.aim_m, 0.0)
        turn_rad = max(abs(wrap_rad(target.heading_rad - start.heading_rad)) - target.aim_rad, 0.0)
        travel_s = duration_s(way_m, Bounds(problem.travel_mps, self._most[0]))
        rotate_s = duration_s(turn_rad, Bounds(problem.rotate_radps, self._most[1]))
        return max(SHORTEST_S, FASTEST_SHARE * max(travel_s, rotate_s))

    def _from_guess(
        self, problem: Problem, guess: Plan, least_s: float = SHORTEST_S
    ) -> Plan | None:
        start, target = problem.start, problem.target
        present_radps = abs(self._model.true_rotation(start.rotate_radps, start.lag_radps))
        fastest_radps = max(problem.rotate_radps, present_radps + FASTER_RADPS)
        place = [target.x_m, target.y_m, guess.heading_rad, target.aim_m, target.aim_rad]
        low, high = self._bounds(problem, least_s)
        found = self._solver(
            x0=self._vector(guess),
            p=[*start.figures, *place, fastest_radps],
            lbx=low,
            ubx=high,
            lbg=self._lowest,
            ubg=0.0,
        )
        figures = found["x"].nonzeros()
        if not self._solver.stats()["success"] or not all(map(isfinite, figures)):
            return None
        return self._read(figures, guess.heading_rad)

    def _build(self) -> tuple[Any, list[float]]:
        """Return the solver, and the lower bounds of its constraints; all upper ones are 0."""
        ca = _casadi()
        nodes = [ca.SX.sym(f"x{index}", _NODE) for index in range(self._steps + 1)]
        controls = [ca.SX.sym(f"u{index}", 2) for index in range(self._steps)]
        asked = ca.SX.sym("p", _STATE + 6)
        x_m, y_m, heading_rad, aim_m, aim_rad, fastest_radps = ca.vertsplit(asked[_STATE:])
        rows: list[Any] = []
        equal: list[bool] = []

        def require(kind: bool, *expressions: Any) -> None:
            row = ca.vertcat(*expressions)
            rows.append(row)
            equal.extend([kind] * row.shape[0])

        for index, node in enumerate(nodes):
            state, duration, miss = node[:_STATE], node[_DURATION], node[_MISS]
            if index < self._steps:
                pair = tuple(ca.vertsplit(controls[index]))
                moved = self._model.advance(ca.vertsplit(state), pair, duration / self._steps, ca)
                require(True, nodes[index + 1] - ca.vertcat(*moved, duration, miss))
            if index == 0:
                require(True, state - asked[:_STATE])
            else:
                turning = self._model.true_rotation(state[4], state[5], ca)
                require(False, turning - fastest_radps, -turning - fastest_radps)
        end, miss = nodes[-1], nodes[-1][_MISS]
        off_rad = end[2] - heading_rad
        require(True, end[3], end[4])
        require(
            False,
            (end[0] - x_m) ** 2 + (end[1] - y_m) ** 2 - (aim_m + miss) ** 2,
            off_rad - aim_rad - miss,
            -off_rad - aim_rad - miss,
        )
        effort = sum(ca.sumsqr(each / ca.DM(self._most)) for each in controls) / self._steps
        cost = nodes[0][_DURATION] + MISS_COST * nodes[0][_MISS] + EFFORT_COST * effort
        pairs = zip(nodes, [*controls, ca.SX(0, 1)], strict=True)
        problem = {
            "x": ca.vertcat(*(part for pair in pairs for part in pair)),
            "f": cost,
            "g": ca.vertcat(*rows),
            "p": asked,
        }
        return _nlpsol(ca, problem, equal), [0.0 if each else -inf for each in equal]

    def _bounds(self, problem: Problem, least_s: float) -> tuple[list[float], list[float]]:
        """Return bounds of the variables; speeds that are above their limit now may go down."""
        start = problem.start
        travel = max(problem.travel_mps, abs(start.travel_mps))
        rotate = max(problem.rotate_radps, abs(start.rotate_radps))
        free = [inf, inf, inf, travel, rotate, inf, inf, inf]
        low, high = [-each for each in free], list(free)
        low[_DURATION], high[_DURATION], low[_MISS] = least_s, LONGEST_S, 0.0
        first_low, first_high = [-inf] * _STATE + low[_STATE:], [inf] * _STATE + high[_STATE:]
        slowest, most = [-each for each in self._most], list(self._most)
        node_low, node_high = [*low[:_STATE], -inf, -inf], [*high[:_STATE], inf, inf]
        return (
            [*first_low, *(slowest + node_low) * self._steps],
            [*first_high, *(most + node_high) * self._steps],
        )

    def _vector(self, guess: Plan) -> list[float]:
        """Return the variables of a plan."""
        step_s = guess.duration_s / self._steps
        states = [guess.at(index * step_s) for index in range(self._steps + 1)]
        vector: list[float] = []
        for index, state in enumerate(states):
            vector += [*state.figures, guess.duration_s, guess.miss]
            if index < self._steps:
                pair = (state.travel_mps, state.rotate_radps)
                after = (states[index + 1].travel_mps, states[index + 1].rotate_radps)
                for low, high, most in zip(pair, after, self._most, strict=True):
                    vector.append(max(-most, min(most, (high - low) / step_s)))
        return vector

    def _read(self, figures: list[float], heading_rad: float) -> Plan:
        stage = _NODE + 2
        states = tuple(
            MotionState(*figures[at : at + _STATE]) for at in range(0, len(figures), stage)
        )
        return Plan(figures[_DURATION], states, heading_rad, figures[_MISS])


def _casadi() -> Any:
    """Return casadi.

    Raises:
        SettingsError: it is not installed.
    """
    try:
        return import_module("casadi")
    except ImportError as error:
        raise SettingsError(
            "controller: mpc needs casadi, which is not installed: it comes with the extra mpc"
            " (pip install 'rover-executive[mpc]'); controller: turn_drive needs nothing more"
        ) from error


def _nlpsol(ca: Any, problem: dict[str, Any], equal: list[bool]) -> Any:
    common = {"expand": True, "print_time": False, "error_on_fail": False}
    if ca.has_nlpsol("fatrop"):
        fatrop = {"mu_init": 1e-2, "tol": 1e-3, "max_iter": ITERATIONS, "print_level": 0}
        return ca.nlpsol("minimum_time", "fatrop", problem, {
            **common, "structure_detection": "auto", "equality": equal, "fatrop": fatrop,
        })  # fmt: skip
    ipopt = {
        "print_level": 0, "sb": "yes", "mu_init": 1e-2, "tol": 1e-3, "max_iter": 2 * ITERATIONS,
    }  # fmt: skip
    return ca.nlpsol("minimum_time", "ipopt", problem, {**common, "ipopt": ipopt})
