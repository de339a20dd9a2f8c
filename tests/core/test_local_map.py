"""The map of what the laser has seen: circles that cover it, and when they are forgotten."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from math import cos, hypot, inf, pi, sin
from random import Random

from hypothesis import given, settings
from hypothesis import strategies as st

from executive.obstacles.local_map import FORGET_AFTER_S, MAX_CIRCLES, LocalMap
from executive.obstacles.zones import Footprint, KeepIn, KeepOut, KnownRock, Zones
from executive.values.facts import LaserScan
from executive.values.geometry import STANDING, Point, Pose, Velocity
from tests.support.laser import Disc, scan_of

JACKAL = Footprint(0.51, 0.43)
ROCK = Disc(2.0, 0.0, 0.3)


def seeing(*scans: tuple[Pose, Sequence[Disc]], known: Zones | None = None) -> LocalMap:
    """Return a map after looks from poses, a tenth of a second apart."""
    found = LocalMap(JACKAL, known or Zones())
    for number, (pose, discs) in enumerate(scans):
        now_s = 0.1 * number
        found.add_pose(now_s, pose, STANDING)
        found.add_scan(scan_of(pose, discs, now_s), now_s)
    return found


def more(found: LocalMap, pose: Pose, discs: Sequence[Disc], first_s: float, times: int) -> None:
    for number in range(times):
        now_s = first_s + 0.1 * number
        found.add_pose(now_s, pose, STANDING)
        found.add_scan(scan_of(pose, discs, now_s), now_s)


def gaps_m(found: LocalMap, position: Point) -> list[float]:
    return [each.clearance_m(position, position) for each in found.circles]


def returns(scan: LaserScan, pose: Pose) -> list[Point]:
    return [
        Point(pose.x_m + range_m * cos(at_rad), pose.y_m + range_m * sin(at_rad))
        for ray, range_m in enumerate(scan.ranges_m)
        for at_rad in (pose.heading_rad + scan.angle_min_rad + ray * scan.angle_increment_rad,)
        if range_m < inf
    ]


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    radius_m=st.floats(0.08, 0.6),
    away_m=st.floats(0.5, 2.8),
    bearing_rad=st.floats(-pi, pi),
    heading_rad=st.floats(-pi, pi),
)
def test_circles_cover_scanned_surfaces_and_protrude_little(
    radius_m: float, away_m: float, bearing_rad: float, heading_rad: float
) -> None:
    pose = Pose(1.3, -0.7, heading_rad=heading_rad)
    centre_m = away_m + radius_m
    x_m, y_m = pose.x_m + centre_m * cos(bearing_rad), pose.y_m + centre_m * sin(bearing_rad)
    rock = Disc(x_m, y_m, radius_m)
    found = seeing((pose, [rock]), (pose, [rock]))
    positions = returns(scan_of(pose, [rock], 0.0), pose)
    assert all(min(gaps_m(found, position)) <= 0.08 for position in positions)
    assert min(gaps_m(found, pose.point)) >= away_m - 0.12
    for circle in found.circles:
        assert hypot(circle.x_m - x_m, circle.y_m - y_m) + circle.radius_m <= radius_m + 0.42


def test_a_long_surface_is_a_row_of_few_circles() -> None:
    wall = [Disc(2.0, index / 20, 0.05) for index in range(-80, 81)]
    found = seeing((Pose(), wall), (Pose(), wall))
    assert 10 <= len(found.circles) <= 20
    row = sorted(found.circles, key=lambda each: each.y_m)
    assert all(each.x_m - each.radius_m > 1.95 - 0.12 for each in row)
    assert row[0].y_m < -2.5
    assert row[-1].y_m > 2.5
    for one, other in pairwise(row):
        assert hypot(one.x_m - other.x_m, one.y_m - other.y_m) < one.radius_m + other.radius_m + 0.2


def test_circles_are_bounded_and_the_nearest_are_retained() -> None:
    random = Random(1)
    field = [Disc(random.uniform(-5, 5), random.uniform(-5, 5), 0.04) for _ in range(400)]
    field = [each for each in field if hypot(each.x_m, each.y_m) > 0.8]
    found = seeing(*[(Pose(), field)] * 3)
    assert len(found.circles) == MAX_CIRCLES
    nearest = min(field, key=lambda each: each.away_m(Point(0.0, 0.0)))
    assert min(gaps_m(found, Point(nearest.x_m, nearest.y_m))) < 0.1


def test_circles_of_a_passed_surface_change_to_its_other_side() -> None:
    surface = [Disc(1.64 + index / 20, 0.05, 0.03) for index in range(7)]
    read_often, read_once = LocalMap(JACKAL, Zones()), LocalMap(JACKAL, Zones())
    for number in range(40):
        pose, now_s = Pose(0.8, -1.4 + 0.1 * max(0, number - 10)), 0.1 * number
        changing = Disc(pose.x_m - 1.5, pose.y_m, 0.1)
        for found in (read_often, read_once):
            found.add_pose(now_s, pose, STANDING)
            found.add_scan(scan_of(pose, [*surface, changing], now_s), now_s)
        assert read_often.circles or number == 0
    assert set(read_often.circles) == set(read_once.circles)
    assert any(each.x_m > 1.5 and each.y_m < 0.0 for each in read_often.circles)


def test_one_scan_is_nothing_nor_is_one_return() -> None:
    assert seeing((Pose(), [ROCK])).circles == ()
    assert len(seeing((Pose(), [ROCK]), (Pose(), [ROCK])).circles) >= 1
    thin = Disc(2.9, 0.0, 0.01)
    assert seeing(*[(Pose(), [thin])] * 5).circles == ()


def test_the_rover_sees_neither_itself_nor_distant_returns() -> None:
    mast, far = Disc(0.2, 0.0, 0.05), Disc(6.0, 0.0, 0.5)
    assert seeing(*[(Pose(), [mast])] * 3).circles == ()
    assert seeing(*[(Pose(), [far])] * 3).circles == ()


def test_free_cells_are_forgotten_and_hidden_ones_are_not() -> None:
    found = seeing(*[(Pose(), [ROCK])] * 3)
    screen = Disc(1.0, 0.0, 0.3)
    more(found, Pose(), [screen], 0.3, 5)
    assert min(gaps_m(found, Point(1.7, 0.0))) < 0.05
    more(found, Pose(), [], 0.8, 1)
    assert found.circles
    more(found, Pose(), [], 0.9, 2)
    assert found.circles == ()


def test_old_and_distant_circles_are_forgotten() -> None:
    for pose, later_s, left in (
        (Pose(), FORGET_AFTER_S - 5.0, True),
        (Pose(), FORGET_AFTER_S + 1.0, False),
        (Pose(-5.0), 1.0, False),
    ):
        found = seeing(*[(Pose(), [ROCK])] * 3)
        hidden = [Disc(pose.x_m + 0.8, 0.0, 0.4)]
        more(found, pose, hidden, later_s, 1)
        assert (min(gaps_m(found, Point(1.7, 0.0)), default=inf) < 0.05) == left


def test_known_obstacles_are_not_doubled_and_outside_returns_do_not_count() -> None:
    reported = KnownRock("boulder", 2.05, 0.05, 0.3)
    bed = KeepOut("bed", ((-2.0, 1.0), (2.0, 1.0), (2.0, 3.0), (-2.0, 3.0)))
    yard = KeepIn("yard", ((-2.5, -2.0), (4.0, -2.0), (4.0, 4.0), (-2.5, 4.0)))
    known = Zones(keep_in=(yard,), keep_out=(bed,), rocks=(reported,))
    there = [ROCK, Disc(0.0, 1.4, 0.3), Disc(-3.0, 0.0, 0.3), Disc(0.0, -1.5, 0.2)]
    found = seeing(*[(Pose(), there)] * 3, known=known)
    assert {(round(each.x_m), round(each.y_m)) for each in found.circles} == {(0, -1)}


def test_a_late_scan_is_seen_from_where_it_was_taken() -> None:
    found = LocalMap(JACKAL, Zones())
    turning = Velocity(0.0, 2.0)
    for tick in range(40):
        now_s = 0.02 * tick
        found.add_pose(now_s, Pose(heading_rad=2.0 * now_s), turning)
        taken_s = now_s - 0.07
        if tick % 5 == 4:
            found.add_scan(scan_of(Pose(heading_rad=2.0 * taken_s), [ROCK], taken_s), now_s)
    assert found.circles
    assert all(abs(each.y_m) + each.radius_m < 0.4 for each in found.circles)
    found.add_scan(scan_of(Pose(), [Disc(-2.0, 0.0, 0.3)], 99.0), 0.8)
    found.add_scan(scan_of(Pose(), [Disc(-2.0, 0.0, 0.3)], 99.1), 0.9)
    assert all(each.x_m > 0.0 for each in found.circles)


def test_the_same_scans_give_the_same_circles_and_nothing_changes_without_one() -> None:
    random = Random(3)
    field = [Disc(random.uniform(-3, 3), random.uniform(1, 3), 0.15) for _ in range(12)]
    scans = [(Pose(0.05 * index, heading_rad=0.1 * index), field) for index in range(20)]
    one, other = seeing(*scans), seeing(*scans)
    assert one.circles == other.circles
    assert one.circles is one.circles
    one.clear()
    assert one.circles == ()


def test_a_forward_laser_forgets_nothing_behind() -> None:
    found = seeing(*[(Pose(), [ROCK])] * 3)
    for number in range(5):
        now_s = 0.3 + 0.1 * number
        away = Pose(heading_rad=pi)
        found.add_pose(now_s, away, STANDING)
        scan = scan_of(away, [], now_s)
        found.add_scan(replace(scan, angle_min_rad=-pi / 2, ranges_m=scan.ranges_m[:181]), now_s)
    assert found.circles


def test_a_laser_with_reversed_rotation_sees_the_same() -> None:
    aside = Disc(0.0, 2.0, 0.3)
    found = LocalMap(JACKAL, Zones())
    for number, discs in enumerate([[aside]] * 3 + [[Disc(0.0, 1.0, 0.4)]] * 3):
        now_s = 0.1 * number
        found.add_pose(now_s, Pose(), STANDING)
        scan = scan_of(Pose(), discs, now_s)
        ranges_m = (scan.ranges_m[0], *reversed(scan.ranges_m[1:]))
        turned = replace(scan, angle_min_rad=pi, angle_increment_rad=-pi / 180, ranges_m=ranges_m)
        found.add_scan(turned, now_s)
    assert min(gaps_m(found, Point(0.0, 1.7))) < 0.05
