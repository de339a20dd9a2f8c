"""Ways around known rocks and zones: found, driven with their clearance, or refused with reason."""

import json
from dataclasses import replace
from functools import partial
from itertools import pairwise
from math import hypot, inf
from pathlib import Path
from random import Random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from executive.checks import check_request, detoured_segments, path_check, path_of
from executive.checks.path_check import best_detour
from executive.commands import (
    Command,
    DriveFor,
    FollowPath,
    MoveTo,
    Request,
    SetTravelSpeed,
    Stop,
    Waypoint,
)
from executive.commands.lifecycle import Accepted, Rejected, SubmitResult
from executive.core import dispatcher
from executive.core.dispatcher import MAX_SEARCH_TURNS
from executive.obstacles.detour import Detours, DetourSearch, search_detour
from executive.obstacles.zones import KeepIn, KeepOut, KnownRock, Zones
from executive.settings import load_settings
from executive.values.geometry import STANDING, Point, Pose
from executive.values.reasons import Reason
from executive.values.reports import Identity, Severity, Stage
from sim.rover.lockstep import LockStep
from sim.rover.world import Rock, World
from tests.benchmarks.previews import crowd
from tests.support.kinematic import Bench, ignoring

JACKAL = load_settings("jackal")
WATCHED = ignoring("odometry_off_twist")
GOALS = Path(__file__).parents[1] / "benchmarks" / "goals.json"
SCENES: list[dict[str, Any]] = json.loads(GOALS.read_text())["rock_scenes"]
RADIUS_M, MARGIN_M = 0.3335, 0.1
YARD = KeepIn("yard", ((-2.0, -3.0), (8.0, -3.0), (8.0, 3.0), (-2.0, 3.0)))
BAR = KeepOut("bar", ((2.0, -4.0), (2.5, -4.0), (2.5, 1.5), (2.0, 1.5)))


def rocks_of(scene: dict[str, Any]) -> Zones:
    return Zones(rocks=tuple(KnownRock(f"r{i}", **each) for i, each in enumerate(scene["rocks"])))


def drive(bench: Bench, request: MoveTo | FollowPath) -> tuple[Stage, float]:
    """Return how a motion ends, and how near the disc of the rover came to anything."""
    bench.submit(request, 1)
    positions, zones = [bench.rover.pose.point], bench.settings.zones
    bench.step()
    while not bench.stages(1)[-1].terminal:
        bench.step()
        positions.append(bench.rover.pose.point)
    nearest_m = min(each.clearance_m(a, b) for each in zones for a, b in pairwise(positions))
    return bench.stages(1)[-1], nearest_m - RADIUS_M


@pytest.mark.at_length
@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: str(scene["id"]))
def test_known_rocks_are_detoured_with_the_margin(scene: dict[str, Any], tmp_path: Path) -> None:
    target = Waypoint(scene["x_m"], scene["y_m"], scene["heading_rad"])
    with Bench(tmp_path, replace(WATCHED, zones=rocks_of(scene))) as bench:
        stage, gap_m = drive(bench, MoveTo(target))
        assert stage is Stage.EXECUTED, bench.last(1).text
        assert gap_m > MARGIN_M - 0.02


@pytest.mark.at_length
@pytest.mark.parametrize("scene", [SCENES[2], SCENES[5]], ids=lambda scene: str(scene["id"]))
def test_in_the_simulation_nothing_is_touched_and_no_monitor_objects(
    scene: dict[str, Any], tmp_path: Path
) -> None:
    world = World(rocks=tuple(Rock(**each, height_m=0.4) for each in scene["rocks"]))
    lockstep = LockStep(replace(JACKAL, zones=rocks_of(scene)), world, tmp_path)

    def ended() -> bool:
        return any(
            each.stage is not None and each.stage.terminal
            for each in lockstep.downlink_record.reports
        )

    lockstep.run(0.5)
    target = Waypoint(scene["x_m"], scene["y_m"], scene["heading_rad"])
    lockstep.submit(Command(Identity("test", 1), MoveTo(target), "direct"))
    lockstep.run_until(ended, 60.0)
    lockstep.executive.simulate_crash()
    reports = lockstep.downlink_record.reports
    assert Stage.EXECUTED in [each.stage for each in reports]
    severe = [each.text for each in reports if each.severity is not Severity.INFORMATIONAL]
    assert [each for each in severe if each] == []
    assert lockstep.rover.contacts == 0


@pytest.mark.at_length
def test_a_detour_passes_zones_and_remains_within_the_yard(tmp_path: Path) -> None:
    zones = Zones(keep_in=(YARD,), keep_out=(BAR,))
    with Bench(tmp_path, replace(WATCHED, zones=zones)) as bench:
        stage, gap_m = drive(bench, MoveTo(Waypoint(5.0, -1.0)))
        assert stage is Stage.EXECUTED, bench.last(1).text
        assert gap_m > MARGIN_M - 0.02
        texts = [each.text for each in bench.received.reports if each.stage is Stage.PROGRESS]
        assert texts[0].startswith("detour around obstacles by (")


def test_the_detour_of_a_command_is_searched_once_until_it_begins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    detours: list[Point] = []

    def counted(start: Point, *rest: Any) -> DetourSearch:
        detours.append(start)
        return search_detour(start, *rest)

    monkeypatch.setattr(path_check, "search_detour", counted)
    zones = Zones(rocks=(KnownRock("searched once", 2.0, 0.1, 0.3),))
    with Bench(tmp_path, replace(WATCHED, zones=zones)) as bench:
        bench.submit(MoveTo(Waypoint(4.0, 0.0)), 1)
        bench.run(0.2)
        assert bench.rover.velocity.rotate_radps != 0.0
        assert detours == [Point(0.0, 0.0)]


@pytest.mark.parametrize("behind", [SetTravelSpeed(0.2), Stop()], ids=["command", "stop"])
def test_a_command_is_answered_once_its_search_has_ended(behind: Request, tmp_path: Path) -> None:
    zones, target = crowd(3)
    answers: list[tuple[int, SubmitResult]] = []

    def note(number: int, answer: SubmitResult) -> None:
        answers.append((number, answer))

    with Bench(tmp_path, replace(WATCHED, zones=zones)) as bench:
        for number, request in enumerate((MoveTo(target), behind), 1):
            command = Command(Identity("MOE", number), request, "direct")
            bench.executive.submit(command, partial(note, number))
            bench.executive.serve_inbox()
        turns = 2
        while len(answers) < 2:
            assert not answers
            bench.executive.serve_inbox()
            turns += 1
        found = [(number, type(answer)) for number, answer in answers]
        if isinstance(behind, Stop):
            assert turns == 2
            assert found == [(2, Accepted), (1, Rejected)]
        else:
            assert 3 < turns < MAX_SEARCH_TURNS
            assert found == [(1, Accepted), (2, Accepted)]


def test_during_a_long_search_the_rover_is_stationary(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dispatcher, "MAX_SEARCH_TURNS", 0)
    zones, target = crowd(3)
    asset = replace(WATCHED, zones=zones)
    corners = best_detour(target, Pose(), asset, zones, None)
    assert corners
    with Bench(tmp_path, asset) as bench:
        assert isinstance(bench.submit(MoveTo(target), 1), Accepted)
        ticks = 0
        while bench.stages(1)[-1] is not Stage.PROGRESS:
            assert bench.rover.velocity == STANDING
            bench.step()
            ticks += 1
        assert ticks > 3
        listing = ", ".join(f"({each.x_m:.2f}, {each.y_m:.2f})" for each in corners)
        assert bench.last(1).text == f"detour around obstacles by {listing}"


def test_a_held_velocity_waits_for_the_search_of_the_path_home(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dispatcher, "MAX_SEARCH_TURNS", 0)
    zones, target = crowd(3)
    assert WATCHED.battery is not None
    battery = replace(WATCHED.battery, home=Point(target.x_m, target.y_m))
    with Bench(tmp_path, replace(WATCHED, zones=zones, battery=battery)) as bench:
        bench.charge_ratio = battery.reserve_ratio + 1000.0 / battery.capacity_j
        bench.step()
        assert isinstance(bench.submit(DriveFor(-0.3, 0.0, 0.5), 1), Accepted)
        assert bench.finish(1) is Stage.FAILED
        assert bench.last(1).reason is Reason.BATTERY_INSUFFICIENT
        assert bench.rover.pose == Pose()


def test_a_search_takes_turns_of_the_core_between_ticks(tmp_path: Path) -> None:
    zones, target = crowd(3)
    woken: list[bool] = []
    with Bench(tmp_path, replace(WATCHED, zones=zones)) as bench:
        bench.executive.wake = lambda: woken.append(True)
        bench.submit(MoveTo(target), 1)
        while woken:
            woken.clear()
            bench.executive.serve_inbox()
        bench.step()
        assert bench.stages(1)[-1] is Stage.PROGRESS


def test_without_a_free_path_the_blocking_obstacle_is_named() -> None:
    wall = KeepOut("wall", ((2.0, -4.0), (2.5, -4.0), (2.5, 4.0), (2.0, 4.0)))
    walled = replace(JACKAL, zones=Zones(keep_in=(YARD,), keep_out=(wall,)))
    refusal = check_request(MoveTo(Waypoint(5.0, 0.0)), Pose(), walled, walled.zones)
    assert refusal is not None
    assert refusal.reason is Reason.PATH_BLOCKED
    assert refusal.text.startswith("path blocked by keep-out zone 'wall': after ")
    assert refusal.text.endswith("; no detour found")


def test_a_target_too_near_to_an_obstacle_is_refused_with_its_name() -> None:
    fenced = replace(JACKAL, zones=Zones(keep_in=(YARD,), keep_out=(BAR,)))
    refusal = check_request(MoveTo(Waypoint(7.8, 0.0)), Pose(), fenced, fenced.zones)
    assert refusal is not None
    assert refusal.text.startswith("path blocked by keep-out zone 'bar'")
    near = "target too near to the edge of keep-in zone 'yard'"
    assert refusal.text.endswith(f"; {near}")


def test_a_path_is_driven_as_it_is_given() -> None:
    fenced = replace(JACKAL, zones=Zones(keep_out=(BAR,)))
    refusal = check_request(FollowPath((Waypoint(5.0, -1.0),)), Pose(), fenced, fenced.zones)
    assert refusal is not None
    assert refusal.text.startswith("path blocked by keep-out zone 'bar'")


def test_a_detour_is_the_shortest_path_except_at_its_corners() -> None:
    rock = KnownRock("boulder", 3.0, 0.1, 0.5)
    ends = Point(0.0, 0.0), Point(6.0, 0.0)
    zones = Zones(rocks=(rock,))
    path = Detours(inf).find(1, lambda: search_detour(*ends, zones, 0.5, lambda _: True))
    assert path is not None
    assert path.reaches_goal
    assert path.corners == ()

    def leads(position: Point) -> bool:
        return rock.clearance_m(Point(0.0, 0.0), position) >= 0.5

    path = Detours(inf).find(2, lambda: search_detour(*ends, zones, 0.5, leads))
    assert path is not None
    positions = [Point(0.0, 0.0), *path.corners, Point(6.0, 0.0)]
    assert all(position.y_m < 0.0 for position in path.corners)
    assert sum(a.distance_m(b) for a, b in pairwise(positions)) < 6.0 + 0.35


@settings(max_examples=25, deadline=None, derandomize=True)
@given(seed=st.integers(0, 10_000), count=st.integers(5, 20))
def test_among_random_rocks_each_line_respects_the_margin(seed: int, count: int) -> None:
    draw = Random(seed)
    rocks: list[KnownRock] = []
    while len(rocks) < count:
        x_m, y_m, radius_m = draw.uniform(-1, 7), draw.uniform(-3, 3), draw.uniform(0.1, 0.4)
        if hypot(x_m, y_m) > radius_m + 0.6:
            rocks.append(KnownRock(f"r{len(rocks)}", x_m, y_m, radius_m))
    asset = replace(JACKAL, zones=Zones(rocks=tuple(rocks)))
    request = MoveTo(Waypoint(draw.uniform(3, 6.5), draw.uniform(-2.5, 2.5)))
    refusal = check_request(request, Pose(), asset, asset.zones)
    segments = detoured_segments(request, Pose(), asset, asset.zones)
    path = path_of(segments, asset.turn_drive)
    gap_m = min(each.clearance_m(a, b) for each in rocks for a, b in pairwise(path)) - RADIUS_M
    if refusal is None:
        assert gap_m >= MARGIN_M - 0.006
    else:
        assert gap_m < MARGIN_M
