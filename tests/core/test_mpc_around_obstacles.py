"""mpc drives in one curve around rocks and zones, known or seen, and keeps the margin."""

import json
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from math import hypot, inf, pi
from pathlib import Path
from random import Random
from typing import Any

import pytest

from executive.commands import Command, FollowPath, MoveTo, Waypoint
from executive.motion import (
    MinimumTimeSolver,
    SharedSolver,
    Trajectory,
    TrajectoryProblem,
    make_solver,
    obstacle_constraints,
)
from executive.motion.motion_model import MotionState
from executive.motion.obstacle_constraints import ObstacleConstraints
from executive.motion.trajectory import TrajectoryTarget
from executive.obstacles import detour
from executive.obstacles.detour import SLICE_COMPARISONS, Detours
from executive.obstacles.zones import KeepIn, KeepOut, KnownRock, Obstacle, Zones, has_clearance
from executive.settings import Controller, LaserSettings, MpcSettings, Settings, load_settings
from executive.values.geometry import Point
from executive.values.reasons import Reason
from executive.values.reports import Identity, Severity, Stage
from sim.rover.lockstep import LockStep
from sim.rover.world import Rock, World
from tests.benchmarks.previews import crowd
from tests.support.kinematic import Bench, ignoring
from tests.support.laser import Disc, ScanningRover

RADIUS_M, MARGIN_M = 0.3335, 0.1
OFF_M = 0.005
"""By which a rover is nearer than planned."""
ROCK = KnownRock("boulder", 2.0, 0.1, 0.3)
BAR = KeepOut("bar", ((2.0, -4.0), (2.5, -4.0), (2.5, 1.5), (2.0, 1.5)))
YARD = KeepIn("yard", ((-2.0, -3.0), (8.0, -3.0), (8.0, 3.0), (-2.0, 3.0)))
AMONG_ROCK = Zones(rocks=(ROCK,))
JACKAL = replace(load_settings("jackal"), controller=Controller.MPC)
WATCHED = ignoring("odometry_off_twist")
PLAIN = replace(
    WATCHED,
    controller=Controller.MPC,
    mpc=MpcSettings(odometry_age_s=0.0),
    turn_drive=replace(WATCHED.turn_drive, control_point_m=0.0),
)
SEEING = replace(PLAIN, sensors=replace(PLAIN.sensors, laser=LaserSettings(rate_hz=10)))
GOALS = Path(__file__).parents[1] / "benchmarks" / "goals.json"
SCENES: list[dict[str, Any]] = json.loads(GOALS.read_text())["rock_scenes"][::3]
THERE = MoveTo(Waypoint(4.0, 0.0))


@pytest.fixture(scope="module")
def solver() -> MinimumTimeSolver:
    return make_solver(replace(PLAIN, zones=AMONG_ROCK))


@pytest.fixture(scope="module")
def jackal_solver() -> MinimumTimeSolver:
    return make_solver(replace(JACKAL, zones=AMONG_ROCK))


class Driven(Bench):
    """A bench whose rover moves as told, by mpc, among what it knows and what its laser sees."""

    rover: ScanningRover

    def __init__(
        self, folder: Path, solver: SharedSolver, settings: Settings, discs: Sequence[Disc] = ()
    ) -> None:
        rover = ScanningRover(discs=list(discs), spin_centre_m=0.0)
        super().__init__(folder, settings, rover=rover, solver=solver)
        self.positions: list[Point] = []
        self.standstill_s = 0.0
        self.run(0.5)

    def drive(self, request: MoveTo | FollowPath) -> Stage:
        """Return how a motion ends."""
        self.submit(request, 1)
        self.step()
        while not self.stages(1)[-1].terminal:
            self.step()
            self.positions.append(self.rover.pose.point)
            self.standstill_s += 0.05 * (self.rover.velocity.travel_mps == 0.0)
        return self.stages(1)[-1]

    @property
    def gap_m(self) -> float:
        """How near the disc of the rover came to anything that it knows."""
        zones, pairs = self.settings.zones, list(pairwise(self.positions))
        return min(each.clearance_m(a, b) for each in zones for a, b in pairs) - RADIUS_M

    @property
    def texts(self) -> list[str]:
        """What is told of how command 1 goes on."""
        return [each.text for each in self.received.reports if each.stage is Stage.PROGRESS]


def known(*obstacles: Obstacle) -> Settings:
    """Return the settings of a rover that knows what is there."""
    rocks = tuple(each for each in obstacles if isinstance(each, KnownRock))
    keep_out = tuple(each for each in obstacles if isinstance(each, KeepOut))
    keep_in = tuple(each for each in obstacles if isinstance(each, KeepIn))
    return replace(PLAIN, zones=Zones(keep_in, keep_out, rocks))


def from_rest(x_m: float, y_m: float, zones: Zones) -> TrajectoryProblem:
    """Return the problem of a rover at rest at the origin."""
    start = MotionState(0.0, 0.0, 0.0)
    return TrajectoryProblem(
        start,
        TrajectoryTarget(x_m, y_m, 0.0),
        1.0,
        1.5,
        None,
        (),
        ObstacleConstraints(zones, RADIUS_M),
    )


def gap_of(plan: Trajectory, zones: Zones) -> float:
    """Return how near the disc of a rover comes to anything by a plan."""
    positions = [plan.at(plan.duration_s * step / 400) for step in range(401)]
    points = [Point(each.x_m, each.y_m) for each in positions]
    return min(each.clearance_m(at, at) for each in zones for at in points) - RADIUS_M


@pytest.mark.parametrize("seed", range(8))
def test_a_plan_among_rocks_respects_the_margin_between_its_nodes_too(
    seed: int, solver: MinimumTimeSolver
) -> None:
    draw = Random(seed)
    rocks = [
        KnownRock(f"r{index}", draw.uniform(1.0, 4.0), draw.uniform(-1.5, 1.5), 0.2)
        for index in range(3)
    ]
    zones = Zones(rocks=tuple(rocks))
    plan = solver.solve(from_rest(5.5, 0.0, zones))
    assert plan is not None
    assert plan.terminal_error < 1e-3
    assert gap_of(plan, zones) > MARGIN_M - OFF_M
    assert plan.duration_s < 10.0


def test_after_an_appearing_obstacle_the_next_plan_is_a_detour(
    solver: MinimumTimeSolver,
) -> None:
    free = from_rest(4.0, 0.0, Zones())
    straight = solver.solve(replace(free, obstacles=None))
    assert straight is not None
    start = straight.at(1.0)
    among = replace(free, start=start, guess=straight.remainder(1.0))
    zones = Zones(rocks=(KnownRock("new", 3.0, 0.02, 0.2),))
    plan = solver.solve(replace(among, obstacles=ObstacleConstraints(zones, RADIUS_M)))
    assert plan is not None
    assert gap_of(plan, zones) > MARGIN_M - OFF_M


def test_the_search_for_a_detour_pauses_between_its_slices(monkeypatch: pytest.MonkeyPatch) -> None:
    (zones, target), compared, slices = crowd(1), [0], []
    around = ObstacleConstraints(zones, RADIUS_M)

    def counting(*line: Any) -> bool:
        compared[0] += 1
        return has_clearance(*line)

    def pause() -> None:
        slices.append(compared[0])
        compared[0] = 0

    ends = Point(0.0, 0.0), Point(target.x_m, target.y_m)
    monkeypatch.setattr(detour, "has_clearance", counting)
    corners = around.detour(*ends, pause)
    assert len(slices) > 3
    assert max(slices) <= SLICE_COMPARISONS + len(list(zones))
    monkeypatch.setattr(obstacle_constraints, "Detours", partial(Detours, inf))  # one slice
    assert corners
    assert around.detour(*ends, lambda: pytest.fail("paused")) == corners


def test_a_start_too_near_leaves_and_does_not_approach(
    solver: MinimumTimeSolver,
) -> None:
    zones = Zones(rocks=(KnownRock("beside", 0.0, 0.6, 0.2),))
    plan = solver.solve(from_rest(3.0, 1.0, zones))
    assert plan is not None
    assert gap_of(plan, zones) > 0.6 - 0.2 - RADIUS_M - OFF_M


@pytest.mark.at_length
def test_a_target_behind_a_rock_is_reached_in_one_curve(
    solver: MinimumTimeSolver, tmp_path: Path
) -> None:
    with Driven(tmp_path, solver, known(ROCK)) as bench:
        assert bench.drive(THERE) is Stage.EXECUTED
        assert bench.gap_m > MARGIN_M - OFF_M
        assert bench.texts[0].startswith("detour around obstacles by (")
        assert len(bench.texts) == 1
        assert bench.standstill_s < 1.0


@pytest.mark.at_length
@pytest.mark.parametrize("target", [Waypoint(4.0, -2.0, pi / 2), Waypoint(1.0, 2.4)])
def test_zones_are_detoured_and_not_left(
    target: Waypoint, solver: MinimumTimeSolver, tmp_path: Path
) -> None:
    with Driven(tmp_path, solver, known(BAR, YARD)) as bench:
        assert bench.drive(MoveTo(target)) is Stage.EXECUTED
        assert bench.gap_m > MARGIN_M - OFF_M
        assert not [text for text in bench.texts if text.startswith("mpc:")]


@pytest.mark.at_length
def test_a_path_past_rocks_is_one_motion(solver: MinimumTimeSolver, tmp_path: Path) -> None:
    settings = known(KnownRock("inside", 1.4, 1.0, 0.12), KnownRock("outside", 2.8, 0.2, 0.2))
    corners = (Waypoint(1.9, 0.0), Waypoint(2.4, 1.2), Waypoint(0.0, 2.2))
    with Driven(tmp_path, solver, settings) as bench:
        assert bench.drive(FollowPath(corners)) is Stage.EXECUTED
        assert bench.gap_m > MARGIN_M - OFF_M
        assert [text[:9] for text in bench.texts] == ["waypoint "] * 2


def test_without_a_free_path_it_is_refused_as_with_turn_drive(
    solver: MinimumTimeSolver, tmp_path: Path
) -> None:
    wall = KeepOut("wall", ((2.0, -4.0), (2.5, -4.0), (2.5, 4.0), (2.0, 4.0)))
    settings = known(wall, YARD)
    with Driven(tmp_path / "mpc", solver, settings) as bench:
        refusal = bench.refusal(THERE, 1)
        assert refusal.reason is Reason.PATH_BLOCKED
        assert refusal.text.endswith("; no detour found")
    with Bench(tmp_path / "lines", replace(settings, controller=Controller.TURN_DRIVE)) as bench:
        assert bench.refusal(THERE, 1) == refusal


class Failing:
    """A solver that finds nothing."""

    lead_ticks = 0
    busy = False

    def request(self, problem: TrajectoryProblem) -> None:
        """Take a problem."""

    def take_result(self) -> Trajectory | None:
        """Return None."""
        return None

    def fork(self, apart: bool = False) -> "Failing":
        """Return itself."""
        return self


def test_without_a_plan_turn_then_drive_goes_around(tmp_path: Path) -> None:
    with Driven(tmp_path, Failing(), known(ROCK)) as bench:
        assert bench.drive(THERE) is Stage.EXECUTED
        assert bench.texts[1].endswith("; turn-then-drive takes over")
        assert bench.gap_m > MARGIN_M - OFF_M


def until(bench: Driven, request: MoveTo | FollowPath, x_m: float, discs: Sequence[Disc]) -> Stage:
    """Have something come into view when the rover is so far; return how the motion ends."""
    bench.submit(request, 1)
    while bench.rover.pose.x_m < x_m:
        bench.step()
    bench.rover.discs += discs
    return bench.finish(1)


@pytest.mark.at_length
def test_an_appearing_obstacle_is_detoured_without_standstill(
    solver: MinimumTimeSolver, tmp_path: Path
) -> None:
    with Driven(tmp_path, solver, SEEING) as bench:
        assert until(bench, THERE, 0.4, [Disc(2.6, 0.1, 0.3)]) is Stage.EXECUTED
        assert bench.rover.nearest_m > MARGIN_M / 2
        assert bench.texts == []
        assert Reason.OBSTACLE_AHEAD not in {each.reason for each in bench.received.reports}


@pytest.mark.at_length
def test_a_path_detours_an_appearing_obstacle(solver: MinimumTimeSolver, tmp_path: Path) -> None:
    path = FollowPath((Waypoint(3.5, 0.0), Waypoint(3.5, 2.0)))
    with Driven(tmp_path, solver, SEEING) as bench:
        assert until(bench, path, 0.3, [Disc(2.2, 0.2, 0.2)]) is Stage.EXECUTED
        assert bench.rover.nearest_m > MARGIN_M / 2
        assert "waypoint 1 of 2 reached" in bench.texts


def test_if_an_appearing_obstacle_leaves_no_path_its_position_is_reported(
    solver: MinimumTimeSolver, tmp_path: Path
) -> None:
    ring = [Disc(2.6, y / 4, 0.15) for y in range(-3, 4)]
    ring += [Disc(x / 4, y, 0.15) for y in (-0.85, 0.85) for x in range(-3, 11)]
    ring += [Disc(-0.8, y / 4, 0.15) for y in range(-3, 4)]
    with Driven(tmp_path, solver, SEEING) as bench:
        assert until(bench, THERE, 0.1, ring) is Stage.FAILED
        last = bench.last(1)
        assert last.reason is Reason.PATH_BLOCKED
        assert last.text.startswith("path blocked by scanned obstacle at (")
        assert last.text.endswith("; no detour found")
        figures = {each.name: each.value for each in last.figures}
        position = Point(figures["obstacle x"], figures["obstacle y"])
        assert min(abs(disc.away_m(position)) for disc in ring) < 0.4
        assert bench.rover.nearest_m > 0.0


def in_simulation(
    folder: Path,
    settings: Settings,
    world: World,
    target: Waypoint,
    solver: SharedSolver,
    seed: int,
) -> LockStep:
    """Return a run in the simulation, in which a place was driven to."""
    lockstep = LockStep(settings, world, folder, seed, solver=solver)
    lockstep.run(0.5)
    lockstep.submit(Command(Identity("test", 1), MoveTo(target), "direct"))

    def ended() -> bool:
        stages = (each.stage for each in lockstep.downlink_record.reports)
        return any(each is not None and each.terminal for each in stages)

    lockstep.run_until(ended, 120.0)
    lockstep.executive.simulate_crash()
    return lockstep


@pytest.mark.at_length
def test_rock_scenes_are_driven_in_little_more_than_the_best_known_times(
    jackal_solver: MinimumTimeSolver, tmp_path: Path
) -> None:
    took_s = 0.0
    for scene in SCENES:
        rocks = tuple(KnownRock(f"r{i}", **each) for i, each in enumerate(scene["rocks"]))
        world = World(rocks=tuple(Rock(**each, height_m=0.4) for each in scene["rocks"]))
        settings = replace(JACKAL, zones=Zones(rocks=rocks))
        target = Waypoint(scene["x_m"], scene["y_m"], scene["heading_rad"])
        folder = tmp_path / scene["id"]
        folder.mkdir()
        lockstep = in_simulation(folder, settings, world, target, jackal_solver, seed=1)
        reports = lockstep.downlink_record.reports
        assert Stage.EXECUTED in {each.stage for each in reports}
        assert lockstep.rover.contacts == 0
        assert {each.severity for each in reports} == {Severity.INFORMATIONAL}
        took_s += lockstep.time_s - 0.5
    assert took_s < 1.06 * sum(scene["best_known_time_s"] for scene in SCENES)


@pytest.mark.at_length
def test_a_plan_near_other_obstacles_than_its_guess_is_recomputed(
    jackal_solver: MinimumTimeSolver, tmp_path: Path
) -> None:
    draw = Random(1161)
    rocks: list[Rock] = []
    count = draw.randint(5, 20)
    while len(rocks) < count:
        x_m, y_m, radius_m = draw.uniform(-1, 7), draw.uniform(-3, 3), draw.uniform(0.1, 0.4)
        if hypot(x_m, y_m) > radius_m + 0.6:
            rocks.append(Rock(x_m, y_m, radius_m, 0.4))
    target = Waypoint(draw.uniform(3, 6.5), draw.uniform(-2.5, 2.5))
    known_rocks = tuple(
        KnownRock(f"r{index}", each.x_m, each.y_m, each.radius_m)
        for index, each in enumerate(rocks)
    )
    settings = replace(JACKAL, zones=Zones(rocks=known_rocks))
    world = World(rocks=tuple(rocks))
    lockstep = in_simulation(tmp_path, settings, world, target, jackal_solver, seed=161)
    texts = [each.text for each in lockstep.downlink_record.reports if each.stage is Stage.PROGRESS]
    assert len(texts) == 1
    assert texts[0].startswith("detour around obstacles by (")
    assert lockstep.rover.contacts == 0
