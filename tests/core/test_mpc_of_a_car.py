"""mpc of a base that cannot turn on the spot: curves forward and backward, to every pose."""

import json
from collections.abc import Iterator
from dataclasses import replace
from math import cos, pi, sin
from pathlib import Path

import pytest

from executive.commands import FollowPath, MoveTo, Waypoint
from executive.motion import (
    Bounds,
    MinimumTimeSolver,
    Trajectory,
    TrajectoryProblem,
    TrajectoryTarget,
    make_solver,
)
from executive.motion.minimum_time import turning_paths
from executive.motion.motion_model import MotionState
from executive.obstacles.zones import KnownRock, Zones
from executive.settings import Controller, MpcSettings
from executive.values.geometry import Point, Pose, Velocity, wrap_rad
from executive.values.reasons import Reason
from executive.values.reports import Stage
from tests.core.test_turning_radius import CAR, RADIUS_M, Car
from tests.robots.interfaces import INTERFACES
from tests.robots.motion import STEP_S as SHORT_S
from tests.robots.motion import Motion
from tests.support.kinematic import Bench

GOALS = Path(__file__).parents[1] / "benchmarks" / "goals.json"
GIVEN = [
    Waypoint(each["x_m"], each["y_m"], each["heading_rad"])
    for each in json.loads(GOALS.read_text())["goals"]
]
RING = [
    Waypoint(1.5 * cos(k * pi / 12), 1.5 * sin(k * pi / 12), wrap_rad(7 * k * pi / 12))
    for k in range(24)
]
BESIDE = Waypoint(0.0, 0.5, 0.0)
SPEED_MPS, TURN_RADPS = 1.0, 1.5
ROCK = KnownRock("boulder", 2.0, 0.1, 0.3)
CURVES = replace(
    CAR,
    controller=Controller.MPC,
    mpc=MpcSettings(command_delay_s=0.15, odometry_age_s=0.0),
)
AMONG_ROCK = replace(CURVES, zones=Zones(rocks=(ROCK,)))


class SteeredCar(Car):
    """The stand-in of a car: its motors lag, and its wheels need half a second to steer."""

    def __init__(self) -> None:
        super().__init__()
        self._motion = Motion(INTERFACES["ackermann"])

    def drive(self, velocity: Velocity) -> None:
        super().drive(velocity)
        self._motion.command(velocity.travel_mps, velocity.rotate_radps)

    def advance(self, step_s: float) -> None:
        motion = self._motion
        for _ in range(round(step_s / SHORT_S)):
            motion.step()
        self.pose = Pose(motion.x_m, motion.y_m, heading_rad=wrap_rad(motion.odometry_rad))
        self.velocity = Velocity(motion.travel_mps, motion.rotate_radps)


@pytest.fixture(scope="module")
def solver() -> MinimumTimeSolver:
    return make_solver(AMONG_ROCK)


@pytest.fixture
def bench(tmp_path: Path, solver: MinimumTimeSolver) -> Iterator[Bench]:
    with Bench(tmp_path, CURVES, rover=SteeredCar(), solver=solver) as bench:
        yield bench


def off(bench: Bench, target: Waypoint) -> tuple[float, float]:
    pose = bench.rover.pose
    off_rad = 0.0 if target.heading_rad is None else wrap_rad(pose.heading_rad - target.heading_rad)
    return pose.point.distance_m(target.point), abs(off_rad)


def tightest_m(bench: Bench) -> float:
    assert isinstance(bench.rover, Car)
    return bench.rover.tightest_m


@pytest.mark.parametrize("target", [*GIVEN, *RING], ids=str)
def test_a_path_reaches_every_pose_and_a_plan_respects_the_radius(
    target: Waypoint, solver: MinimumTimeSolver
) -> None:
    bounds = Bounds(SPEED_MPS, 1.0), Bounds(TURN_RADPS, 3.0)
    start = Point(-1.0, 2.0), 1.0
    for path in turning_paths(*start, target.point, target.heading_rad, *bounds, (), RADIUS_M):
        x_m, y_m, heading_rad, *speeds = path.at(path.duration_s, *bounds)
        assert Point(x_m, y_m).distance_m(target.point) < 1e-6
        assert wrap_rad(heading_rad - (target.heading_rad or 0.0)) == pytest.approx(0.0, abs=1e-6)
        assert speeds == pytest.approx([0.0, 0.0])
    end = TrajectoryTarget(target.x_m, target.y_m, target.heading_rad or 0.0)
    problem = TrajectoryProblem(MotionState(0.0, 0.0, 0.0), end, SPEED_MPS, TURN_RADPS, None)
    plan = solver.solve(problem)
    assert plan is not None
    assert plan.terminal_error < 1e-3
    step_s = plan.duration_s / (len(plan.states) - 1)
    for before, after in zip(plan.states, plan.states[1:], strict=False):
        assert abs(after.rotate_radps) * RADIUS_M <= abs(after.travel_mps) + 1e-3
        assert abs(after.rotate_radps) <= TURN_RADPS + 1e-3
        assert abs(after.travel_mps - before.travel_mps) <= 1.0 * step_s + 1e-3
        assert abs(after.rotate_radps - before.rotate_radps) <= 3.0 * step_s + 1e-2


@pytest.mark.at_length
@pytest.mark.parametrize("target", [BESIDE, Waypoint(-1.0, 0.0, pi), *RING[::3]], ids=str)
def test_it_drives_to_a_pose(target: Waypoint, bench: Bench) -> None:
    bench.execute(MoveTo(target), 1)
    assert off(bench, target) < (0.03, 0.035)
    assert tightest_m(bench) > RADIUS_M - 1e-6


@pytest.mark.at_length
def test_it_turns_on_the_spot_and_remains_if_it_is_there(bench: Bench) -> None:
    for number, heading_rad in enumerate((pi, pi, None), start=1):
        target = Waypoint(0.0, 0.0, heading_rad)
        bench.execute(MoveTo(target), number)
        assert off(bench, target) < (0.03, 0.035)
    assert bench.last(2).figures[0].value < 1.0


@pytest.mark.at_length
def test_it_passes_waypoints_and_returns(bench: Bench) -> None:
    path = (Waypoint(1.5, 0.0), Waypoint(2.5, 1.0), Waypoint(2.5, 2.0), Waypoint(0.0, 0.0, 0.0))
    bench.execute(FollowPath(path), 1)
    assert off(bench, path[-1]) < (0.03, 0.035)
    assert tightest_m(bench) > RADIUS_M - 1e-6


@pytest.mark.at_length
@pytest.mark.parametrize("heading_rad", [None, 0.0, pi / 2])
def test_it_drives_around_a_rock(
    heading_rad: float | None, solver: MinimumTimeSolver, tmp_path: Path
) -> None:
    with Bench(tmp_path, AMONG_ROCK, rover=SteeredCar(), solver=solver) as bench:
        target = Waypoint(4.0, 0.0, heading_rad)
        bench.submit(MoveTo(target), 1)
        nearest_m = 10.0
        while not bench.stages(1)[-1].terminal:
            bench.step()
            point = bench.rover.pose.point
            nearest_m = min(nearest_m, ROCK.clearance_m(point, point))
        assert bench.stages(1)[-1] is Stage.EXECUTED
        assert off(bench, target) < (0.03, 0.035)
    assert AMONG_ROCK.footprint is not None
    assert nearest_m > AMONG_ROCK.footprint.radius_m + AMONG_ROCK.zones.margin_m - 0.03


class PlanningNothing:
    """A solver that finds no plan."""

    lead_ticks = 0
    busy = False

    def request(self, problem: TrajectoryProblem) -> None: ...

    def take_result(self) -> Trajectory | None:
        return None

    def fork(self, apart: bool = False) -> "PlanningNothing":
        return self


def test_without_a_plan_it_tries_again_and_then_fails_with_a_reason(tmp_path: Path) -> None:
    with Bench(tmp_path, CURVES, rover=Car(), solver=PlanningNothing()) as bench:
        bench.submit(MoveTo(BESIDE), 1)
        assert bench.finish(1) is Stage.FAILED
        assert bench.last(1).reason is Reason.TURN_TOO_TIGHT
        notes = [each.text for each in bench.received.reports if "plans again" in each.text]
        assert len(notes) > 1
