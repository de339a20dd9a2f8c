"""Zones and known rocks: what may be said of them, and what motions they refuse."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from math import cos, pi, sin
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.commands import (
    ConfirmPose,
    DriveFor,
    FollowPath,
    MoveForward,
    MoveTo,
    Request,
    Resume,
    RotateBy,
    RotateTo,
    Waypoint,
)
from executive.obstacles.zones import KeepIn, KeepOut, KnownRock, Zones, has_clearance
from executive.settings import SettingsError, load_settings, structure
from executive.values.geometry import Point, Pose, Velocity, arc
from executive.values.reasons import Reason
from executive.values.reports import Stage
from tests.support.kinematic import Bench, ignoring

SQUARE = ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))
ROCK = KnownRock("boulder", 3.0, 0.0, 0.5)
YARD = KeepIn("yard", ((-4.0, -4.0), (6.0, -4.0), (6.0, 4.0), (-4.0, 4.0)))
BED = KeepOut("bed", ((0.0, 2.0), (2.0, 2.0), (2.0, 3.0), (0.0, 3.0)))
ZONES = Zones(keep_in=(YARD,), keep_out=(BED,), rocks=(ROCK,))
RADIUS_M = 0.3335


def read(zones: dict[str, Any]) -> Zones:
    return structure(zones, Zones, "rover.yaml")


@pytest.mark.parametrize(
    ("zone", "message"),
    [
        ([[0, 0], [1, 0]], "zone 'bed' has 2 corners, not 3 .. 100"),
        ([[0, 0], [1, 1], [1, 0], [0, 1]], "zone 'bed' intersects itself: the side from [0, 0] to"),
        ([[0, 0], [1, 0], [1, 0], [0, 1]], "zone 'bed' has the corner [1.0, 0.0] twice in a row"),
        ([[0, 0], [2, 0], [1, 0]], "zone 'bed' intersects itself"),
        ([[0, 0, 0], [1, 0], [0, 1]], "is not a corner [x, y] within 10000 m"),
        ([[0, 0], [1e9, 0], [0, 1]], "is not a corner"),
        (
            [[0, 0], [1, 0], [0, "b"]],
            ": keep_out[0].corners_m[2][1]: expected a number, got 'b'",
        ),
    ],
)
def test_a_zone_that_is_none_is_refused(zone: list[Any], message: str) -> None:
    with pytest.raises(SettingsError, match="keep_out") as refused:
        read({"keep_out": [{"name": "bed", "corners_m": zone}]})
    assert message in str(refused.value)


def test_names_and_sizes_are_checked() -> None:
    rock = {"name": "a", "x_m": 1, "y_m": 1, "radius_m": 0.1}
    bed = {"name": "a", "corners_m": [[0, 0], [1, 0], [0, 1]]}
    for wrong, message in (
        ({"rocks": [rock], "keep_out": [bed]}, "'a' names two zones or rocks"),
        ({"rocks": [rock | {"radius_m": 0}]}, "radius_m 0 is not above 0"),
        ({"rocks": [rock | {"name": " "}]}, "' ' is not a valid name"),
        ({"rocks": [rock | {"x_m": 1e6}]}, "is not within 10000 m"),
        ({"margin_m": -1}, "margin_m -1 is not in 0 .. 100"),
        ({"keepout": []}, "(did you mean keep_out?); known are keep_in, keep_out, rocks"),
    ):
        with pytest.raises(SettingsError) as refused:
            read(wrong)
        assert message in str(refused.value)
    with pytest.raises(ValueError, match="zones need footprint"):
        replace(load_settings("jackal"), footprint=None, zones=Zones(rocks=(ROCK,)))


@pytest.mark.parametrize(
    ("line", "outside_m"),
    [
        (((2.0, 0.0), (2.0, 0.0)), 1.0),
        (((0.0, 0.0), (0.0, 0.0)), -1.0),
        (((0.5, 0.0), (0.5, 0.2)), -0.5),
        (((-3.0, 1.5), (3.0, 1.5)), 0.5),
        (((-3.0, 0.0), (3.0, 0.0)), 0.0),
        (((2.0, 2.0), (3.0, 3.0)), 2**0.5),
    ],
)
def test_how_far_a_line_is_from_a_polygon(line: Any, outside_m: float) -> None:
    start, end = (Point(*position) for position in line)
    assert KeepOut("a", SQUARE).clearance_m(start, end) == pytest.approx(outside_m)
    assert KeepIn("a", SQUARE).clearance_m(start, end) == pytest.approx(-outside_m)


POINTS = st.builds(Point, st.floats(-4, 4), st.floats(-4, 4))
SHAPES = st.sampled_from(
    [
        KeepOut("a", SQUARE),
        KeepIn("b", ((-5.0, -5.0), (5.0, -5.0), (5.0, 5.0), (0.0, 0.5), (-5.0, 5.0))),
        KnownRock("c", 0.5, -0.2, 0.7),
    ]
)


@pytest.mark.at_length
@given(shape=SHAPES, start=POINTS, end=POINTS, needed_m=st.floats(0.0, 6.0))
def test_a_line_has_the_clearance_of_its_value(
    shape: Any, start: Point, end: Point, needed_m: float
) -> None:
    assert has_clearance(shape, start, end, needed_m) == (shape.clearance_m(start, end) >= needed_m)


@given(shape=SHAPES, path=st.lists(POINTS, min_size=2, max_size=4))
def test_an_accepted_motion_respects_the_distance(shape: Any, path: list[Point]) -> None:
    kinds: Any = {KeepOut: "keep_out", KeepIn: "keep_in", KnownRock: "rocks"}
    zones: Any = {kinds[type(shape)]: (shape,)}
    met = Zones(**zones).encounter(path, 0.3, 0.1)
    begin_m = shape.clearance_m(path[0], path[0])
    along = [
        Point(a.x_m + part * (b.x_m - a.x_m), a.y_m + part * (b.y_m - a.y_m))
        for a, b in pairwise(path)
        for part in (step / 40 for step in range(41))
    ]
    nearest_m = min(shape.clearance_m(position, position) for position in along)
    if met is None:
        assert nearest_m >= min(0.4, begin_m) - 0.08
    else:
        assert nearest_m < 0.4 + 0.11 or begin_m < 0.4
        assert 0 <= met.distance_m <= sum(a.distance_m(b) for a, b in pairwise(path))


@given(travel=st.floats(-1, 1), rotate=st.floats(-1.5, 1.5), lasts=st.floats(0.1, 60))
def test_an_arc_ends_where_many_small_steps_end(travel: float, rotate: float, lasts: float) -> None:
    positions, end = arc(Pose(1.0, 2.0, heading_rad=0.5), Velocity(travel, rotate), lasts)
    x_m, y_m, heading_rad, steps = 1.0, 2.0, 0.5, 500
    for _ in range(steps):
        heading_rad += rotate * lasts / steps / 2
        x_m += travel * lasts / steps * cos(heading_rad)
        y_m += travel * lasts / steps * sin(heading_rad)
        heading_rad += rotate * lasts / steps / 2
    assert end.point.distance_m(Point(x_m, y_m)) < 0.02
    if abs(rotate * lasts) <= 2 * pi:
        assert positions[-1].distance_m(end.point) < 1e-6


@pytest.fixture
def zoned(tmp_path: Path) -> Iterator[Bench]:
    watched = ignoring("odometry_off_twist")
    with Bench(tmp_path, replace(watched, zones=ZONES)) as bench:
        yield bench


@pytest.mark.parametrize(
    ("request_", "distance_m", "obstacle"),
    [
        (MoveForward(5.0), 2.07, "rock 'boulder'"),
        (MoveTo(Waypoint(2.2, 0.0)), 2.07, "rock 'boulder'"),
        (MoveTo(Waypoint(1.0, 4.0)), 1.63, "keep-out zone 'bed'"),
        (MoveForward(-3.8), 3.57, "the edge of keep-in zone 'yard'"),
        (DriveFor(0.5, 0.0, 10.0), 2.07, "rock 'boulder'"),
        (FollowPath((Waypoint(1.0, -1.0), Waypoint(5.0, -0.5))), None, "rock 'boulder'"),
    ],
)
def test_a_motion_too_near_is_refused_by_name_and_distance(
    zoned: Bench, request_: Request, distance_m: float | None, obstacle: str
) -> None:
    refusal = zoned.refusal(request_, 1)
    assert refusal.reason is Reason.PATH_BLOCKED
    assert refusal.text.startswith(f"path blocked by {obstacle}: after ")
    assert [figure.name for figure in refusal.figures] == ["way", "gap", "bound"]
    if distance_m is not None:
        assert refusal.figures[0].value == pytest.approx(distance_m, abs=0.1)


@pytest.mark.at_length
def test_a_motion_with_enough_clearance_is_executed(zoned: Bench) -> None:
    zoned.execute(MoveForward(2.0), 1)
    zoned.execute(RotateTo(pi / 2), 2)
    zoned.execute(DriveFor(0.5, 0.3, 2.0), 3)
    zoned.execute(FollowPath((Waypoint(3.0, 1.2), Waypoint(5.0, 0.0))), 4)


@pytest.mark.at_length
def test_what_waits_is_judged_from_where_the_rover_will_be(zoned: Bench) -> None:
    zoned.submit(MoveForward(1.5), 1)
    assert zoned.refusal(MoveForward(1.0), 2).reason is Reason.PATH_BLOCKED
    zoned.submit(RotateBy(pi / 2), 3)
    assert "bed" in zoned.refusal(MoveForward(1.7), 4).text
    zoned.run(1.0)
    assert zoned.refusal(MoveForward(1.6), 5).reason is Reason.PATH_BLOCKED
    zoned.execute(MoveForward(1.2), 6)
    replaced = zoned.replace(MoveTo(Waypoint(1.0, 4.0)), 7)
    assert "bed" in str(replaced)


def test_a_motion_that_began_at_another_pose_is_judged_again(zoned: Bench) -> None:
    zoned.submit(RotateBy(0.1), 1)
    zoned.submit(MoveForward(2.0), 2)
    zoned.run(0.1)
    zoned.rover.pose = replace(zoned.rover.pose, x_m=0.15)
    assert zoned.finish(2) is Stage.FAILED
    assert zoned.last(2).reason is Reason.PATH_BLOCKED
    assert zoned.rover.pose.x_m < 0.2


@pytest.mark.at_length
def test_a_rover_too_near_may_leave_but_not_approach(zoned: Bench) -> None:
    zoned.rover.pose = Pose(2.3, 0.0)
    zoned.run(0.1)
    zoned.submit(Resume(), 1)
    assert zoned.refusal(MoveForward(0.2), 2).reason is Reason.PATH_BLOCKED
    assert zoned.refusal(MoveForward(3.0), 3).reason is Reason.PATH_BLOCKED
    zoned.execute(RotateBy(0.3), 4)
    zoned.execute(MoveForward(-1.0), 5)
    zoned.rover.pose = Pose(-6.0, 0.0)
    zoned.run(0.1)
    zoned.submit(Resume(), 6)
    zoned.execute(ConfirmPose(0.0, 0.0), 9)
    assert zoned.refusal(MoveForward(-1.0), 7).reason is Reason.PATH_BLOCKED
    zoned.execute(MoveForward(4.0), 8)
