"""The fastest motion from a state to rest at a pose, as a non-linear programme solved by casadi.

Multiple shooting over a free duration, to the end and to each place passed before it: one step of
the rover's model in each of so many intervals, with the accelerations of the
commanded velocity as controls. Fatrop solves it stage by stage; ipopt does where casadi comes
without fatrop. casadi is the extra `mpc`, imported when a solver is made.
"""

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from itertools import accumulate, pairwise
from math import cos, exp, inf, isfinite, pi, sin, sqrt, tanh
from types import SimpleNamespace
from typing import Any, Final, Protocol

from executive.geometry import Point, Velocity, wrap_rad
from executive.motion.locomotion import Bounds, duration_s
from executive.motion.polylines import polylines
from executive.mpc_settings import Slip, YawResponse
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
ITERATIONS: Final = 40
STARTS: Final = 3
"""Guesses that are tried at most, where those before them end beyond the aim or nowhere."""
NO_MISS: Final = 1e-3
FEWEST_BETWEEN: Final = 10
"""Intervals to each place, where some are passed, at least."""
SLOW_MPS: Final = 0.01
PASSED_AT_ONCE: Final = 1
"""Places that one plan leads through at most, before it ends."""
ANY_RAD: Final = 10.0
"""An aim of the heading that all headings are within."""
_GAUSS: Final = (0.5 - sqrt(3.0) / 6, 0.5 + sqrt(3.0) / 6)
"""Of a step, where it is integrated from: two points of Gauss make it of fourth order."""
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

    @property
    def polyline_rad(self) -> float | None:
        """The heading at the end of a polyline; None where it is free."""
        return self.heading_rad if self.aim_rad < ANY_RAD else None


@dataclass(frozen=True, slots=True)
class Plan:
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

    def after(self, time_s: float, most: int = 0) -> "Plan":
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
        rest = _sampled(lambda at_s: self.at(time_s + at_s), passes_s, left_s, count)
        return replace(rest, heading_rad=self.heading_rad, miss=self.miss)

    def extended(self, onward: "Plan") -> "Plan":
        """Return it with another plan after it, which passes where this one ends."""

        def at(time_s: float) -> MotionState:
            left_s = time_s - self.duration_s
            return self.at(time_s) if left_s < 0.0 else onward.at(left_s)

        passes_s = (*self.passes_s, self.duration_s)
        passes_s += tuple(self.duration_s + each for each in onward.passes_s)
        count = len(onward.states) - 1
        whole = _sampled(at, passes_s, self.duration_s + onward.duration_s, count)
        return replace(whole, heading_rad=onward.heading_rad, miss=self.miss)


def _sampled(
    at: Callable[[float], MotionState], passes_s: tuple[float, ...], duration_s: float, count: int
) -> Plan:
    """Return a plan of so many equal intervals to each place that is passed, and to the end."""
    edges_s = (0.0, *passes_s, duration_s)
    times_s = [
        begin_s + (end_s - begin_s) * index / count
        for begin_s, end_s in pairwise(edges_s)
        for index in range(count)
    ]
    states = tuple(at(time_s) for time_s in (*times_s, duration_s))
    return Plan(duration_s, states, states[-1].heading_rad, passes_s=passes_s)


@dataclass(frozen=True, slots=True)
class Problem:
    """What a plan is asked for.

    Attributes:
        travel_mps, rotate_radps: greatest speeds.
        guess: a plan near the answer, to fewer places perhaps; None: from rest, where polylines
            are tried.
        through: places to pass before the target, of any heading: `PASSED_AT_ONCE` at most.
    """

    start: MotionState
    target: Target
    travel_mps: float
    rotate_radps: float
    guess: Plan | None
    through: tuple[Target, ...] = ()

    @property
    def targets(self) -> tuple[Target, ...]:
        """The places to pass, and the target."""
        return *self.through, self.target


class PlanSolver(Protocol):
    """Answers problems, in the call that asks or beside the thread that does.

    Attributes:
        lead_ticks: how many ticks after its question an answer is used.
    """

    lead_ticks: int

    @property
    def busy(self) -> bool:
        """Whether it is at a question still, and takes no other."""

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
    slip: Slip
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
        x, y, heading, travel, rotate, lag = state
        midway = travel + travel_mps2 * step / 2, rotate + rotate_radps2 * step / 2
        late, lag_s = self._late(*midway, travel_mps2, ops), self.yaw.lag_s
        decay = ops.exp(-step / lag_s)  # exact: a step may be many times longer than the lag
        mean = late + (lag - late) * (1 - decay) * lag_s / step
        speeds = [
            (travel + travel_mps2 * step * part, rotate + rotate_radps2 * step * part)
            for part in _GAUSS
        ]
        first, second = (self.true_rotation(each[1], mean, ops) for each in speeds)
        turning, gain = (first + second) / 2, (second - first) * sqrt(3.0)
        for part, pair, true in zip(_GAUSS, speeds, (first, second), strict=True):
            toward = heading + step * (part * turning - gain / 12)
            along, across = self._speeds(pair[0], true, travel_mps2, ops)
            cosine, sine = ops.cos(toward), ops.sin(toward)
            x = x + step / 2 * (along * cosine - across * sine)
            y = y + step / 2 * (along * sine + across * cosine)
        end = travel + travel_mps2 * step, rotate + rotate_radps2 * step
        return [x, y, heading + step * turning, *end, late + (lag - late) * decay]

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

    def _speeds(self, travel: Any, true: Any, travel_mps2: Any, ops: Any) -> tuple[Any, Any]:
        """Return how fast the control point moves ahead and to its left; slip is settled."""
        magnitude = ops.sqrt(travel**2 + _SLIP_FROM)
        turning = ops.sqrt(true**2 + _SLIP_FROM)
        root, slip = ops.sqrt(turning / magnitude), self.slip
        about = slip.offset_m + slip.gain_m * travel * root - slip.acceleration_s2 * travel_mps2
        along = travel - slip.creep_s2 * travel_mps2 * turning
        return along, (self.ahead_m - about) * true


_STATE: Final = 6
_PASS: Final = 4
"""Parameters of a place that is passed: x, y, aim, and how far behind the control point."""


@dataclass(frozen=True, slots=True)
class _Programme:
    """A solver for a number of places that are passed.

    In each node there are a state, the durations to each place and to the end, and the miss; all
    but the state are the same in every node.

    Attributes:
        solver: of casadi.
        lowest: lower bounds of its constraints; all upper ones are 0.
        passes: how many places are passed.
        count: intervals to each place, and to the end.
    """

    solver: Any
    lowest: list[float]
    passes: int
    count: int

    @property
    def durations(self) -> slice:
        """Where in a node the durations are."""
        return slice(_STATE, _STATE + self.passes + 1)

    @property
    def miss(self) -> int:
        """Where in a node the miss is."""
        return _STATE + self.passes + 1


class MinimumTime:
    """The programmes of one rover: a `PlanSolver` that answers in the call that asks.

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
        self._programmes = [self._build(passes) for passes in range(PASSED_AT_ONCE + 1)]

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
            return self._from_guess(problem, self._onward(problem, problem.guess))
        best: Plan | None = None
        for guess in self._guesses(problem, problem.start, problem.targets[0])[:STARTS]:
            whole = self._onward(problem, guess)
            plan = self._from_guess(problem, whole, self._least_s(problem))
            if plan is not None and (best is None or plan.miss < best.miss):
                best = plan
            if best is not None and best.miss <= NO_MISS:
                break
        return best

    def _onward(self, problem: Problem, guess: Plan) -> Plan:
        """Return a guess that leads to all places of a problem, by polylines from its end."""
        for target in problem.targets[len(guess.passes_s) + 1 :]:
            end, speeds_mps = guess.states[-1], [each.travel_mps for each in guess.states]
            along = next((each for each in reversed(speeds_mps) if abs(each) > SLOW_MPS), 0.0)
            guess = guess.extended(self._guesses(problem, end, target, along)[0])
        return guess

    def _guesses(
        self, problem: Problem, start: MotionState, target: Target, along: float = 0.0
    ) -> list[Plan]:
        """Return the fastest guesses from rest, for a rover that came forward or backward.

        One that goes on the same way need not stand where it passes.
        """
        travel = Bounds(problem.travel_mps, self._most[0])
        rotate = Bounds(problem.rotate_radps, self._most[1])
        place, stop_s = Point(start.x_m, start.y_m), travel.speed / travel.acceleration
        guesses = []
        found = polylines(
            place, start.heading_rad, target.point, target.polyline_rad, travel, rotate
        )
        found.sort(key=lambda each: each.duration_s + stop_s * (each.direction * along < 0.0))
        for each in found[:STARTS]:
            times_s = (each.duration_s * index / self._steps for index in range(self._steps + 1))
            states = tuple(MotionState(*each.at(time_s, travel, rotate)) for time_s in times_s)
            guesses.append(Plan(each.duration_s, states, each.end_rad))
        return guesses or [Plan(SHORTEST_S, (start,) * (self._steps + 1), start.heading_rad)]

    def _least_s(self, problem: Problem) -> tuple[float, ...]:
        """Return times that no plan from rest is shorter than, so that none is of no length."""
        start, target = problem.start, problem.target
        travel = Bounds(problem.travel_mps, self._most[0])
        places = [Target(start.x_m, start.y_m, start.heading_rad, 0.0), *problem.targets]
        ways_m = [
            max(before.point.distance_m(after.point) - before.aim_m - after.aim_m, 0.0)
            for before, after in pairwise(places)
        ]
        if problem.through:
            times_s = [way_m / travel.speed for way_m in ways_m]
        else:
            turn_rad = abs(wrap_rad(target.heading_rad - start.heading_rad)) - target.aim_rad
            rotate = Bounds(problem.rotate_radps, self._most[1])
            times_s = [max(duration_s(ways_m[0], travel), duration_s(max(turn_rad, 0.0), rotate))]
        return tuple(max(SHORTEST_S, FASTEST_SHARE * time_s) for time_s in times_s)

    def _from_guess(
        self, problem: Problem, guess: Plan, least_s: tuple[float, ...] | None = None
    ) -> Plan | None:
        start, target = problem.start, problem.target
        programme = self._programmes[len(problem.through)]
        present_radps = abs(self._model.true_rotation(start.rotate_radps, start.lag_radps))
        fastest_radps = max(problem.rotate_radps, present_radps + FASTER_RADPS)
        end = [target.x_m, target.y_m, guess.heading_rad, target.aim_m, target.aim_rad]
        passed = [
            figure
            for each in problem.through
            for figure in (each.x_m, each.y_m, each.aim_m, each.behind_m)
        ]
        least = (SHORTEST_S,) * len(problem.targets) if least_s is None else least_s
        low, high = self._bounds(problem, programme, least)
        found = programme.solver(
            x0=self._vector(guess, programme),
            p=[*start.figures, *end, target.behind_m, fastest_radps, *passed],
            lbx=low,
            ubx=high,
            lbg=programme.lowest,
            ubg=0.0,
        )
        figures = found["x"].nonzeros()
        if not programme.solver.stats()["success"] or not all(map(isfinite, figures)):
            return None
        return self._read(figures, guess.heading_rad, programme)

    def _build(self, passes: int) -> _Programme:
        """Return the programme for a number of places that are passed."""
        ca = _casadi()
        count = self._steps if not passes else max(self._steps // 2, FEWEST_BETWEEN)
        steps = count * (passes + 1)
        built = _Programme(None, [], passes, count)
        nodes = [ca.SX.sym(f"x{index}", built.miss + 1) for index in range(steps + 1)]
        controls = [ca.SX.sym(f"u{index}", 2) for index in range(steps)]
        asked = ca.SX.sym("p", _STATE + 7 + _PASS * passes)
        x_m, y_m, heading_rad, aim_m, aim_rad, behind_m, fastest_radps = ca.vertsplit(
            asked[_STATE : _STATE + 7]
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
            return off_x_m**2 + off_y_m**2 - (aim_m + node[built.miss]) ** 2

        for index, node in enumerate(nodes):
            state, durations, miss = node[:_STATE], node[built.durations], node[built.miss]
            if index < steps:
                pair = tuple(ca.vertsplit(controls[index]))
                step_s = durations[index // count] / count
                moved = self._model.advance(ca.vertsplit(state), pair, step_s, ca)
                require(True, nodes[index + 1] - ca.vertcat(*moved, durations, miss))
            if index == 0:
                require(True, state - asked[:_STATE])
            else:
                turning = self._model.true_rotation(state[4], state[5], ca)
                require(False, turning - fastest_radps, -turning - fastest_radps)
            if 0 < index < steps and index % count == 0:
                at = _STATE + 7 + _PASS * (index // count - 1)
                place_x_m, place_y_m, near_m, back_m = ca.vertsplit(asked[at : at + _PASS])
                require(False, beyond(node, place_x_m, place_y_m, back_m, near_m))
        end, miss = nodes[-1], nodes[-1][built.miss]
        off_rad = end[2] - heading_rad
        require(True, end[3], end[4])
        require(
            False,
            beyond(end, x_m, y_m, behind_m, aim_m),
            off_rad - aim_rad - miss,
            -off_rad - aim_rad - miss,
        )
        effort = sum(ca.sumsqr(each / ca.DM(self._most)) for each in controls) / steps
        takes_s = ca.sum1(nodes[0][built.durations])
        cost = takes_s + MISS_COST * nodes[0][built.miss] + EFFORT_COST * effort
        pairs = zip(nodes, [*controls, ca.SX(0, 1)], strict=True)
        problem = {
            "x": ca.vertcat(*(part for pair in pairs for part in pair)),
            "f": cost,
            "g": ca.vertcat(*rows),
            "p": asked,
        }
        lowest = [0.0 if each else -inf for each in equal]
        return replace(built, solver=_nlpsol(ca, problem, equal), lowest=lowest)

    def _bounds(
        self, problem: Problem, programme: _Programme, least_s: tuple[float, ...]
    ) -> tuple[list[float], list[float]]:
        """Return bounds of the variables; speeds that are above their limit now may go down."""
        start, shared = problem.start, programme.passes + 2
        travel = max(problem.travel_mps, abs(start.travel_mps))
        rotate = max(problem.rotate_radps, abs(start.rotate_radps))
        first_low = [*[-inf] * _STATE, *least_s, 0.0]
        first_high = [*[inf] * _STATE, *[LONGEST_S] * len(least_s), inf]
        most = list(self._most)
        high = [*most, inf, inf, inf, travel, rotate, inf, *[inf] * shared]
        low = [-each for each in high]
        steps = programme.count * (programme.passes + 1)
        return [*first_low, *low * steps], [*first_high, *high * steps]

    def _vector(self, guess: Plan, programme: _Programme) -> list[float]:
        """Return the variables of a plan."""
        edges_s = (0.0, *guess.passes_s, guess.duration_s)
        durations_s = [end_s - begin_s for begin_s, end_s in pairwise(edges_s)]
        states = _sampled(guess.at, guess.passes_s, guess.duration_s, programme.count).states
        vector: list[float] = []
        for index, state in enumerate(states):
            vector += [*state.figures, *durations_s, guess.miss]
            if index < len(states) - 1:
                step_s = durations_s[index // programme.count] / programme.count
                pair = (state.travel_mps, state.rotate_radps)
                after = (states[index + 1].travel_mps, states[index + 1].rotate_radps)
                for low, high, most in zip(pair, after, self._most, strict=True):
                    vector.append(max(-most, min(most, (high - low) / step_s)))
        return vector

    def _read(self, figures: list[float], heading_rad: float, programme: _Programme) -> Plan:
        stage = programme.miss + 1 + 2
        states = tuple(
            MotionState(*figures[at : at + _STATE]) for at in range(0, len(figures), stage)
        )
        *passes_s, duration_s = accumulate(figures[programme.durations])
        miss = figures[programme.miss]
        return Plan(duration_s, states, heading_rad, miss, tuple(passes_s))


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
        fatrop = {"mu_init": 1e-3, "tol": 1e-3, "max_iter": ITERATIONS, "print_level": 0}
        return ca.nlpsol("minimum_time", "fatrop", problem, {
            **common, "structure_detection": "auto", "equality": equal, "fatrop": fatrop,
        })  # fmt: skip
    ipopt = {
        "print_level": 0, "sb": "yes", "mu_init": 1e-2, "tol": 1e-3, "max_iter": 2 * ITERATIONS,
    }  # fmt: skip
    return ca.nlpsol("minimum_time", "ipopt", problem, {**common, "ipopt": ipopt})
