"""Model predictive control: its plans, and the rover that drives by them, in lock step."""

import sys
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from math import hypot, pi
from pathlib import Path
from threading import Event

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adapters.onboard.planning import BackgroundSolver
from executive.commands import Command, FollowPath, MoveTo, Request, Waypoint
from executive.motion import (
    MinimumTimeSolver,
    SharedSolver,
    Trajectory,
    TrajectoryProblem,
    make_locomotion,
    make_solver,
)
from executive.motion.motion_model import MotionState
from executive.motion.predictive_control import model_of
from executive.motion.trajectory import TrajectoryTarget
from executive.settings import Controller, SettingsError, load_settings
from executive.state import Status
from executive.values.clock import ManualClock
from executive.values.geometry import Pose, Velocity, wrap_rad
from executive.values.reports import Identity, Report, ReportKind, Severity, Stage
from sim.rover import World
from sim.rover.jackal import SimulatedJackal
from sim.rover.lockstep import LockStep
from tests.conftest import databases_closed
from tests.support.kinematic import KinematicRover

pytestmark = pytest.mark.alike

JACKAL = replace(load_settings("jackal"), controller=Controller.MPC)
AHEAD_M = JACKAL.turn_drive.control_point_m
ASIDE = Waypoint(1.0, 1.0, pi / 2)


@pytest.fixture(scope="module")
def solver() -> MinimumTimeSolver:
    return make_solver(JACKAL)


class Failing:
    """A solver that finds nothing in some of its calls, or plans that do not lead there."""

    lead_ticks = 0
    busy = False

    def __init__(
        self, solver: MinimumTimeSolver, fails: Callable[[int], bool], miss: float | None = None
    ) -> None:
        self._solver, self._fails, self._miss = solver, fails, miss
        self._requested = 0

    def request(self, problem: TrajectoryProblem) -> None:
        self._requested += 1
        self._solver.request(problem)

    def take_result(self) -> Trajectory | None:
        plan = self._solver.take_result()
        if plan is None or not self._fails(self._requested):
            return plan
        return None if self._miss is None else replace(plan, terminal_error=self._miss)

    def fork(self, apart: bool = False) -> SharedSolver:
        return self._solver.fork(apart)


@pytest.mark.at_length
@settings(max_examples=15, deadline=None, derandomize=True)
@given(
    x_m=st.floats(-6.0, 6.0),
    y_m=st.floats(-6.0, 6.0),
    heading_rad=st.floats(-pi, pi),
    travel_mps=st.floats(0.2, 1.0),
    rotate_radps=st.floats(0.3, 1.5),
)
def test_a_plan_respects_the_limits_and_ends_at_its_target(
    solver: MinimumTimeSolver,
    x_m: float,
    y_m: float,
    heading_rad: float,
    travel_mps: float,
    rotate_radps: float,
) -> None:
    target = TrajectoryTarget(x_m, y_m, heading_rad)
    start = MotionState(AHEAD_M, 0.0, 0.0)
    plan = solver.solve(TrajectoryProblem(start, target, travel_mps, rotate_radps, None))
    assert plan is not None
    end, step_s = plan.states[-1], plan.duration_s / (len(plan.states) - 1)
    assert plan.terminal_error < 0.01
    assert (
        hypot(end.x_m - x_m, end.y_m - y_m)
        <= target.position_tolerance_m + plan.terminal_error + 1e-3
    )
    assert (
        abs(wrap_rad(end.heading_rad - heading_rad))
        <= target.heading_tolerance_rad + plan.terminal_error + 1e-3
    )
    assert abs(end.travel_mps) < 1e-3 > abs(end.rotate_radps)
    for before, after in zip(plan.states, plan.states[1:], strict=False):
        assert abs(after.travel_mps) <= travel_mps + 1e-3
        assert abs(after.rotate_radps) <= rotate_radps + 1e-3
        assert abs(after.travel_mps - before.travel_mps) <= 1.0 * step_s + 1e-3
        assert abs(after.rotate_radps - before.rotate_radps) <= 3.0 * step_s + 1e-3


def test_a_straight_line_takes_its_least_time(solver: MinimumTimeSolver) -> None:
    start, target = (
        MotionState(AHEAD_M, 0.0, 0.0),
        TrajectoryTarget(4.0 + AHEAD_M, 0.0, 0.0, position_tolerance_m=0.0),
    )
    plan = solver.solve(TrajectoryProblem(start, target, 1.0, 1.5, None))
    assert plan is not None
    assert plan.duration_s == pytest.approx(5.0, rel=0.01)


def drive(lockstep: LockStep, request: Request, limit_s: float = 60.0) -> Stage:
    def ended() -> bool:
        return any(each.stage is not None and each.stage.terminal for each in reports(lockstep))

    lockstep.run(0.5)
    lockstep.submit(Command(Identity("test", 1), request, "direct"))
    lockstep.run_until(ended, limit_s)
    lockstep.run(0.5)
    lockstep.executive.simulate_crash()
    stage = reports(lockstep)[-1].stage
    assert stage is not None
    return stage


def reports(lockstep: LockStep) -> list[Report]:
    return [each for each in lockstep.downlink_record.reports if each.stage is not None]


def alarms(lockstep: LockStep) -> list[str]:
    return [
        each.text
        for each in lockstep.downlink_record.reports
        if each.kind is ReportKind.EVENT and each.severity is not Severity.INFORMATIONAL
    ]


def off(pose: Pose, target: Waypoint) -> tuple[float, float]:
    distance_m = hypot(pose.x_m - target.x_m, pose.y_m - target.y_m)
    return distance_m, abs(wrap_rad(pose.heading_rad - (target.heading_rad or 0.0)))


@pytest.mark.at_length
@pytest.mark.parametrize(
    "target", [Waypoint(-1.0, 0.3, 0.0), Waypoint(0.0, 0.5, 0.0), Waypoint(1.0, -1.0, pi)]
)
def test_a_curve_truly_reaches_the_target_without_a_fault(
    target: Waypoint, solver: MinimumTimeSolver, tmp_path: Path
) -> None:
    lockstep = LockStep(JACKAL, World(), tmp_path, solver=solver)
    assert drive(lockstep, MoveTo(target)) is Stage.EXECUTED
    seen_m, seen_rad = off(lockstep.executive.status.pose, target)
    true_m, true_rad = off(lockstep.rover.true_pose, target)
    assert (seen_m, seen_rad) < (0.03, 0.035)
    assert true_m < 0.06
    assert true_rad < 0.05
    assert alarms(lockstep) == []


@pytest.fixture(scope="module")
def aside(solver: MinimumTimeSolver, tmp_path_factory: pytest.TempPathFactory) -> LockStep:
    """Give a run that was driven aside by mpc; it is over, and only looked at."""
    with databases_closed():
        lockstep = LockStep(JACKAL, World(), tmp_path_factory.mktemp("aside"), solver=solver)
        assert drive(lockstep, MoveTo(ASIDE)) is Stage.EXECUTED
    return lockstep


def took_s(lockstep: LockStep) -> float:
    return reports(lockstep)[-1].figures[0].value


@pytest.mark.at_length
def test_it_takes_less_time_than_turn_then_drive(
    solver: MinimumTimeSolver, aside: LockStep, tmp_path: Path
) -> None:
    chosen = replace(JACKAL, controller=Controller.TURN_DRIVE)
    lockstep = LockStep(chosen, World(), tmp_path, solver=solver)
    assert drive(lockstep, MoveTo(ASIDE)) is Stage.EXECUTED
    assert took_s(aside) < 0.8 * took_s(lockstep)


def ends_at(request: MoveTo | FollowPath) -> Waypoint:
    return request.target if isinstance(request, MoveTo) else request.waypoints[-1]


@pytest.mark.at_length
@pytest.mark.parametrize(
    "request_",
    [
        MoveTo(Waypoint(-1.0, 1.0)),
        MoveTo(Waypoint(0.6, 0.2, tolerance_m=0.01)),
        FollowPath((Waypoint(0.5, 0.0), Waypoint(0.5, 0.5, pi))),
    ],
)
def test_a_target_without_heading_or_with_more_precision_is_executed(
    request_: MoveTo | FollowPath, solver: MinimumTimeSolver, tmp_path: Path
) -> None:
    lockstep = LockStep(JACKAL, World(), tmp_path, solver=solver)
    assert drive(lockstep, request_) is Stage.EXECUTED
    last = ends_at(request_)
    assert off(lockstep.executive.status.pose, last)[0] < 0.03


@pytest.mark.at_length
def test_for_more_precision_turn_then_drive_truly_ends_there(
    solver: MinimumTimeSolver, tmp_path: Path
) -> None:
    target = Waypoint(0.6, -0.9, 2.0, tolerance_m=0.02)
    lockstep = LockStep(JACKAL, World(), tmp_path, solver=solver)
    assert drive(lockstep, MoveTo(target)) is Stage.EXECUTED
    true_m, true_rad = off(lockstep.rover.true_pose, target)
    assert true_m < 0.02
    assert true_rad < pi / 180


class NextTick:
    """A solver beside the thread, whose answers are there when the next tick asks for them."""

    lead_ticks = 1
    busy = False

    def __init__(self, solver: BackgroundSolver) -> None:
        self._solver = solver

    def request(self, problem: TrajectoryProblem) -> None:
        self._solver.request(problem)

    def take_result(self) -> Trajectory | None:
        while self._solver.busy:
            Event().wait(0.001)
        return self._solver.take_result()

    def fork(self, apart: bool = False) -> "NextTick":
        return NextTick(self._solver.fork(apart))


@pytest.mark.at_length
def test_plans_from_another_thread_are_for_the_tick_after(
    solver: MinimumTimeSolver, aside: LockStep, tmp_path: Path
) -> None:
    with closing(BackgroundSolver(solver)) as beside:
        lockstep = LockStep(JACKAL, World(), tmp_path, solver=NextTick(beside))
        assert drive(lockstep, MoveTo(ASIDE)) is Stage.EXECUTED
    for run in (aside, lockstep):
        assert off(run.executive.status.pose, ASIDE)[0] < 0.03
    assert took_s(lockstep) <= took_s(aside) + 0.1 + 1e-6  # it begins a tick later


class Late:
    """A solver beside the thread, whose answers come so late."""

    lead_ticks = 1

    def __init__(self, solver: MinimumTimeSolver, late_s: float) -> None:
        self._solver, self._late_s = solver, late_s
        self._free_s = 0.0
        self.now_s: Callable[[], float] = lambda: 0.0

    @property
    def busy(self) -> bool:
        return self.now_s() < self._free_s

    def request(self, problem: TrajectoryProblem) -> None:
        self._solver.request(problem)
        self._free_s = self.now_s() + self._late_s

    def take_result(self) -> Trajectory | None:
        return self._solver.take_result()

    def fork(self, apart: bool = False) -> SharedSolver:
        return self._solver.fork(apart)


@pytest.mark.at_length
@pytest.mark.parametrize("late_s", [0.12, 0.37])
def test_while_a_plan_is_late_the_one_before_is_driven_on(
    late_s: float, solver: MinimumTimeSolver, tmp_path: Path
) -> None:
    late = Late(solver, late_s)
    lockstep = LockStep(JACKAL, World(), tmp_path, solver=late)
    late.now_s = lockstep.clock.now_s
    assert drive(lockstep, MoveTo(ASIDE)) is Stage.EXECUTED
    assert off(lockstep.executive.status.pose, ASIDE)[0] < 0.03
    assert [each.text for each in reports(lockstep) if each.stage is Stage.PROGRESS] == []


def test_after_late_ticks_a_plan_continues_from_the_actual_pose(
    solver: MinimumTimeSolver, tmp_path: Path
) -> None:
    late = Late(solver, 0.04)
    lockstep = LockStep(JACKAL, World(), tmp_path, solver=late)
    late.now_s = lockstep.clock.now_s
    lockstep.run(0.5)
    lockstep.submit(Command(Identity("test", 1), MoveTo(ASIDE), "direct"))
    lockstep.run(1.0)
    lockstep.alive = False
    lockstep.run(0.4)
    lockstep.alive = True
    lockstep.run(4.0)
    lockstep.executive.simulate_crash()
    assert reports(lockstep)[-1].stage is Stage.EXECUTED
    assert [each.text for each in reports(lockstep) if each.stage is Stage.PROGRESS] == []


class Stuck:
    """A solver that never comes back, until it is let go."""

    lead_ticks = 0
    busy = False

    def __init__(self) -> None:
        self.released = Event()

    def request(self, problem: TrajectoryProblem) -> None:
        self.released.wait()

    def take_result(self) -> Trajectory | None:
        return None

    def fork(self, apart: bool = False) -> "Stuck":
        return self


def test_a_solver_that_never_answers_delays_nothing_and_is_replaced(tmp_path: Path) -> None:
    stuck = Stuck()
    with closing(BackgroundSolver(stuck)) as beside:
        lockstep = LockStep(JACKAL, World(), tmp_path, solver=beside)
        lockstep.run(0.5)
        for number, target in enumerate((Waypoint(0.5, 0.3), ASIDE), 1):
            command = Command(Identity("test", number), MoveTo(target), "direct")
            lockstep.submit(command)
        lockstep.run(12.0)
        lockstep.executive.simulate_crash()
        stuck.released.set()
    stages = [each.stage for each in reports(lockstep)]
    assert stages.count(Stage.EXECUTED) == 2
    texts = [each.text for each in reports(lockstep) if each.stage is Stage.PROGRESS]
    assert texts == 2 * ["mpc: no plan in time; turn-then-drive takes over"]


def test_two_runs_are_alike(tmp_path: Path) -> None:
    paths: list[list[Pose]] = []
    for name in ("one", "other"):
        lockstep = LockStep(JACKAL, World(), tmp_path / name, seed=3)
        lockstep.submit(Command(Identity("test", 1), MoveTo(ASIDE), "direct"))
        poses = []
        for _ in range(30):
            lockstep.run(0.1)
            poses.append(lockstep.rover.true_pose)
        lockstep.executive.simulate_crash()
        paths.append(poses)
    assert paths[0] == paths[1]


@pytest.mark.at_length
@pytest.mark.parametrize("miss", [None, 1.0])
def test_without_usable_plans_turn_then_drive_continues_and_reports_it(
    miss: float | None, solver: MinimumTimeSolver, tmp_path: Path
) -> None:
    failing = Failing(solver, lambda requested: requested > 20, miss)
    lockstep = LockStep(JACKAL, World(), tmp_path, solver=failing)
    assert drive(lockstep, MoveTo(Waypoint(3.0, 2.0, 0.0))) is Stage.EXECUTED
    texts = [each.text for each in reports(lockstep) if each.stage is Stage.PROGRESS]
    assert texts == ["mpc: no usable plan; turn-then-drive takes over"]
    assert off(lockstep.executive.status.pose, Waypoint(3.0, 2.0, 0.0))[0] < 0.03
    assert alarms(lockstep) == []


@pytest.mark.at_length
def test_a_few_ticks_without_an_answer_go_by_the_plan_before(
    solver: MinimumTimeSolver, tmp_path: Path
) -> None:
    failing = Failing(solver, lambda requested: requested > 1 and requested % 4 != 0)
    lockstep = LockStep(JACKAL, World(), tmp_path, solver=failing)
    assert drive(lockstep, MoveTo(ASIDE)) is Stage.EXECUTED
    assert Stage.PROGRESS not in [each.stage for each in reports(lockstep)]
    assert reports(lockstep)[-1].figures[0].value < 3.5


def test_without_casadi_one_error_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(SettingsError, match=r"pip install 'rover-executive\[mpc\]'"):
        make_solver(JACKAL)


def test_an_executive_without_solver_and_rovers_that_move_by_themselves_are_refused() -> None:
    clock = ManualClock()
    with pytest.raises(SettingsError, match="needs a trajectory solver"):
        make_locomotion(KinematicRover(), clock, JACKAL, Status(clock, JACKAL))
    with pytest.raises(ValueError, match="locomotion is velocity"):
        replace(load_settings("mocup"), controller=Controller.MPC)


def test_the_model_turns_as_the_simulated_rover_does() -> None:
    """On a curve that speeds up and brakes at its end: within 4° of 100°, with the yaw response."""
    model, rover = model_of(JACKAL), SimulatedJackal(World())
    rover.advance(0.5)
    state: list[float] = [0.0] * 6
    for tick in range(70):
        left = max(60 - tick, 0)
        travel_mps = min(0.05 * tick, 1.0, 0.05 * left)
        rotate_radps = min(0.1 * tick, 0.8, 0.1 * left)
        controls = ((travel_mps - state[3]) / 0.05, (rotate_radps - state[4]) / 0.05)
        state = model.advance(state, controls, 0.05)
        rover.drive(Velocity(travel_mps, rotate_radps))
        rover.advance(0.05)
    off_rad = wrap_rad(rover.true_pose.heading_rad - state[2])
    assert off_rad == pytest.approx(0.0, abs=0.07)
