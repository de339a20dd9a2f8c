"""Paths that model predictive control drives as one motion, over a rover that moves as told."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from math import hypot, pi
from pathlib import Path

import pytest

from executive.commands import FollowPath, MoveTo, SetTravelSpeed, Waypoint
from executive.faults import ClearPolicy, Reaction
from executive.motion import MinimumTimeSolver, Trajectory, TrajectoryProblem, make_solver
from executive.settings import Controller, MpcSettings, Settings, load_settings
from executive.values.geometry import STANDING, Point, Pose
from executive.values.reasons import Reason
from executive.values.reports import Stage
from tests.support.kinematic import STEP_S, Bench, KinematicRover

pytestmark = pytest.mark.alike

JACKAL = load_settings("jackal")
STEPPED = MpcSettings(steps=10, command_delay_s=STEP_S / 2, odometry_age_s=0.0)
SMOOTH = replace(JACKAL, controller=Controller.MPC, mpc=STEPPED)
LOW_V, FULL_V = 20.0, 26.0
CORNERS = (Waypoint(1.5, 0.0), Waypoint(2.5, 1.0), Waypoint(1.5, 2.0), Waypoint(0.0, 2.0))
STRAIGHT = FollowPath((Waypoint(1.0, 0.0), Waypoint(2.0, 0.0), Waypoint(3.0, 0.0)))
AHEAD_M = JACKAL.turn_drive.control_point_m


class Noted(KinematicRover):
    """Notes where it was, and how fast."""

    def __init__(self) -> None:
        super().__init__()
        self.been: list[tuple[Point, float]] = []

    def advance(self, step_s: float) -> None:
        super().advance(step_s)
        self.been.append((self.pose.point, abs(self.velocity.travel_mps)))

    def near(self, waypoint: Waypoint) -> tuple[float, float]:
        """Return how near it came, to half a step, and how slow it was within a step of that."""
        position = Point(waypoint.x_m, waypoint.y_m)
        near_m = min(position.distance_m(point) for point, _ in self.been)
        slow_mps = min(
            mps for point, mps in self.been if position.distance_m(point) < near_m + 0.05
        )
        return near_m, slow_mps


class Wrapped:
    """A solver whose problems or answers a test changes."""

    lead_ticks = 0
    busy = False

    def __init__(
        self,
        solver: MinimumTimeSolver,
        problem: Callable[[int, TrajectoryProblem], TrajectoryProblem] = lambda _, problem: problem,
        plan: Callable[[int, Trajectory | None], Trajectory | None] = lambda _, plan: plan,
    ) -> None:
        self._solver, self._problem, self._plan = solver, problem, plan
        self._requested = 0

    def request(self, problem: TrajectoryProblem) -> None:
        self._requested += 1
        self._solver.request(self._problem(self._requested, problem))

    def take_result(self) -> Trajectory | None:
        return self._plan(self._requested, self._solver.take_result())

    def fork(self, apart: bool = False) -> MinimumTimeSolver:
        return self._solver.fork(apart)


@pytest.fixture(scope="module")
def solver() -> MinimumTimeSolver:
    return make_solver(SMOOTH)


@pytest.fixture
def rover() -> Noted:
    return Noted()


@pytest.fixture
def bench(tmp_path: Path, rover: Noted, solver: MinimumTimeSolver) -> Iterator[Bench]:
    with Bench(tmp_path, SMOOTH, rover=rover, solver=solver) as bench:
        yield bench


def progress(bench: Bench) -> list[tuple[int | None, int | None, str]]:
    reports = [each for each in bench.received.reports if each.stage is Stage.PROGRESS]
    return [(each.step, each.step_count, each.text) for each in reports]


def duration_s(bench: Bench, number: int = 1) -> float:
    return bench.last(number).figures[0].value


@pytest.mark.at_length
def test_waypoints_are_passed_without_standstill_and_reported_as_usual(
    bench: Bench, rover: Noted, tmp_path: Path
) -> None:
    bench.execute(FollowPath(CORNERS), 1)
    for waypoint in CORNERS[:-1]:
        near_m, slow_mps = rover.near(waypoint)
        assert near_m < 0.03 + 0.025
        assert slow_mps > 0.2
    assert rover.near(CORNERS[-1])[0] < 0.03
    with Bench(tmp_path / "turn drive", JACKAL) as standing:
        standing.execute(FollowPath(CORNERS), 1)
        assert progress(bench) == progress(standing)
        assert duration_s(bench) < 0.6 * duration_s(standing)


@pytest.mark.at_length
@pytest.mark.parametrize(
    "requesting", [Waypoint(1.5, 0.5, tolerance_m=0.01), Waypoint(1.5, 0.5, 0.5)]
)
def test_it_halts_at_a_waypoint_with_a_heading_or_more_precision(
    bench: Bench, rover: Noted, requesting: Waypoint
) -> None:
    bench.execute(FollowPath((Waypoint(0.7, 0.0), requesting, Waypoint(3.0, 0.5))), 1)
    assert rover.near(Waypoint(0.7, 0.0))[1] > 0.2
    near_m, slow_mps = rover.near(requesting)
    assert near_m < (requesting.tolerance_m or 0.03)
    assert slow_mps == 0.0
    assert [step for step, _, _ in progress(bench)] == [1, 2]


@pytest.mark.at_length
def test_wide_tolerances_cut_corners(bench: Bench, rover: Noted) -> None:
    bench.execute(FollowPath(CORNERS), 1)
    bench.execute(MoveTo(Waypoint(0.0, 0.0, 0.0)), 2)
    bench.execute(FollowPath(tuple(replace(each, tolerance_m=0.3) for each in CORNERS)), 3)
    assert duration_s(bench, 3) < 0.95 * duration_s(bench, 1)
    assert rover.pose.point.distance_m(Point(0.0, 2.0)) <= 0.3


@pytest.mark.at_length
def test_a_wide_tolerance_ends_a_motion_sooner_and_a_fine_one_later(
    bench: Bench, rover: Noted
) -> None:
    for number, tolerance_m in enumerate((0.3, None, 0.01)):
        bench.execute(MoveTo(Waypoint(2.0, 0.5, 0.0, tolerance_m)), 2 * number + 1)
        off_m = hypot(rover.pose.x_m - 2.0, rover.pose.y_m - 0.5)
        assert off_m <= (tolerance_m or 0.03)
        bench.execute(MoveTo(Waypoint(0.0, 0.0, 0.0)), 2 * number + 2)
    assert duration_s(bench, 1) < duration_s(bench, 3) - 0.2
    assert duration_s(bench, 3) <= duration_s(bench, 5)


@pytest.mark.parametrize(
    "waypoints",
    [
        (Waypoint(0.0, 0.0), Waypoint(1.0, 0.0), Waypoint(1.0, 0.0), Waypoint(0.0, 0.0)),
        (Waypoint(0.0, 0.0), Waypoint(0.0, 0.0)),
        (Waypoint(0.1, 0.0, None, 0.5), Waypoint(0.3, 0.0, None, 0.5), Waypoint(0.5, 0.0)),
        (Waypoint(-1.0, 0.0), Waypoint(1.0, 0.0), Waypoint(-1.0, 0.0, pi)),
    ],
)
def test_coincident_near_and_returning_waypoints(
    bench: Bench, waypoints: tuple[Waypoint, ...]
) -> None:
    bench.execute(FollowPath(waypoints), 1)
    count = len(waypoints)
    reported = [(step, count, f"waypoint {step} of {count} reached") for step in range(1, count)]
    assert progress(bench) == reported


@pytest.mark.at_length
def test_another_command_supersedes_it_between_waypoints(bench: Bench, rover: Noted) -> None:
    bench.submit(FollowPath(CORNERS), 1)
    bench.run(2.5)
    bench.replace(MoveTo(Waypoint(1.0, 0.0, 0.0)), 2)
    assert bench.finish(2) is Stage.EXECUTED
    assert bench.stages(1)[-1] is Stage.CANCELLED
    assert rover.pose.x_m == pytest.approx(1.0, abs=0.03)


def test_a_speed_set_during_the_drive_holds_from_then_on(bench: Bench, rover: Noted) -> None:
    bench.submit(STRAIGHT, 1)
    bench.run(2.0)
    assert rover.velocity.travel_mps == pytest.approx(1.0, abs=0.01)
    bench.submit(SetTravelSpeed(0.3), 2)
    bench.run(1.0)
    begun = len(rover.sent)
    assert bench.finish(1) is Stage.EXECUTED
    assert max(abs(each.travel_mps) for each in rover.sent[begun:]) <= 0.3 + 1e-9
    assert [step for step, _, _ in progress(bench)] == [1, 2]


def weak(then: Reaction) -> Settings:
    row = replace(SMOOTH.faults.battery_low, reaction=then, clears=ClearPolicy.AUTO)
    return replace(SMOOTH, faults=replace(SMOOTH.faults, battery_low=row))


@pytest.mark.at_length
@pytest.mark.parametrize("then", [Reaction.PAUSE, Reaction.SLOW_DOWN, Reaction.STOP])
def test_a_fault_during_a_path_pauses_slows_down_or_ends_it(
    then: Reaction, tmp_path: Path, solver: MinimumTimeSolver
) -> None:
    with Bench(tmp_path, weak(then), solver=solver) as bench:
        bench.submit(STRAIGHT, 1)
        bench.run(1.8)
        bench.voltage_v = LOW_V
        bench.run(1.5)
        at_m, speed_mps = bench.rover.pose.x_m, abs(bench.rover.velocity.travel_mps)
        bench.voltage_v = FULL_V
        assert 1.0 < at_m < 3.0
        if then is Reaction.STOP:
            assert bench.rover.velocity == STANDING
            assert bench.last(1).reason is Reason.BATTERY_LOW
            return
        assert speed_mps == pytest.approx(0.3 if then is Reaction.SLOW_DOWN else 0.0, abs=0.01)
        assert bench.finish(1) is Stage.EXECUTED
        assert [step for step, _, _ in progress(bench)] == [1, 2]
        assert min(each.travel_mps for each in bench.rover.sent) > -0.1


def test_a_waypoint_that_is_passed_while_it_brakes_for_a_pause_is_passed(
    tmp_path: Path, solver: MinimumTimeSolver
) -> None:
    with Bench(tmp_path, weak(Reaction.PAUSE), solver=solver) as bench:
        bench.submit(STRAIGHT, 1)
        while bench.rover.pose.x_m < 0.8:
            bench.step()
        bench.voltage_v = LOW_V
        bench.run(1.5)
        assert bench.rover.velocity == STANDING
        assert bench.rover.pose.x_m > 1.1
        assert progress(bench) == []
        bench.voltage_v = FULL_V
        assert bench.finish(1) is Stage.EXECUTED
        assert [step for step, _, _ in progress(bench)] == [1, 2]
        assert min(each.travel_mps for each in bench.rover.sent) > -0.1


@pytest.mark.at_length
def test_without_plans_it_halts_and_drives_to_the_next_waypoint_alone(
    tmp_path: Path, solver: MinimumTimeSolver
) -> None:
    failing = Wrapped(solver, plan=lambda requested, plan: None if 50 < requested < 57 else plan)
    with Bench(tmp_path, SMOOTH, solver=failing) as bench:
        bench.execute(FollowPath(CORNERS), 1)
        step, *reported = progress(bench)[:3]
        assert step == (1, 4, "waypoint 1 of 4 reached")
        assert reported == [
            (
                1,
                4,
                "mpc: no usable plan; the rover stops, then drives to the next waypoint alone",
            ),
            (2, 4, "waypoint 2 of 4 reached"),
        ]
        assert len(progress(bench)) == 4


def test_a_waypoint_that_was_missed_is_driven_to_alone(
    tmp_path: Path, rover: Noted, solver: MinimumTimeSolver
) -> None:
    def beside(requested: int, problem: TrajectoryProblem) -> TrajectoryProblem:
        if requested > 40 or not problem.via_points:
            return problem
        aside = replace(problem.via_points[0], y_m=problem.via_points[0].y_m + 0.2)
        return replace(problem, via_points=(aside,))

    with Bench(tmp_path, SMOOTH, rover=rover, solver=Wrapped(solver, beside)) as bench:
        bench.execute(STRAIGHT, 1)
        assert [(step, text[:28]) for step, _, text in progress(bench)] == [
            (0, "mpc: a waypoint was missed; "),
            (1, "waypoint 1 of 3 reached"),
            (2, "waypoint 2 of 3 reached"),
        ]
        near_m, slow_mps = rover.near(Waypoint(1.0, 0.0))
        assert near_m < 0.03
        assert slow_mps == 0.0


@pytest.mark.at_length
def test_a_push_off_the_path_is_made_up_for(bench: Bench) -> None:
    bench.submit(FollowPath(CORNERS), 1)
    bench.run(1.0)
    pose = bench.rover.pose
    bench.rover.pose = Pose(pose.x_m, pose.y_m + 0.05, heading_rad=pose.heading_rad + 0.05)
    assert bench.finish(1) is Stage.EXECUTED
    assert len(progress(bench)) == 3


def test_a_near_position_of_any_heading_is_reached(bench: Bench) -> None:
    """The fastest plan ends at the edge of the headings that will do."""
    bench.execute(MoveTo(Waypoint(0.22, 0.26)), 1)
    assert duration_s(bench) < 3.0
