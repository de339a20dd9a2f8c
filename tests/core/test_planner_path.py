"""The path of the navigation's planner: waited for, checked, and what happens without one."""

from collections.abc import Iterator
from dataclasses import replace
from math import nan, pi
from pathlib import Path

import pytest

from executive.commands import (
    FollowPath,
    Motion,
    MoveTo,
    SetPositionCompensation,
    Waypoint,
)
from executive.faults import Reaction
from executive.obstacles.zones import KeepOut, Zones
from executive.preview import Preview
from executive.settings import BatterySettings, NavigationGate
from executive.values.facts import PlannedPath
from executive.values.geometry import Point, Pose, TargetFrame, wrap_rad
from executive.values.ports import PathRequest
from executive.values.reasons import Reason, Refusal
from executive.values.reports import Report, Stage
from tests.support.navigated import settings
from tests.support.planned import PlannedBench
from trees import RoverTree
from trees.leaf import Leaf

THERE = Waypoint(4.0, 0.0)
AROUND = (Point(1.0, 1.5), Point(3.0, 1.5))
CRATER = KeepOut("crater", ((1.5, -0.5), (2.5, -0.5), (2.5, 0.5), (1.5, 0.5)))
ZONED = settings(NavigationGate.RELAY, zones=Zones(keep_out=(CRATER,)))
FREE = settings(NavigationGate.RELAY)


@pytest.fixture
def zoned(tmp_path: Path) -> Iterator[PlannedBench]:
    with PlannedBench(tmp_path, ZONED) as bench:
        yield bench


@pytest.fixture
def free(tmp_path: Path) -> Iterator[PlannedBench]:
    with PlannedBench(tmp_path, FREE) as bench:
        yield bench


def figures(refusal: Refusal | Report) -> dict[str, float]:
    return {each.name: each.value for each in refusal.figures}


def test_a_path_around_a_zone_is_driven_though_the_straight_line_is_not_free(
    zoned: PlannedBench,
) -> None:
    zoned.rover.via = AROUND
    zoned.submit(MoveTo(THERE), 1)
    zoned.run(1.0)
    length_m = 2 * Point(0.0, 0.0).distance_m(AROUND[0]) + 2.0
    assert zoned.texts(1) == [f"planned path of {length_m:.2f} m"]
    assert [each.number for each in zoned.rover.requests] == [1]


def test_a_path_through_a_zone_is_refused_with_the_figures_of_own_paths(
    zoned: PlannedBench,
) -> None:
    zoned.submit(MoveTo(THERE), 1)
    assert zoned.finish(1) is Stage.FAILED
    last = zoned.last(1)
    assert last.reason is Reason.PATH_BLOCKED
    assert last.text.startswith("planned path blocked by keep-out zone 'crater': after ")
    assert figures(last)["gap"] <= 0.0 < figures(last)["bound"]
    assert not zoned.rover.goals


def test_a_target_in_a_zone_is_refused_at_intake(zoned: PlannedBench) -> None:
    refusal = zoned.refusal(FollowPath((Waypoint(0.0, 2.0), Waypoint(2.0, 0.0))), 1)
    assert refusal.reason is Reason.PATH_BLOCKED
    assert "the waypoint (2, 0) the rover would be in keep-out zone 'crater'" in refusal.text
    assert not zoned.rover.requests


@pytest.mark.parametrize(
    ("via", "text"),
    [
        (None, "no path of the planner in time"),
        ("NO_VALID_PATH 208", "NO_VALID_PATH 208"),
        ((Point(nan, 0.0),), "the planner's path is not finite"),
    ],
)
def test_without_a_path_the_straight_line_is_checked_and_reported(
    free: PlannedBench, via: tuple[Point, ...] | str | None, text: str
) -> None:
    free.rover.via = via
    free.submit(MoveTo(THERE), 1)
    free.run(2.5)
    assert free.texts(1) == [f"straight line of 4.00 m checked: {text}"]
    assert free.stages(1)[-1] is not Stage.FAILED


def test_without_a_path_a_zone_on_the_straight_line_refuses_the_leg(zoned: PlannedBench) -> None:
    zoned.rover.via = "TF_ERROR"
    zoned.submit(MoveTo(THERE), 1)
    assert zoned.finish(1) is Stage.FAILED
    assert zoned.last(1).reason is Reason.PATH_BLOCKED
    assert zoned.last(1).text.startswith("straight path blocked by keep-out zone 'crater'")
    assert zoned.last(1).text.endswith("; TF_ERROR")


def test_without_a_path_zones_need_their_monitor(tmp_path: Path) -> None:
    ignored = replace(ZONED.faults.zone_ahead, reaction=Reaction.IGNORE)
    asset = replace(ZONED, faults=replace(ZONED.faults, zone_ahead=ignored))
    with PlannedBench(tmp_path, asset) as bench:
        bench.rover.via = "no planner"
        bench.submit(MoveTo(Waypoint(0.0, 3.0)), 1)
        assert bench.finish(1) is Stage.FAILED
        assert bench.last(1).reason is Reason.PATH_BLOCKED
        assert "zone_ahead does not stop the rover: ignore" in bench.last(1).text


def test_a_path_to_another_target_counts_as_none(free: PlannedBench) -> None:
    free.rover.plan_path = lambda request: free.rover.facts.append(  # type: ignore[method-assign]
        PlannedPath(request.number, (request.start.point, Point(9.0, 9.0)))
    )
    free.submit(MoveTo(THERE), 1)
    free.run(1.0)
    assert free.texts(1) == [
        "straight line of 4.00 m checked: the planner's path ends 10.30 m from where it should"
    ]


def test_the_request_is_in_the_frame_of_odometry_and_its_answer_too(zoned: PlannedBench) -> None:
    zoned.submit(SetPositionCompensation(1.0, 0.0, 0.0, pi / 2), 1)
    zoned.run(0.2)
    zoned.rover.via = (Point(1.0, 1.5),)  # (-0.5, 1) in the frame of the pose
    zoned.submit(MoveTo(Waypoint(1.0, 3.0, pi / 2)), 2)
    zoned.run(1.0)
    (request,) = zoned.rover.requests
    assert request.frame is TargetFrame.ODOM
    assert (request.start.x_m, request.start.y_m) == pytest.approx((0.0, 0.0))
    assert (request.goal.x_m, request.goal.y_m) == pytest.approx((3.0, 0.0))
    assert request.goal.heading_rad == pytest.approx(0.0)
    (text,) = zoned.texts(2)
    assert text.startswith("planned path of ")


def test_a_target_in_the_map_is_requested_in_the_map(free: PlannedBench) -> None:
    free.rover.map_to_odom = Pose(5.0, 0.0)
    free.run(0.2)
    free.submit(MoveTo(Waypoint(8.0, 1.0), frame=TargetFrame.MAP), 1)
    free.run(1.0)
    (request,) = free.rover.requests
    assert request.frame is TargetFrame.MAP
    assert (request.start.x_m, request.goal.x_m) == pytest.approx((5.0, 8.0))


def test_a_battery_that_suffices_for_the_straight_line_only_refuses_the_leg(tmp_path: Path) -> None:
    far = Point(0.0, 40.0)
    asset = replace(FREE, battery=BatterySettings(20_000.0, 0.1))
    with PlannedBench(tmp_path, asset) as bench:
        bench.charge_ratio = 0.15
        bench.run(0.1)
        bench.rover.via = (far,)
        found = bench.previewed(MoveTo(THERE))
        bench.submit(MoveTo(THERE), 1)
        assert bench.finish(1) is Stage.FAILED
        assert bench.last(1).reason is Reason.BATTERY_INSUFFICIENT
        assert isinstance(found, Refusal)
        assert found.reason is Reason.BATTERY_INSUFFICIENT
        assert figures(found)["needed"] == pytest.approx(figures(bench.last(1))["needed"], rel=1e-6)


def drive_timeout_s(bench: PlannedBench, via: tuple[Point, ...], there: Waypoint = THERE) -> float:
    """Begin a drive, and return its timeout."""
    bench.rover.via = via
    bench.submit(MoveTo(there), 1)
    bench.run(2.0)
    tree = bench.executive.tree
    assert isinstance(tree, RoverTree)
    (drive,) = (each for each in tree.root.iterate() if each.name == "drive")
    assert isinstance(drive, Leaf)
    return drive.timeout_s


def test_the_deadline_is_that_of_the_length_of_the_path(tmp_path: Path) -> None:
    assert FREE.navigation is not None
    timeouts_s = []
    for index, via in enumerate(((), (Point(0.0, 30.0),))):
        (tmp_path / str(index)).mkdir()
        with PlannedBench(tmp_path / str(index), FREE) as bench:
            timeouts_s.append(drive_timeout_s(bench, via))
    longer_m = 30.0 + Point(0.0, 30.0).distance_m(Point(4.0, 0.0)) - 4.0
    expected_s = 2.0 * longer_m / FREE.navigation.speed_mps
    assert timeouts_s[1] - timeouts_s[0] == pytest.approx(expected_s, rel=0.01)


def test_a_navigation_of_half_its_speed_is_in_time(free: PlannedBench) -> None:
    assert drive_timeout_s(free, (), Waypoint(80.0, 0.0)) > 80.0 / 0.26 + 10.0  # Nav2's DWB


def test_each_part_of_a_path_has_its_own_request(free: PlannedBench) -> None:
    path = FollowPath((Waypoint(2.0, 0.0), Waypoint(2.0, 2.0)))
    free.submit(path, 1)
    assert free.finish(1) is Stage.EXECUTED
    goals = [(each.goal.x_m, each.goal.y_m) for each in free.rover.requests]
    assert goals == [pytest.approx((2.0, 0.0)), pytest.approx((2.0, 2.0))]


@pytest.mark.parametrize("frame", TargetFrame)
def test_the_prediction_of_a_command_is_along_the_path_of_its_leg(
    free: PlannedBench, frame: TargetFrame
) -> None:
    free.submit(SetPositionCompensation(0.5, 0.0, 0.0, 0.2), 1)
    free.rover.map_to_odom = Pose(0.5, 0.5, heading_rad=0.3)
    free.run(0.5)
    free.rover.via = AROUND
    free.execute(MoveTo(Waypoint(5.0, 0.0), frame=frame), 2)
    found = figures(free.last(2))
    assert found["predicted length"] == pytest.approx(found["length"], rel=0.1)
    assert found["predicted length"] > 5.0
    assert found["predicted x"] == pytest.approx(found["x"], abs=0.06)
    assert found["predicted y"] == pytest.approx(found["y"], abs=0.06)


def test_a_preview_is_refused_as_the_leg_is(zoned: PlannedBench) -> None:
    found = zoned.previewed(MoveTo(THERE))
    assert isinstance(found, Refusal)
    zoned.submit(MoveTo(THERE), 1)
    zoned.finish(1)
    assert (found.reason, found.text) == (zoned.last(1).reason, zoned.last(1).text)


def test_a_preview_without_a_path_is_marked(free: PlannedBench) -> None:
    free.rover.via = "no planner"
    found = free.previewed(MoveTo(THERE))
    assert isinstance(found, Preview)
    assert found.note == "along straight lines: no planner"
    assert found.length_m == pytest.approx(4.0, abs=0.05)


def test_a_preview_leaves_the_planner_to_a_navigated_drive(free: PlannedBench) -> None:
    free.submit(MoveTo(THERE), 1)
    free.run(1.0)
    wanted = PathRequest(0, Pose(), Pose(1.0), TargetFrame.ODOM)
    assert free.executive.predictions.request_path(wanted) is None
    assert free.finish(1) is Stage.EXECUTED
    numbered = free.executive.predictions.request_path(wanted)
    assert numbered is not None
    assert numbered.number == -1


def test_a_preview_follows_the_path_of_the_planner(zoned: PlannedBench) -> None:
    zoned.rover.via = AROUND
    found = zoned.previewed(MoveTo(THERE))
    assert isinstance(found, Preview), found
    length_m = 2 * Point(0.0, 0.0).distance_m(AROUND[0]) + 2.0
    assert found.length_m == pytest.approx(length_m, abs=0.15)
    assert not found.note
    assert max(each.pose.y_m for each in found.path) == pytest.approx(1.5, abs=0.05)
    assert found.end.point.distance_m(Point(4.0, 0.0)) < 0.05
    zoned.submit(MoveTo(THERE), 1)
    zoned.run(0.5)
    assert found.energy_j is not None


@pytest.mark.at_length
@pytest.mark.parametrize("gate", NavigationGate)
@pytest.mark.parametrize(
    ("motion", "via"),
    [
        (MoveTo(Waypoint(4.0, 0.0, pi / 2)), AROUND),
        (MoveTo(Waypoint(3.0, 1.0), frame=TargetFrame.MAP), ()),
        (FollowPath((Waypoint(2.0, 0.5, tolerance_m=0.8), Waypoint(4.0, 0.0, -1.0))), ()),
        (FollowPath((Waypoint(2.0, 0.0), Waypoint(2.0, 2.0, 0.0), Waypoint(2.0, 2.0, 1.0))), ()),
    ],
)
def test_a_preview_agrees_with_the_drive(
    tmp_path: Path, motion: Motion, via: tuple[Point, ...], gate: NavigationGate
) -> None:
    with PlannedBench(tmp_path, settings(gate)) as bench:
        bench.rover.via = via
        bench.rover.map_to_odom = Pose(0.5, 0.5, heading_rad=0.3)
        bench.submit(SetPositionCompensation(1.0, 0.0, 0.0, 0.4), 1)
        bench.run(0.5)
        found = bench.previewed(motion)
        assert isinstance(found, Preview), found
        before_m, before_s = bench.executive.status.travelled_m, bench.clock.now_s()
        bench.execute(motion, 2)
        pose = bench.executive.status.pose
        assert pose.point.distance_m(found.end.point) <= found.within_m
        assert abs(wrap_rad(pose.heading_rad - found.end.heading_rad)) <= found.within_rad + 0.05
        driven_m = bench.executive.status.travelled_m - before_m
        assert found.length_m == pytest.approx(driven_m, rel=0.12)
        took_s = bench.clock.now_s() - before_s  # the navigation's speeds are its own
        assert 0.4 * took_s <= found.duration_s <= took_s
