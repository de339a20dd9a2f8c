"""`LocalMap`: obstacles in recent laser scans, as circles in the frame of the rover's pose.

Returns are collected in the cells of a grid, merged with those of earlier scans, and removed once
their position is scanned as free. Circles cover each group of adjacent cells.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from math import atan2, ceil, cos, floor, hypot, pi, sin, sqrt
from typing import Final

from executive.obstacles.zones import Footprint, KeepIn, ScannedObstacle, Zones
from executive.values.facts import LaserScan
from executive.values.geometry import STANDING, Point, Pose, Velocity, arc_end, wrap_rad

CELL_M: Final = 0.1
MAX_RANGE_M: Final = 4.0
"""Maximum range of returns; farther ones are too sparse, and too wrong by the heading."""
FORGET_RANGE_M: Final = 6.0
"""Range beyond which a cell is removed."""
FORGET_AFTER_S: Final = 60.0
"""Age beyond which a cell is removed unless it is seen again: the odometry drifts."""
MIN_SCANS: Final = 2
"""Minimum number of scans that show an obstacle in a cell to add it, or free space to remove it."""
AVERAGED_SCANS: Final = 5
"""Number of scans over which the position of a cell is averaged."""
NEIGHBOUR_M: Final = 0.1
NEIGHBOUR_PER_M: Final = 0.05
"""Maximum range difference between neighbouring returns: a single return is ignored."""
FREE_M: Final = 0.15
FREE_PER_M: Final = 0.03
"""Minimum length of rays beyond a position that show it to be free."""
ASSOCIATION_M: Final = 0.15
"""Distance within which a return belongs to a known rock or a keep-out zone (data association)."""
MAX_CIRCLE_RADIUS_M: Final = 0.2
"""Half of the maximum length of a surface that one circle covers."""
FLAT_SURFACE_FACTOR: Final = 1.75
"""Maximum ratio of a circle's radius to the minimum radius, for a flat one: it protrudes less."""
CIRCLE_MARGIN_M: Final = 0.02
"""Margin of a circle's radius, for the surface between the measured points."""
RECLUSTER_M: Final = 0.25
"""Distance after which circles are computed again, as the cells are seen from another side."""
MAX_CIRCLES: Final = 48
"""Maximum number of circles; the nearest are retained."""
POSE_BUFFER: Final = 50
"""Number of poses, one per odometry message: they cover more than the delay of a scan."""
MAX_EXTRAPOLATION_S: Final = 0.2
"""Maximum lead of a scan over the odometry; the pose is then extrapolated by the velocity."""
NEGLIGIBLE_TURN_RADPS: Final = 0.1
"""Maximum yaw rate that makes the time of a scan irrelevant."""

_Key = tuple[int, int]


@dataclass(slots=True)
class _Cell:
    """The obstacle in a square of the ground: the mean of the first scans that showed it.

    Attributes:
        from_x_m, from_y_m: position of the laser at its last scan of the cell.
    """

    x_m: float
    y_m: float
    from_x_m: float
    from_y_m: float
    seen_s: float
    scans: int = 1
    misses: int = 0

    @property
    def counts(self) -> bool:
        return self.scans >= MIN_SCANS

    def side(self, cosine: float, sine: float) -> float:
        """Return the sine of the angle from a direction to that of the laser."""
        x_m, y_m = self.from_x_m - self.x_m, self.from_y_m - self.y_m
        return (y_m * cosine - x_m * sine) / (hypot(x_m, y_m) or 1.0)


class LocalMap:
    """A rolling map of obstacles around the rover, except the known ones.

    Args:
        footprint: of the rover; returns of the rover itself are ignored.
        known: zones and rocks; their returns are ignored.
    """

    def __init__(self, footprint: Footprint, known: Zones) -> None:
        self._footprint = footprint
        self._known = known
        self._cells: dict[_Key, _Cell] = {}
        self._circles: tuple[ScannedObstacle, ...] | None = ()
        self._covers: dict[tuple[_Key, ...], tuple[ScannedObstacle, ...]] = {}
        self._changed: set[_Key] = set()
        self._poses: deque[tuple[float, Pose]] = deque(maxlen=POSE_BUFFER)
        self._velocity = STANDING
        self._covered_at = Point(0.0, 0.0)

    def clear(self) -> None:
        """Discard all cells: the pose jumped, so that their positions are wrong."""
        self._poses.clear()
        self._cells.clear()
        self._circles = ()

    def add_pose(self, stamp_s: float, pose: Pose, velocity: Velocity) -> None:
        """Add the pose of the rover at an odometry message.

        Args:
            stamp_s: on the clock of its publisher, assumed to be that of the laser.
            pose: in the frame of the circles.
            velocity: for extrapolation.
        """
        self._poses.append((stamp_s, pose))
        self._velocity = velocity

    def add_scan(self, scan: LaserScan, now_s: float) -> None:
        """Add a scan, unless the pose at its stamp is unknown.

        Args:
            scan: in the axes of base_link.
            now_s: the time, by a clock that never goes back.
        """
        pose = self._pose_at(scan.stamp_s)
        if pose is None:
            return
        if pose.point.distance_m(self._covered_at) > RECLUSTER_M:
            self._circles, self._covers = None, {}
        seen = self._returns(scan, pose)
        for key, (count, x_m, y_m) in seen.items():
            self._add(key, Point(x_m / count, y_m / count), pose, now_s)
        cleared = [
            key
            for key in self._cells
            if key not in seen and self._is_cleared(key, scan, pose, now_s)
        ]
        for key in cleared:
            if self._cells.pop(key).counts:
                self._circles = None

    @property
    def circles(self) -> tuple[ScannedObstacle, ...]:
        """The scanned obstacles that are not known; the same object until they change."""
        if self._circles is None:
            here = self._poses[-1][1].point
            if not self._covers:
                self._covered_at = here
            self._covers = {keys: self._cover(keys) for keys in self._clusters()}
            self._changed.clear()
            found = [circle for circles in self._covers.values() for circle in circles]
            found.sort(key=lambda each: hypot(each.x_m - here.x_m, each.y_m - here.y_m))
            self._circles = tuple(found[:MAX_CIRCLES])
        return self._circles

    def _pose_at(self, stamp_s: float) -> Pose | None:
        """Return the pose at a time of the odometry's clock, or None if it is unknown.

        For a stamp of another clock, the newest pose while the rover hardly turns.
        """
        if not self._poses:
            return None
        after_s, after = self._poses[-1]
        if 0.0 <= (late_s := stamp_s - after_s) <= MAX_EXTRAPOLATION_S:
            velocity = self._velocity
            return arc_end(after, velocity.travel_mps * late_s, velocity.rotate_radps * late_s)
        for before_s, before in reversed(self._poses):
            if before_s <= stamp_s < after_s:
                return _between(before, after, (stamp_s - before_s) / (after_s - before_s))
            after_s, after = before_s, before
        hardly = abs(self._velocity.rotate_radps) <= NEGLIGIBLE_TURN_RADPS
        return self._poses[-1][1] if hardly else None

    def _returns(self, scan: LaserScan, pose: Pose) -> dict[_Key, tuple[int, float, float]]:
        """Return the number of returns in each cell, and the sums of their positions."""
        directions = directions_of(scan)
        ranges_m, last = scan.ranges_m, len(scan.ranges_m) - 1
        least_m, max_m = scan.range_min_m, min(scan.range_max_m, MAX_RANGE_M)
        cosine, sine = cos(pose.heading_rad), sin(pose.heading_rad)
        half_m, side_m = self._footprint.length_m / 2, self._footprint.width_m / 2
        found: dict[_Key, tuple[int, float, float]] = {}
        for index, range_m in enumerate(ranges_m):
            if not least_m < range_m <= max_m:
                continue
            near_m = NEIGHBOUR_M + NEIGHBOUR_PER_M * range_m
            after_m = ranges_m[index + 1 if index < last else 0]
            if not (
                abs(ranges_m[index - 1] - range_m) <= near_m or abs(after_m - range_m) <= near_m
            ):  # a neighbour that is NaN does not count
                continue
            ahead, aside = directions[index]
            ahead_m, left_m = range_m * ahead, range_m * aside
            if abs(ahead_m) <= half_m and abs(left_m) <= side_m:
                continue
            x_m = pose.x_m + ahead_m * cosine - left_m * sine
            y_m = pose.y_m + ahead_m * sine + left_m * cosine
            key = floor(x_m / CELL_M), floor(y_m / CELL_M)
            count, sum_x_m, sum_y_m = found.get(key, (0, 0.0, 0.0))
            found[key] = count + 1, sum_x_m + x_m, sum_y_m + y_m
        return found

    def _add(self, key: _Key, point: Point, pose: Pose, now_s: float) -> None:
        cell, x_m, y_m = self._cells.get(key), point.x_m, point.y_m
        if cell is None:
            if not self._is_known(point):
                self._cells[key] = _Cell(x_m, y_m, pose.x_m, pose.y_m, now_s)
            return
        cell.seen_s, cell.misses = now_s, 0
        cell.from_x_m, cell.from_y_m = pose.x_m, pose.y_m
        if cell.scans < AVERAGED_SCANS:
            cell.x_m += (x_m - cell.x_m) / (cell.scans + 1)
            cell.y_m += (y_m - cell.y_m) / (cell.scans + 1)
            cell.scans += 1
            self._circles = None
            self._changed.add(key)

    def _is_known(self, point: Point) -> bool:
        """Whether a return belongs to a known obstacle, or lies outside of a keep-in zone."""
        return any(
            each.clearance_m(point, point) < (0.0 if isinstance(each, KeepIn) else ASSOCIATION_M)
            for each in self._known
        )

    def _is_cleared(self, key: _Key, scan: LaserScan, pose: Pose, now_s: float) -> bool:
        """Whether a cell is to be removed, after a scan that does not show it."""
        cell = self._cells[key]
        dx_m, dy_m = cell.x_m - pose.x_m, cell.y_m - pose.y_m
        away_m = hypot(dx_m, dy_m)
        if away_m > FORGET_RANGE_M or now_s - cell.seen_s > FORGET_AFTER_S:
            return True
        behind_m = away_m * (1.0 + FREE_PER_M) + FREE_M
        if behind_m > scan.range_max_m:
            return False
        ray = _ray(scan, atan2(dy_m, dx_m) - pose.heading_rad)
        if ray is None:
            return False
        ranges_m, last = scan.ranges_m, len(scan.ranges_m) - 1
        rays_m = ranges_m[ray - 1], ranges_m[ray], ranges_m[ray + 1 if ray < last else 0]
        free = all(each > behind_m for each in rays_m)  # not free if one is NaN
        cell.misses = cell.misses + 1 if free else 0
        return cell.misses >= MIN_SCANS

    def _cover(self, keys: tuple[_Key, ...]) -> tuple[ScannedObstacle, ...]:
        """Return the circles of a cluster; the previous ones if none of its cells has changed."""
        known = self._covers.get(keys)
        if known is not None and self._changed.isdisjoint(keys):
            return known
        return tuple(_covered([self._cells[key] for key in keys]))

    def _clusters(self) -> Iterator[tuple[_Key, ...]]:
        """Yield groups of cells that are adjacent, also at a corner."""
        left = {key: None for key, each in self._cells.items() if each.scans >= MIN_SCANS}
        while left:
            cluster = [left.popitem()[0]]
            front = list(cluster)
            while front:
                column, row = front.pop()
                for i, j in _AROUND:
                    touching = (column + i, row + j)
                    if touching in left:
                        del left[touching]
                        cluster.append(touching)
                        front.append(touching)
            yield tuple(cluster)


def _between(before: Pose, after: Pose, part: float) -> Pose:
    turn_rad = wrap_rad(after.heading_rad - before.heading_rad)
    return replace(
        before,
        x_m=before.x_m + part * (after.x_m - before.x_m),
        y_m=before.y_m + part * (after.y_m - before.y_m),
        heading_rad=wrap_rad(before.heading_rad + part * turn_rad),
    )


_AROUND: Final = tuple((i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j)


def _covered(cells: list[_Cell]) -> Iterator[ScannedObstacle]:
    """Yield a circle that covers cells, or several in a row if they are too long for one."""
    count = len(cells)
    x_m, y_m = sum(each.x_m for each in cells) / count, sum(each.y_m for each in cells) / count
    xx = sum((each.x_m - x_m) ** 2 for each in cells)
    yy = sum((each.y_m - y_m) ** 2 for each in cells)
    xy = sum((each.x_m - x_m) * (each.y_m - y_m) for each in cells)
    along_rad = atan2(2 * xy, xx - yy) / 2
    cosine, sine = cos(along_rad), sin(along_rad)
    if sum(each.side(cosine, sine) for each in cells) > 0.0:
        cosine, sine = -cosine, -sine  # so that the laser is on the negative side
    along = [(each.x_m - x_m) * cosine + (each.y_m - y_m) * sine for each in cells]
    aside = [(each.y_m - y_m) * cosine - (each.x_m - x_m) * sine for each in cells]
    least_m, max_m = min(along), max(along)
    if max_m - least_m > 2 * MAX_CIRCLE_RADIUS_M:
        pieces = ceil((max_m - least_m) / (2 * MAX_CIRCLE_RADIUS_M))
        parts: list[list[_Cell]] = [[] for _ in range(pieces)]
        for cell, distance_m in zip(cells, along, strict=True):
            part = int((distance_m - least_m) / (max_m - least_m) * pieces)
            parts[min(pieces - 1, part)].append(cell)
        for each in filter(None, parts):
            yield from _covered(each)
        return
    middle_m = (least_m + max_m) / 2
    off_m, radius_m = _arc(list(zip([each - middle_m for each in along], aside, strict=True)))
    centre_x_m = x_m + middle_m * cosine - off_m * sine
    centre_y_m = y_m + middle_m * sine + off_m * cosine
    yield ScannedObstacle("seen", centre_x_m, centre_y_m, radius_m + CIRCLE_MARGIN_M)


def _arc(positions: list[tuple[float, float]]) -> tuple[float, float]:
    """Return the circle that covers points and protrudes least in front of them.

    Args:
        positions: points along a surface, from its middle, and behind it.

    Returns:
        Distance of its centre behind the surface, and its radius.
    """
    aside = [each for _, each in positions]
    half_m = max(abs(each) for each, _ in positions)
    deep_m, behind_m = max(aside) - min(aside), (min(aside) + max(aside)) / 2
    least_m = max(hypot(along, each - behind_m) for along, each in positions)
    max_m = FLAT_SURFACE_FACTOR * least_m
    fitted_m = (half_m**2 + deep_m**2) / (2 * deep_m) if deep_m > 0.0 else max_m
    radius_m = max(least_m, min(fitted_m, max_m))
    off_m = min(each + sqrt(radius_m**2 - along**2) for along, each in positions)
    return off_m, radius_m


def directions_of(scan: LaserScan) -> tuple[tuple[float, float], ...]:
    """Return cosine and sine of each ray, in the axes of base_link."""
    return _directions(scan.angle_min_rad, scan.angle_increment_rad, len(scan.ranges_m))


@lru_cache(maxsize=8)
def _directions(first_rad: float, step_rad: float, count: int) -> tuple[tuple[float, float], ...]:
    """Return the same by angles, cached: a laser has the same ones in each scan."""
    angles_rad = [first_rad + step_rad * index for index in range(count)]
    return tuple((cos(angle_rad), sin(angle_rad)) for angle_rad in angles_rad)


def _ray(scan: LaserScan, bearing_rad: float) -> int | None:
    """Return the index of the ray in a direction of base_link, or None."""
    step_rad, count = scan.angle_increment_rad, len(scan.ranges_m)
    from_first_rad = bearing_rad - scan.angle_min_rad
    from_first_rad = from_first_rad % (2 * pi) if step_rad > 0 else -from_first_rad % (2 * pi)
    ray = round(from_first_rad / abs(step_rad))
    if ray >= count:
        ray -= round(2 * pi / abs(step_rad))
    return ray if 0 <= ray < count else None
