"""What the rover does about zones and what its laser sees, while it moves."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from math import cos, hypot, inf, nan, pi, radians, sin
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.commands import DriveFor, Mode, MoveForward, RotateBy
from executive.faults import FaultTable
from executive.goals import Context
from executive.obstacles.zones import KnownRock, Zones
from executive.safety import MotionHistory
from executive.safety.surroundings import LaserSurroundings
from executive.safety.surroundings_monitors import (
    laser_blind,
    obstacle_ahead,
    obstacle_near,
    zone_ahead,
)
from executive.settings import LaserSettings, Settings, load_settings
from executive.values.clock import ManualClock
from executive.values.facts import LaserScan
from executive.values.geometry import STANDING, Pose, Velocity
from executive.values.reasons import Reason, UnknownReason
from executive.values.reports import ReportKind, Stage
from tests.support.kinematic import Bench, KinematicRover
from trees import RoverTree

JACKAL = load_settings("jackal")
SEEING = replace(JACKAL, sensors=replace(JACKAL.sensors, laser=LaserSettings(rate_hz=20)))
FRONT_M = 0.255
ROWS = FaultTable()


def scan(stamp_s: float, *points: tuple[float, float]) -> LaserScan:
    """Return a scan with a ray a degree, of which those show something that point at it."""
    ranges_m = [inf] * 360
    for x_m, y_m in points:
        for ray in range(360):
            aside_m = y_m * cos(radians(ray)) - x_m * sin(radians(ray))
            along_m = x_m * cos(radians(ray)) + y_m * sin(radians(ray))
            if along_m > 0 and abs(aside_m) <= 0.03:
                ranges_m[ray] = min(ranges_m[ray], hypot(x_m, y_m))
    return LaserScan(stamp_s, 0.0, radians(1), 0.05, 20.0, tuple(ranges_m))


def history(
    velocity: Velocity, *points: tuple[float, float], settings: Settings = SEEING
) -> MotionHistory:
    made = MotionHistory(ManualClock(), settings)
    made.command(velocity)
    made.observe(scan(1.0, *points))
    return made


@given(speed=st.floats(0.05, 2.0), sign=st.sampled_from((1.0, -1.0)), free=st.floats(0.02, 2.0))
def test_what_must_be_free_grows_with_the_square_of_the_speed(
    speed: float, sign: float, free: float
) -> None:
    needed_m = speed**2 / 4 + 0.25 * speed + 0.05
    ahead_m = sign * (FRONT_M + free)
    seen = history(Velocity(sign * speed), (ahead_m, 0.0), (ahead_m, 0.02))
    evidence = obstacle_ahead(seen, ROWS.obstacle_ahead.window, 0.0)
    if abs(free - needed_m) > 0.03:
        assert (evidence is not None) == (free < needed_m)
    if evidence is not None:
        assert evidence.figures[0].value == pytest.approx(free, abs=0.01)
        assert ("ahead" if sign > 0 else "behind") in evidence.text


@pytest.mark.parametrize(
    ("velocity", "points", "met"),
    [
        (Velocity(1.0), [(0.5, 0.0), (0.5, 0.02)], True),
        (Velocity(1.0), [(-0.5, 0.0), (-0.5, 0.02)], False),
        (Velocity(1.0), [(0.5, 0.3), (0.5, 0.32)], False),
        (Velocity(1.0), [(0.2, 0.0), (0.2, 0.02)], False),
        (Velocity(0.5, 1.5), [(0.36, 0.25), (0.37, 0.25)], True),
        (Velocity(0.5, -1.5), [(0.36, 0.25), (0.37, 0.25)], False),
        (Velocity(0.0, 1.5), [(0.2, 0.26), (0.22, 0.26)], True),
        (Velocity(0.0, 1.5), [(0.0, 0.4), (0.02, 0.4)], False),
        (STANDING, [(0.3, 0.0), (0.3, 0.02)], False),
    ],
    ids=["ahead", "behind", "beside", "itself", "arc", "arc away", "turn", "turn free", "stands"],
)
def test_what_is_met_by_a_velocity(
    velocity: Velocity, points: list[tuple[float, float]], met: bool
) -> None:
    evidence = obstacle_ahead(history(velocity, *points), ROWS.obstacle_ahead.window, 0.0)
    assert (evidence is not None) == met


@pytest.mark.at_length
@given(
    travel=st.floats(-2, 2),
    rotate=st.floats(-2, 2),
    away_m=st.floats(0.3, 2.5),
    bearing=st.integers(0, 359),
)
def test_no_point_that_is_met_is_left_out_beforehand(
    travel: float, rotate: float, away_m: float, bearing: int
) -> None:
    x_m, y_m = away_m * cos(radians(bearing)), away_m * sin(radians(bearing))
    velocity = Velocity(travel, rotate)
    seen = history(velocity, (x_m, y_m), (1.01 * x_m, 1.01 * y_m)).surroundings
    assert seen is not None
    held_s = seen.braking_s(velocity, 0.25)
    found = seen.predicted_contact(velocity, held_s, 0.05)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(LaserSurroundings, "_within_reach", lambda self, *_: list(self.spots))
        assert seen.predicted_contact(velocity, held_s, 0.05) == found


def test_a_rover_that_stands_close_may_go_away_but_not_nearer() -> None:
    wall = [(0.29, y / 50) for y in range(-15, 16)]
    for travel_mps, met in ((0.3, True), (-0.3, False)):
        seen = history(Velocity(travel_mps), *wall)
        assert (obstacle_ahead(seen, ROWS.obstacle_ahead.window, 0.0) is not None) == met
    beside = [(x / 50, 0.25) for x in range(-30, 31)]
    assert obstacle_ahead(history(Velocity(1.0), *beside), ROWS.obstacle_ahead.window, 0.0) is None


def test_a_single_return_and_returns_that_are_no_distance_count_for_nothing() -> None:
    seen = history(Velocity(1.0))
    ranges_m = [inf] * 360
    ranges_m[0], ranges_m[1], ranges_m[2], ranges_m[3] = 0.4, nan, 0.01, 0.02
    seen.observe(LaserScan(2.0, 0.0, radians(1), 0.05, 20.0, tuple(ranges_m)))
    assert obstacle_ahead(seen, ROWS.obstacle_ahead.window, 0.0) is None
    ranges_m[1] = 0.4
    seen.observe(LaserScan(3.0, 0.0, radians(1), 0.05, 20.0, tuple(ranges_m)))
    assert obstacle_ahead(seen, ROWS.obstacle_ahead.window, 0.0) is not None


def test_what_is_too_near_to_measure_stands_at_the_edge_of_the_footprint() -> None:
    """REP 117: minus infinity. It may be left, and passed, and not come nearer."""
    for rays, velocity, met in (
        ((0, 1), Velocity(0.3), True),
        ((0, 1), Velocity(-0.3), False),
        ((90, 91), Velocity(0.3), False),
        ((179, 180), Velocity(-0.3), True),
        ((0,), Velocity(0.3), False),
    ):
        ranges_m = [-inf if ray in rays else inf for ray in range(360)]
        seen = history(velocity)
        seen.observe(LaserScan(2.0, 0.0, radians(1), 0.05, 20.0, tuple(ranges_m)))
        assert (obstacle_ahead(seen, ROWS.obstacle_ahead.window, 0.0) is not None) == met


@pytest.mark.parametrize(
    ("rays", "velocity", "blind"),
    [
        (range(360), Velocity(0.3), True),
        (range(360), Velocity(0.0, 0.5), True),
        (range(360), STANDING, False),
        (range(-8, 8), Velocity(0.3), True),
        (range(-8, 8), Velocity(-0.3), False),
        (range(172, 188), Velocity(-0.3), True),
        (range(37, 53), Velocity(0.3), True),
        (range(82, 98), Velocity(0.3), False),
        (range(82, 98), Velocity(0.0, 0.5), True),
        (range(-5, 5), Velocity(0.3), False),
    ],
)
def test_a_sector_of_which_nothing_is_measured_is_blind(
    rays: range, velocity: Velocity, blind: bool
) -> None:
    seen, lost = history(velocity), {ray % 360 for ray in rays}
    ranges_m = tuple(nan if ray in lost else inf for ray in range(360))
    for stamp_s in (2.0, 3.0):
        seen.observe(LaserScan(stamp_s, 0.0, radians(1), 0.05, 20.0, ranges_m))
    window = ROWS.laser_blind.window
    assert laser_blind(seen, window, 0.2) is None
    evidence = laser_blind(seen, window, 0.3)
    assert (evidence is not None) == blind
    if evidence is not None:
        assert [each.name for each in evidence.figures] == ["share", "bound", "bearing"]
        assert "100% of its rays there are unusable" in evidence.text


def test_single_rays_without_a_measurement_are_no_blind_sector() -> None:
    seen = history(Velocity(0.3))
    ranges_m = tuple(nan if ray % 4 else inf for ray in range(360))
    for stamp_s in (2.0, 3.0):
        seen.observe(LaserScan(stamp_s, 0.0, radians(1), 0.05, 20.0, ranges_m))
    assert laser_blind(seen, ROWS.laser_blind.window, 9.0) is None


def test_what_is_near_in_the_direction_of_the_drive_slows_it() -> None:
    points = [(1.0, 0.0), (1.0, 0.02)]
    for travel_mps, near in ((0.3, True), (-0.3, False), (0.0, False)):
        seen = history(Velocity(travel_mps), *points)
        assert (obstacle_near(seen, ROWS.obstacle_near.window, 0.0) is not None) == near


def test_before_a_zone_a_rover_must_be_able_to_stand() -> None:
    zones = Zones(rocks=(KnownRock("boulder", 2.0, 0.0, 0.5),))
    reach_m = 2.0 - 0.5 - hypot(0.51, 0.43) / 2
    for travel_mps in (0.3, 1.0):
        braking_m = travel_mps**2 / 4 + 0.16 * travel_mps
        for more_m, met in ((0.03, False), (-0.03, True)):
            seen = history(Velocity(travel_mps), settings=replace(JACKAL, zones=zones))
            seen.pose = Pose(reach_m - braking_m - more_m)
            evidence = zone_ahead(seen, ROWS.zone_ahead.window, 0.0)
            assert (evidence is not None) == met
            if evidence is not None:
                assert "rock 'boulder' is" in evidence.text


@dataclass
class SeeingRover(KinematicRover):
    """Sees a wall that is parallel to y, 20 times a second.

    Attributes:
        wall_m: where it is.
        blind: whether the laser is silent.
        ray_m: what each ray says, if not what is there.
    """

    wall_m: float = 3.0
    blind: bool = False
    ray_m: float | None = None
    scans: int = field(default=0)

    def advance(self, step_s: float) -> None:
        super().advance(step_s)
        if self.blind:
            return
        self.scans += 1
        ranges_m = []
        for ray in range(360):
            heading_rad = self.pose.heading_rad + 2 * pi * ray / 360
            along = cos(heading_rad)
            away_m = (self.wall_m - self.pose.x_m) / along if abs(along) > 1e-6 else inf
            ranges_m.append(away_m if away_m > 0 else inf)
        if self.ray_m is not None:
            ranges_m = [self.ray_m] * len(ranges_m)
        stamp_s = self.scans * step_s
        self.facts.append(LaserScan(stamp_s, 0.0, 2 * pi / 360, 0.05, 20.0, tuple(ranges_m)))

    @property
    def free_m(self) -> float:
        """What is left between the rover and the wall ahead."""
        return self.wall_m - self.pose.x_m - FRONT_M


Make = Callable[..., Bench]


@pytest.fixture
def make(tmp_path: Path) -> Iterator[Make]:
    benches: list[Bench] = []

    def bench(settings: Settings = SEEING, **given: object) -> Bench:
        made = Bench(tmp_path, settings, rover=SeeingRover(), **given)  # type: ignore[arg-type]
        benches.append(made)
        return made

    yield bench
    for made in benches:
        made.executive.simulate_crash()


def events(bench: Bench) -> list[Reason | UnknownReason | None]:
    told = [report for report in bench.received.reports if report.kind is ReportKind.EVENT]
    return [report.reason for report in told if report.identity is None]


@pytest.mark.at_length
def test_a_drive_against_a_wall_slows_down_stops_and_may_go_back(make: Make) -> None:
    bench = make()
    bench.submit(MoveForward(5.0), 1)
    assert bench.finish(1) is Stage.FAILED
    last = bench.last(1)
    assert last.reason is Reason.OBSTACLE_AHEAD
    assert last.text.startswith("obstacle 0.1")
    assert "ahead" in last.text
    assert [figure.name for figure in last.figures[:3]] == ["distance", "speed", "bound"]
    rover = bench.rover
    assert isinstance(rover, SeeingRover)
    assert 0.03 < rover.free_m < 0.2
    assert events(bench)[:2] == [Reason.OBSTACLE_NEAR, Reason.OBSTACLE_AHEAD]
    assert max(sent.travel_mps for sent in rover.sent[-8:]) <= 0.31
    bench.run(1.0)
    assert bench.executive.mode is Mode.IDLE
    bench.execute(MoveForward(-1.0), 2)
    bench.execute(RotateBy(1.0), 3)


@pytest.mark.at_length
def test_a_goal_near_a_wall_is_reached(make: Make) -> None:
    bench = make()
    bench.execute(MoveForward(3.0 - FRONT_M - 0.2), 1)
    assert Reason.OBSTACLE_AHEAD not in events(bench)


class Hanging(RoverTree):
    """A tree that can hang: it goes on wanting what it wanted, whatever becomes of its goals."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self.hangs = False
        self.intents = context.intents

    def tick(self) -> None:
        if self.hangs:
            self.intents.motion = Velocity(1.0, 0.0)
        else:
            super().tick()


@pytest.mark.at_length
def test_it_works_though_the_tree_hangs(make: Make) -> None:
    bench = make(build_tree=Hanging)
    tree, rover = bench.executive.tree, bench.rover
    assert isinstance(tree, Hanging)
    assert isinstance(rover, SeeingRover)
    bench.submit(DriveFor(1.0, 0.0, 20.0), 1)
    bench.run(1.0)
    tree.hangs = True
    bench.run(20.0)
    assert rover.velocity == STANDING
    assert rover.free_m > 0.02
    assert bench.stages(1)[-1] is Stage.FAILED


def test_a_scan_acts_as_it_arrives_between_two_ticks(make: Make) -> None:
    bench = make()
    bench.drive_on(1.5)
    assert bench.rover.velocity.travel_mps > 0.9
    bench.executive.observe(scan(99.0, (0.5, 0.0), (0.5, 0.02)))
    assert bench.rover.velocity == STANDING


def test_without_scans_the_rover_does_not_drive(make: Make) -> None:
    bench = make()
    rover = bench.rover
    assert isinstance(rover, SeeingRover)
    bench.drive_on(1.0)
    rover.blind = True
    bench.run(0.5)
    assert rover.velocity == STANDING
    assert bench.last(1).reason is Reason.LASER_SILENT
    bench.submit(MoveForward(-0.5), 2)
    bench.run(0.5)
    assert bench.stages(2)[-1] in {Stage.REJECTED, Stage.FAILED}
    rover.blind = False
    bench.run(1.0)
    bench.execute(MoveForward(-0.5), 3)


@pytest.mark.at_length
@pytest.mark.parametrize(
    ("ray_m", "reason"), [(nan, Reason.LASER_BLIND), (-inf, Reason.OBSTACLE_AHEAD)]
)
def test_a_laser_that_measures_nothing_is_no_free_way(
    make: Make, ray_m: float, reason: Reason
) -> None:
    bench = make()
    rover = bench.rover
    assert isinstance(rover, SeeingRover)
    rover.ray_m = ray_m
    bench.run(1.0)
    for number, motion in enumerate((MoveForward(1.5), MoveForward(-1.5)), 1):
        bench.submit(motion, number)
        assert bench.finish(number) is Stage.FAILED
        assert bench.last(number).reason is reason
        bench.run(1.0)
    assert abs(rover.pose.x_m) < 0.05
    rover.ray_m = None
    bench.run(1.0)
    bench.execute(MoveForward(0.5), 3)


def test_a_laser_that_goes_blind_stops_the_rover(make: Make) -> None:
    bench = make()
    rover = bench.rover
    assert isinstance(rover, SeeingRover)
    rover.wall_m = inf
    bench.drive_on(1.0)
    rover.ray_m = nan
    bench.run(0.45)
    assert rover.velocity == STANDING
    assert bench.last(1).reason is Reason.LASER_BLIND


def test_a_base_that_brakes_badly_is_stopped_early(make: Make) -> None:
    zones = Zones(rocks=(KnownRock("boulder", 3.0, 0.0, 0.5),))
    drive = replace(JACKAL.drive, braking_mps2=0.3)
    bench = make(replace(JACKAL, zones=zones, drive=drive))
    bench.submit(MoveForward(2.0), 1)
    assert bench.finish(1) is Stage.FAILED
    assert bench.last(1).reason is Reason.ZONE_AHEAD
    assert "rock 'boulder' is" in bench.last(1).text
    bench.run(1.0)
    assert bench.executive.mode is Mode.IDLE
