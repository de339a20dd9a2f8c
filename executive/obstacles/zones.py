"""`Zones`: keep-in and keep-out zones and known rocks in the odometry frame, and clearance to them.

Pure geometry. The rover is the disc about base_link that contains its footprint at any heading.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations, pairwise
from math import hypot, inf, isfinite
from typing import Final, Protocol

from executive.values.geometry import Point

MAX_COORDINATE_M: Final = 10_000.0
MAX_MARGIN_M: Final = 100.0
MIN_CORNERS: Final = 3
MAX_CORNERS: Final = 100
DISTANCE_RESOLUTION_M: Final = 0.01
"""Resolution of the distance along a path to a violation of the clearance."""
ROUNDING_M: Final = 1e-6
"""Far above the rounding of a distance between positions within `MAX_COORDINATE_M`."""
LEAVING_STEP_M: Final = 0.05
LEAVING_M: Final = 20.0
"""Maximum length of a path for a rover that began too close to move away."""


@dataclass(frozen=True, slots=True)
class Footprint:
    """Outline of the rover on the ground: a rectangle about base_link, along its heading."""

    length_m: float
    width_m: float

    def __post_init__(self) -> None:
        """Raise ValueError unless both sizes are in 0.01 .. 20 m."""
        for name, size_m in (("length_m", self.length_m), ("width_m", self.width_m)):
            if not 0.01 <= size_m <= 20:
                raise ValueError(f"{name} {size_m:g} is not in 0.01 .. 20")

    @property
    def radius_m(self) -> float:
        """Radius of the disc that contains it at any heading."""
        return hypot(self.length_m, self.width_m) / 2


class Obstacle(Protocol):
    """An object that the rover avoids."""

    @property
    def label(self) -> str:
        """Its kind and name, for display."""

    def clearance_m(self, start: Point, end: Point) -> float:
        """Return the distance of a straight line from it, negative for a point inside.

        For a line that is neither a point nor wholly outside, any figure that is not above zero.
        """


@dataclass(frozen=True, slots=True)
class _Area:
    """A polygon of ordered corners; the last side joins the last and the first corner."""

    name: str
    corners_m: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        """Raise ValueError unless it is a simple polygon."""
        check_name(self.name)
        if not MIN_CORNERS <= len(self.corners_m) <= MAX_CORNERS:
            raise ValueError(
                f"zone {self.name!r} has {len(self.corners_m)} corners, not"
                f" {MIN_CORNERS} .. {MAX_CORNERS}"
            )
        for corner in self.corners_m:
            if len(corner) != 2 or not _is_position(*corner):
                raise ValueError(
                    f"zone {self.name!r}: {list(corner)} is not a corner [x, y] within"
                    f" {MAX_COORDINATE_M:g} m"
                )
        self._check_edges()

    def _check_edges(self) -> None:
        edges = self.edges
        for (start, end), first in zip(edges, self.corners_m, strict=True):
            if start == end:
                raise ValueError(f"zone {self.name!r} has the corner {list(first)} twice in a row")
        for (one, one_edge), (other, other_edge) in combinations(enumerate(edges), 2):
            neighbours = other - one in (1, len(edges) - 1)
            if neighbours and not _folds(one_edge, other_edge):
                continue
            if neighbours or _apart_m(*one_edge, *other_edge) == 0.0:
                raise ValueError(
                    f"zone {self.name!r} intersects itself: the side from {_shown(one_edge[0])} to"
                    f" {_shown(one_edge[1])} meets the side from {_shown(other_edge[0])} to"
                    f" {_shown(other_edge[1])}; give its corners in order"
                )

    @property
    def edges(self) -> tuple[tuple[Point, Point], ...]:
        """The sides."""
        return _edges_of(self.corners_m)

    def contains(self, point: Point) -> bool:
        """Return whether a point is inside; on an edge it may be either."""
        inside = False
        for start, end in self.edges:
            if (start.y_m > point.y_m) != (end.y_m > point.y_m):
                part = (point.y_m - start.y_m) / (end.y_m - start.y_m)
                if point.x_m < start.x_m + part * (end.x_m - start.x_m):
                    inside = not inside
        return inside

    def _edge_m(self, start: Point, end: Point) -> float:
        """Return the distance of a straight line from the nearest edge."""
        return min(_apart_m(start, end, *edge) for edge in self.edges)


@dataclass(frozen=True, slots=True)
class KeepOut(_Area):
    """A zone that the rover must not touch."""

    @property
    def label(self) -> str:
        """Its kind and name, for display."""
        return f"keep-out zone {self.name!r}"

    def clearance_m(self, start: Point, end: Point) -> float:
        """Return the distance of a straight line outside of it."""
        edge_m = self._edge_m(start, end)
        return -edge_m if self.contains(start) else edge_m


@dataclass(frozen=True, slots=True)
class KeepIn(_Area):
    """A zone that the rover must not leave."""

    @property
    def label(self) -> str:
        """Its kind and name, for display."""
        return f"the edge of keep-in zone {self.name!r}"

    def clearance_m(self, start: Point, end: Point) -> float:
        """Return the distance of a straight line inside of it from its edge."""
        edge_m = self._edge_m(start, end)
        return edge_m if self.contains(start) else -edge_m


@dataclass(frozen=True, slots=True)
class KnownRock:
    """A rock or another round obstacle."""

    name: str
    x_m: float
    y_m: float
    radius_m: float

    def __post_init__(self) -> None:
        """Raise ValueError unless its position and radius are in range."""
        check_name(self.name)
        if not _is_position(self.x_m, self.y_m):
            raise ValueError(f"rock {self.name!r} is not within {MAX_COORDINATE_M:g} m")
        if not 0 < self.radius_m <= MAX_COORDINATE_M:
            raise ValueError(f"rock {self.name!r}: radius_m {self.radius_m:g} is not above 0")

    @property
    def label(self) -> str:
        """Its kind and name, for display."""
        return f"rock {self.name!r}"

    def clearance_m(self, start: Point, end: Point) -> float:
        """Return the distance of a straight line from its surface."""
        return _to_line_m(Point(self.x_m, self.y_m), start, end) - self.radius_m


@dataclass(frozen=True, slots=True)
class ScannedObstacle(KnownRock):
    """A part of an obstacle that the laser detected; its name is not unique."""

    @property
    def label(self) -> str:
        """Its position, for display."""
        return f"scanned obstacle at ({self.x_m:.2f}, {self.y_m:.2f})"


@dataclass(frozen=True, slots=True)
class ClearanceViolation:
    """The first point of a path with too small a clearance.

    Attributes:
        obstacle: the obstacle.
        gap_m: minimum clearance of the rover; not above 0 in a collision.
        distance_m: distance along the path up to that point.
    """

    obstacle: Obstacle
    gap_m: float
    distance_m: float


@dataclass(frozen=True, slots=True)
class Zones:
    """All obstacles of the asset. Names are unique, except those of scanned obstacles.

    Attributes:
        keep_in: the rover stays inside all of them.
        margin_m: minimum clearance of a planned motion from each obstacle.
    """

    keep_in: tuple[KeepIn, ...] = ()
    keep_out: tuple[KeepOut, ...] = ()
    rocks: tuple[KnownRock, ...] = ()
    margin_m: float = 0.1

    def __post_init__(self) -> None:
        """Raise ValueError unless all figures are in range and the names unique."""
        if not 0 <= self.margin_m <= MAX_MARGIN_M:
            raise ValueError(f"margin_m {self.margin_m:g} is not in 0 .. {MAX_MARGIN_M:g}")
        named = (each for each in self if not isinstance(each, ScannedObstacle))
        names = [each.name for each in named]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise ValueError(f"{twice!r} names two zones or rocks")

    def __iter__(self) -> Iterator[KeepIn | KeepOut | KnownRock]:
        yield from self.keep_in
        yield from self.keep_out
        yield from self.rocks

    @property
    def scanned(self) -> tuple[ScannedObstacle, ...]:
        """The scanned obstacles."""
        return tuple(each for each in self.rocks if isinstance(each, ScannedObstacle))

    @property
    def known(self) -> "Zones":
        """The known obstacles, from settings."""
        rocks = tuple(each for each in self.rocks if not isinstance(each, ScannedObstacle))
        return self if len(rocks) == len(self.rocks) else replace(self, rocks=rocks)

    @property
    def not_empty(self) -> bool:
        """Whether there are any."""
        return bool(self.keep_in or self.keep_out or self.rocks)

    def encounter(
        self, path: Sequence[Point], radius_m: float, apart_m: float
    ) -> ClearanceViolation | None:
        """Return where a disc on straight lines first violates a clearance, or None.

        A disc that is too close at the beginning may move away, but not closer.

        Args:
            path: of the disc's centre.
            radius_m: of the disc.
            apart_m: required clearance from all obstacles.
        """
        first: ClearanceViolation | None = None
        (middle, reach_m), needed_m = _disc_of(path), radius_m + apart_m
        for obstacle in self:
            if has_clearance(obstacle, middle, middle, reach_m + needed_m):
                continue
            if all(_is_distant(obstacle, *line, needed_m) for line in pairwise(path)):
                continue
            found = _first_on(path, obstacle, needed_m)
            if found is not None and (first is None or found[0] < first.distance_m):
                distance_m, clearance_m = found
                first = ClearanceViolation(obstacle, clearance_m - radius_m, distance_m)
        return first


def check_name(name: str) -> None:
    """Raise ValueError unless a name of a zone or a rock is valid.

    Raises:
        ValueError: it is empty, blank, too long or not printable.
    """
    if not (0 < len(name) <= 80 and name.strip() and name.isprintable()):
        raise ValueError(f"{name[:80]!r} is not a valid name: 1 to 80 printable characters")


def has_clearance(obstacle: Obstacle, start: Point, end: Point, needed_m: float) -> bool:
    """Return whether a straight line has at least this clearance.

    A distant keep-out zone is passed over by the disc around it, without its sides.
    """
    if _is_distant(obstacle, start, end, needed_m):
        return True
    return obstacle.clearance_m(start, end) >= needed_m


def _is_distant(obstacle: Obstacle, start: Point, end: Point, needed_m: float) -> bool:
    """Return whether the disc around an obstacle has a clearance; False without a disc."""
    if not isinstance(obstacle, KeepOut):
        return False
    middle, radius_m = _disc_around(obstacle.corners_m)
    return _to_line_m(middle, start, end) - radius_m > needed_m + ROUNDING_M


@lru_cache(maxsize=256)
def _edges_of(corners_m: tuple[tuple[float, ...], ...]) -> tuple[tuple[Point, Point], ...]:
    corners = [Point(*corner) for corner in corners_m]
    return tuple(pairwise([*corners, corners[0]]))


@lru_cache(maxsize=256)
def _disc_around(corners_m: tuple[tuple[float, ...], ...]) -> tuple[Point, float]:
    return _disc_of([Point(*corner) for corner in corners_m])


def _disc_of(path: Sequence[Point]) -> tuple[Point, float]:
    """Return centre and radius of a disc that contains a path."""
    xs_m, ys_m = [each.x_m for each in path], [each.y_m for each in path]
    low, high = Point(min(xs_m), min(ys_m)), Point(max(xs_m), max(ys_m))
    return _along(low, high, low.distance_m(high) / 2), low.distance_m(high) / 2


def _first_on(
    path: Sequence[Point], obstacle: Obstacle, needed_m: float
) -> tuple[float, float] | None:
    """Return the distance along a path to its first clearance violation, and that clearance."""
    nearest_m = inf
    now_m = obstacle.clearance_m(path[0], path[0])
    leaving = now_m < needed_m
    walked_m, spare_m = 0.0, now_m - needed_m
    for start, end in pairwise(path):
        length_m = start.distance_m(end)
        begin_m = 0.0
        if not leaving:
            if spare_m <= 0.0:
                spare_m = obstacle.clearance_m(start, start) - needed_m
            spare_m -= length_m
            if spare_m > 0.0:
                walked_m += length_m
                continue
        if leaving:
            left_m = _exit_distance_m(
                start, end, obstacle, needed_m, (walked_m, now_m - DISTANCE_RESOLUTION_M)
            )
            if left_m is None:
                return walked_m, obstacle.clearance_m(start, end)
            leaving = left_m > length_m
            begin_m = left_m
        if begin_m <= length_m:
            begin = _along(start, end, begin_m)
            nearest_m = obstacle.clearance_m(begin, end)
            if nearest_m < needed_m - DISTANCE_RESOLUTION_M / 2:
                distance_m = begin_m + _until_m(begin, end, obstacle, needed_m)
                return walked_m + distance_m, nearest_m
        walked_m += length_m
    return None


def _exit_distance_m(
    start: Point, end: Point, obstacle: Obstacle, needed_m: float, bounds: tuple[float, float]
) -> float | None:
    """Return the distance along a line after which it is far enough from an obstacle.

    More than the length of the line, if nowhere on it. None if it approaches the obstacle, or is
    still too close after `LEAVING_M`.

    Args:
        start: start of the line, too close to the obstacle.
        end: its end.
        obstacle: the obstacle.
        needed_m: required distance.
        bounds: the distance before the line, and the minimum clearance on it.
    """
    length_m = start.distance_m(end)
    before_m, least_m = bounds
    count = int(length_m / LEAVING_STEP_M) + 1
    for step in range(count + 1):
        distance_m = min(step * LEAVING_STEP_M, length_m)
        point = _along(start, end, distance_m)
        clearance_m = obstacle.clearance_m(point, point)
        if clearance_m >= needed_m:
            return distance_m
        if clearance_m < least_m or before_m + distance_m > LEAVING_M:
            return None
    return length_m + LEAVING_STEP_M


def _until_m(start: Point, end: Point, obstacle: Obstacle, needed_m: float) -> float:
    """Return the distance along a line until it is too close, in steps of the free distance."""
    length_m, distance_m = start.distance_m(end), 0.0
    while distance_m < length_m:
        point = _along(start, end, distance_m)
        space_m = obstacle.clearance_m(point, point) - needed_m
        if space_m < DISTANCE_RESOLUTION_M:
            break
        distance_m += max(space_m, DISTANCE_RESOLUTION_M)
    return min(distance_m, length_m)


def _along(start: Point, end: Point, distance_m: float) -> Point:
    length_m = start.distance_m(end)
    part = distance_m / length_m if length_m else 0.0
    return Point(start.x_m + part * (end.x_m - start.x_m), start.y_m + part * (end.y_m - start.y_m))


def _is_position(x_m: float, y_m: float) -> bool:
    return isfinite(x_m) and isfinite(y_m) and max(abs(x_m), abs(y_m)) <= MAX_COORDINATE_M


def _shown(point: Point) -> str:
    return f"[{point.x_m:g}, {point.y_m:g}]"


def _folds(one: tuple[Point, Point], other: tuple[Point, Point]) -> bool:
    """Return whether two sides with a common corner overlap."""
    (a, b), (c, d) = one, other
    shared, far, near = (b, a, d) if b == c else (a, b, c)
    ahead_m2 = (far.x_m - shared.x_m) * (near.x_m - shared.x_m) + (far.y_m - shared.y_m) * (
        near.y_m - shared.y_m
    )
    return _turn(shared, far, near) == 0.0 and ahead_m2 > 0.0


def _turn(a: Point, b: Point, c: Point) -> float:
    """Return twice the area of a triangle, positive if it turns counter-clockwise."""
    return (b.x_m - a.x_m) * (c.y_m - a.y_m) - (b.y_m - a.y_m) * (c.x_m - a.x_m)


def _to_line_m(point: Point, start: Point, end: Point) -> float:
    """Return the distance of a point from a straight line between two others."""
    dx_m, dy_m = end.x_m - start.x_m, end.y_m - start.y_m
    squared_m2 = dx_m * dx_m + dy_m * dy_m
    part = 0.0
    if squared_m2 > 0.0:
        along_m2 = (point.x_m - start.x_m) * dx_m + (point.y_m - start.y_m) * dy_m
        part = max(0.0, min(1.0, along_m2 / squared_m2))
    return hypot(start.x_m + part * dx_m - point.x_m, start.y_m + part * dy_m - point.y_m)


def _apart_m(a: Point, b: Point, c: Point, d: Point) -> float:
    """Return the distance between the straight lines from a to b and from c to d."""
    if (_turn(a, b, c) > 0) != (_turn(a, b, d) > 0) and (_turn(c, d, a) > 0) != (
        _turn(c, d, b) > 0
    ):
        return 0.0
    return min(_to_line_m(a, c, d), _to_line_m(b, c, d), _to_line_m(c, a, b), _to_line_m(d, a, b))
