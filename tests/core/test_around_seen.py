"""What the laser has seen is gone around by motions to places, or named where there is no way."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import hypot
from pathlib import Path
from random import Random

import pytest

from executive.commands import (
    Command,
    FollowPath,
    MoveForward,
    MoveTo,
    SetPositionCompensation,
    Waypoint,
)
from executive.faults import Reaction
from executive.obstacles.zones import KnownRock, Zones
from executive.settings import LaserSettings, Settings, load_settings
from executive.values.geometry import Point, Pose
from executive.values.reasons import Reason, UnknownReason
from executive.values.reports import Identity, Stage
from sim.rover.lockstep import LockStep
from sim.rover.world import Rock, World
from tests.support.kinematic import Bench, ignoring
from tests.support.laser import Disc, ScanningRover
from trees.motion_leaf import MAX_DETOURS

pytestmark = pytest.mark.alike

WATCHED = ignoring("odometry_off_twist")
SEEING = replace(WATCHED, sensors=replace(WATCHED.sensors, laser=LaserSettings(rate_hz=10)))
ROCK = Disc(2.0, 0.1, 0.3)
THERE = MoveTo(Waypoint(4.0, 0.0))


class ScanningBench(Bench):
    """A bench whose rover has a laser among rocks."""

    rover: ScanningRover

    def __init__(self, folder: Path, *discs: Disc, settings: Settings = SEEING) -> None:
        super().__init__(folder, settings, rover=ScanningRover(discs=list(discs)))
        self.run(0.5)

    def until(self, x_m: float) -> None:
        """Let time pass until the rover is so far."""
        while self.rover.pose.x_m < x_m:
            self.step()

    @property
    def texts(self) -> list[str]:
        """What is told of how command 1 goes on."""
        return [each.text for each in self.received.reports if each.stage is Stage.PROGRESS]

    @property
    def reasons(self) -> set[Reason | UnknownReason | None]:
        """Of all that is told."""
        return {each.reason for each in self.received.reports}


def reacting(then: Reaction) -> Settings:
    """Return settings by which the rover does so about what is ahead."""
    row = replace(SEEING.faults.obstacle_ahead, reaction=then)
    return replace(SEEING, faults=replace(SEEING.faults, obstacle_ahead=row))


@pytest.mark.at_length
def test_a_visible_obstacle_is_detoured(tmp_path: Path) -> None:
    with ScanningBench(tmp_path, ROCK) as bench:
        bench.execute(THERE, 1)
        assert bench.rover.nearest_m > 0.08
        assert bench.texts[0].startswith("detour around obstacles by (")
        assert Reason.OBSTACLE_AHEAD not in bench.reasons


@pytest.mark.at_length
def test_an_appearing_obstacle_stops_the_line_and_is_detoured(tmp_path: Path) -> None:
    with ScanningBench(tmp_path) as bench:
        bench.submit(THERE, 1)
        bench.until(0.5)
        bench.rover.discs.append(ROCK)
        assert bench.finish(1) is Stage.EXECUTED
        assert bench.rover.nearest_m > 0.05
        assert bench.texts[0].startswith("detour around scanned obstacle at (1.9")
        assert Reason.OBSTACLE_AHEAD not in bench.reasons


@pytest.mark.at_length
def test_a_distant_obstacle_is_first_approached(tmp_path: Path) -> None:
    with ScanningBench(tmp_path) as bench:
        bench.submit(MoveTo(Waypoint(6.0, 0.0)), 1)
        bench.until(0.2)
        bench.rover.discs.append(Disc(3.8, 0.1, 0.3))
        while not bench.texts:
            bench.step()
        assert 1.2 < bench.rover.pose.x_m < 2.0
        assert bench.finish(1) is Stage.EXECUTED


@pytest.mark.at_length
def test_what_moves_away_again_is_driven_over(tmp_path: Path) -> None:
    with ScanningBench(tmp_path) as bench:
        bench.submit(THERE, 1)
        bench.until(0.5)
        bench.rover.discs.append(ROCK)
        bench.run(0.3)
        bench.rover.discs.clear()
        assert bench.finish(1) is Stage.EXECUTED
        assert bench.texts == []
        assert abs(bench.rover.pose.y_m) < 0.05


def test_without_a_free_path_the_blocking_position_is_reported(tmp_path: Path) -> None:
    ring = [Disc(2.6, y / 4, 0.15) for y in range(-3, 4)]
    ring += [Disc(x / 4, y, 0.15) for y in (-0.85, 0.85) for x in range(-3, 11)]
    ring += [Disc(-0.8, y / 4, 0.15) for y in range(-3, 4)]
    with ScanningBench(tmp_path) as bench:
        bench.submit(THERE, 1)
        bench.run(0.2)
        bench.rover.discs += ring
        assert bench.finish(1) is Stage.FAILED
        last = bench.last(1)
        assert last.reason is Reason.PATH_BLOCKED
        assert last.text.startswith("path blocked by scanned obstacle at (")
        assert last.text.endswith("; no detour found")
        figures = {each.name: each.value for each in last.figures}
        position = Point(figures["obstacle x"], figures["obstacle y"])
        assert min(abs(disc.away_m(position)) for disc in ring) < 0.4
        assert figures["gap"] < figures["bound"] == pytest.approx(0.1)
        assert bench.rover.nearest_m > 0.0


def test_a_target_inside_an_obstacle_is_refused(tmp_path: Path) -> None:
    with ScanningBench(tmp_path, ROCK) as bench:
        refusal = bench.refusal(MoveTo(Waypoint(2.0, 0.2)), 1)
        assert refusal.reason is Reason.PATH_BLOCKED
        assert "; target too near to scanned obstacle at (" in refusal.text


@pytest.mark.at_length
def test_a_path_detours_scanned_obstacles_and_returns_to_its_lines(tmp_path: Path) -> None:
    zones = Zones(rocks=(KnownRock("boulder", 5.5, 1.2, 0.3),))
    settings = replace(SEEING, zones=zones)
    with ScanningBench(tmp_path, ROCK, settings=settings) as bench:
        positions = (Waypoint(4.0, 0.0), Waypoint(4.5, 1.0), Waypoint(4.5, 2.5))
        bench.execute(FollowPath(positions), 1)
        assert bench.rover.nearest_m > 0.08
        assert sum(text.startswith("detour around") for text in bench.texts) == 1
        assert sum(text.startswith("waypoint ") for text in bench.texts) == 2
        blocked = bench.refusal(FollowPath((Waypoint(7.0, 0.5),)), 2)
        assert blocked.text.startswith("path blocked by rock 'boulder'")


@pytest.mark.at_length
def test_a_path_detours_known_obstacles_too_once_it_has_left_its_line(tmp_path: Path) -> None:
    zones = Zones(rocks=(KnownRock("boulder", 3.1, -0.85, 0.25),))
    beside = Disc(2.0, 0.25, 0.3)
    with ScanningBench(tmp_path, beside, settings=replace(SEEING, zones=zones)) as bench:
        bench.execute(FollowPath((Waypoint(4.0, 0.0),)), 1)
        assert bench.rover.nearest_m > 0.08
        assert len(bench.texts) == 1


def test_a_waypoint_inside_an_obstacle_is_named(tmp_path: Path) -> None:
    hidden = Disc(6.5, 0.0, 0.3)
    with ScanningBench(tmp_path, ROCK, hidden) as bench:
        near = FollowPath((Waypoint(0.5, 0.0), Waypoint(2.0, -0.3)))
        refusal = bench.refusal(near, 1)
        assert refusal.reason is Reason.PATH_BLOCKED
        assert refusal.text.startswith("at the waypoint (2, -0.3) the rover would be in")
        assert "scanned obstacle at (" in refusal.text
        bench.submit(FollowPath((Waypoint(4.0, 0.0), Waypoint(6.4, 0.2))), 2)
        assert bench.finish(2) is Stage.FAILED
        last = bench.last(2)
        assert last.reason is Reason.PATH_BLOCKED
        assert last.text.startswith("at the waypoint (6.4, 0.2) the rover would be in")
        assert bench.rover.nearest_m > 0.05


def test_other_motions_are_left_to_the_monitors(tmp_path: Path) -> None:
    with ScanningBench(tmp_path, ROCK) as bench:
        bench.submit(MoveForward(4.0), 1)
        assert bench.finish(1) is Stage.FAILED
        assert bench.last(1).reason is Reason.OBSTACLE_AHEAD


@pytest.mark.at_length
@pytest.mark.parametrize("away", [False, True], ids=["stays", "moves away"])
def test_after_a_monitor_paused_the_motion_goes_around_or_straight_on(
    away: bool, tmp_path: Path
) -> None:
    with ScanningBench(tmp_path, settings=reacting(Reaction.PAUSE)) as bench:
        bench.submit(THERE, 1)
        bench.until(1.0)
        bench.rover.discs.append(Disc(1.9, 0.1, 0.3))
        while Reason.OBSTACLE_AHEAD not in bench.reasons:
            bench.step()
        if away:
            bench.rover.discs.clear()
        assert bench.finish(1) is Stage.EXECUTED
        assert any(text.startswith("detour around") for text in bench.texts) != away
        assert bench.rover.nearest_m > 0.0 or away


def test_a_monitor_that_stops_fails_the_motion_as_ever(tmp_path: Path) -> None:
    with ScanningBench(tmp_path) as bench:
        bench.submit(THERE, 1)
        bench.until(1.0)
        bench.rover.discs.append(Disc(1.9, 0.1, 0.3))
        assert bench.finish(1) is Stage.FAILED
        assert bench.last(1).reason is Reason.OBSTACLE_AHEAD


@dataclass
class Teased(ScanningRover):
    """Has a rock put across its way whenever it drives."""

    def advance(self, step_s: float) -> None:
        if self.velocity.travel_mps > 0.3:
            position = self.pose.ahead(1.4)
            self.discs = [Disc(position.x_m, position.y_m, 0.2)]
        super().advance(step_s)


@pytest.mark.at_length
def test_detours_are_bounded(tmp_path: Path) -> None:
    with Bench(tmp_path, SEEING, rover=Teased()) as bench:
        bench.submit(MoveTo(Waypoint(60.0, 0.0)), 1)
        assert bench.finish(1, 600.0) is Stage.FAILED
        last = bench.last(1)
        assert last.reason is Reason.PATH_BLOCKED
        assert last.text.endswith(f" after {MAX_DETOURS} detours")


def test_scanned_obstacles_are_forgotten_when_the_pose_changes(tmp_path: Path) -> None:
    with ScanningBench(tmp_path, ROCK) as bench:
        status = bench.executive.status
        assert status.obstacles.scanned
        bench.execute(SetPositionCompensation(1.0, 0.0, 0.0, 0.0), 1)
        assert not status.obstacles.scanned
        bench.run(0.5)
        assert all(2.6 < each.x_m < 3.2 for each in status.obstacles.scanned)
        bench.rover.pose = Pose(-0.5)
        bench.step()
        assert not status.obstacles.scanned
        bench.run(0.5)
        assert status.obstacles.scanned
        bench.odometry = False
        bench.run(1.0)
        bench.odometry = True
        bench.rover.discs.clear()
        bench.step()
        assert not status.obstacles.scanned


def test_without_a_laser_only_known_obstacles_count(tmp_path: Path) -> None:
    zones = Zones(rocks=(KnownRock("boulder", 2.0, 0.1, 0.3),))
    with ScanningBench(tmp_path, ROCK, settings=replace(WATCHED, zones=zones)) as bench:
        assert bench.executive.status.obstacles is bench.settings.zones


def among_rocks(seed: int) -> tuple[World, Waypoint]:
    """Return a world of 5 to 20 rocks that are higher than the laser, and a place in it."""
    draw = Random(seed)
    rocks: list[Rock] = []
    while len(rocks) < 5 + seed % 16:
        x_m, y_m, radius_m = draw.uniform(-1, 7), draw.uniform(-3, 3), draw.uniform(0.1, 0.4)
        if hypot(x_m, y_m) > radius_m + 0.6:
            rocks.append(Rock(x_m, y_m, radius_m, 0.5))
    return World(rocks=tuple(rocks)), Waypoint(draw.uniform(3, 6.5), draw.uniform(-2.5, 2.5))


@pytest.mark.at_length
@pytest.mark.parametrize("seed", [6, 12, 13, 27, 46, 50])
def test_among_unknown_rocks_the_target_is_reached_or_its_obstacle_reported(
    seed: int, tmp_path: Path
) -> None:
    world, position = among_rocks(seed)
    jackal = load_settings("jackal")
    asset = replace(jackal, sensors=replace(jackal.sensors, laser=LaserSettings(rate_hz=10)))
    lockstep = LockStep(asset, world, tmp_path, seed)

    def ended() -> Iterator[Stage]:
        stages = (each.stage for each in lockstep.downlink_record.reports)
        return (each for each in stages if each is not None and each.terminal)

    lockstep.run(0.5)
    lockstep.submit(Command(Identity("test", 1), MoveTo(position), "direct"))
    lockstep.run_until(lambda: any(ended()), 120.0)
    lockstep.run(1.0)
    lockstep.executive.simulate_crash()
    gap_m = min(hypot(position.x_m - r.x_m, position.y_m - r.y_m) - r.radius_m for r in world.rocks)
    reached = gap_m - 0.3335 > 0.1
    assert list(ended()) == [Stage.EXECUTED if reached else Stage.FAILED]
    if not reached:
        blocked = next(
            each for each in lockstep.downlink_record.reports if each.stage is Stage.FAILED
        )
        assert blocked.reason is Reason.PATH_BLOCKED
        assert "target too near to scanned obstacle at (" in blocked.text
    assert lockstep.rover.contacts == 0
