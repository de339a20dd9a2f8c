"""Where a rover may drive: keep-in and keep-out zones and known rocks, in the odometry frame.

Pure geometry. The rover counts as the disc about base_link in which its footprint turns, so that
its heading does not matter.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from math import hypot, inf, isfinite
from typing import Final, Protocol

from executive.values.geometry import Point

FARTHEST_M: Final = 10_000.0
MAX_MARGIN_M: Final = 100.0
FEWEST_CORNERS: Final = 3
MOST_CORNERS: Final = 100
FINEST_M: Final = 0.01
"""How exactly it is told where a path comes too near."""
LEAVING_STEP_M: Final = 0.05
LEAVING_M: Final = 20.0
"""On so much of a path a rover that stands too near may leave, and must not come nearer."""


@dataclass(frozen=True, slots=True)
class Footprint:
    """What the rover covers of the ground: a rectangle about base_link, along its heading."""

    length_m: float
    width_m: float

    def __post_init__(self) -> None:
        """Raise ValueError where a rover has no such size."""
        for name, size_m in (("length_m", self.length_m), ("width_m", self.width_m)):
            if not 0.01 <= size_m <= 20:
                raise ValueError(f"{name} {size_m:g} is not in 0.01 .. 20")

    @property
    def radius_m(self) -> float:
        """Radius of the disc in which it turns."""
        return hypot(self.length_m, self.width_m) / 2


class Obstacle(Protocol):
    """Something to which the rover keeps a distance."""

    @property
    def title(self) -> str:
        """What it is, with its name, for people."""

    def clearance_m(self, start: Point, end: Point) -> float:
        """Return how near a straight line comes to it, negative for a point that is in it.

        For a line that is neither a point nor wholly outside, any figure that is not above zero.
        """


@dataclass(frozen=True, slots=True)
class _Area:
    """A polygon, whose corners are in order; the first and the last are joined."""

    name: str
    corners_m: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        """Raise ValueError where it is no polygon."""
        check_name(self.name)
        if not FEWEST_CORNERS <= len(self.corners_m) <= MOST_CORNERS:
            raise ValueError(
                f"zone {self.name!r} has {len(self.corners_m)} corners, not"
                f" {FEWEST_CORNERS} .. {MOST_CORNERS}"
            )
        for corner in self.corners_m:
            if len(corner) != 2 or not _is_place(*corner):
                raise ValueError(
                    f"zone {self.name!r}: {list(corner)} is no corner, [x, y] within"
                    f" {FARTHEST_M:g} m"
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
                    f"zone {self.name!r} crosses itself: the side from {_shown(one_edge[0])} to"
                    f" {_shown(one_edge[1])} meets that from {_shown(other_edge[0])} to"
                    f" {_shown(other_edge[1])}; give its corners in order"
                )

    @property
    def edges(self) -> tuple[tuple[Point, Point], ...]:
        """The sides."""
        places = [Point(*corner) for corner in self.corners_m]
        return tuple(pairwise([*places, places[0]]))

    def has(self, place: Point) -> bool:
        """Return whether a place is within it; on its edge, either."""
        inside = False
        for start, end in self.edges:
            if (start.y_m > place.y_m) != (end.y_m > place.y_m):
                part = (place.y_m - start.y_m) / (end.y_m - start.y_m)
                if place.x_m < start.x_m + part * (end.x_m - start.x_m):
                    inside = not inside
        return inside

    def _edge_m(self, start: Point, end: Point) -> float:
        """Return how near a straight line comes to its edge."""
        return min(_apart_m(start, end, *edge) for edge in self.edges)


@dataclass(frozen=True, slots=True)
class KeepOut(_Area):
    """A zone that the rover must not touch."""

    @property
    def title(self) -> str:
        """What it is, with its name, for people."""
        return f"keep-out zone {self.name!r}"

    def clearance_m(self, start: Point, end: Point) -> float:
        """Return how far a straight line stays outside."""
        edge_m = self._edge_m(start, end)
        return -edge_m if self.has(start) else edge_m


@dataclass(frozen=True, slots=True)
class KeepIn(_Area):
    """A zone that the rover must not leave."""

    @property
    def title(self) -> str:
        """What it is, with its name, for people."""
        return f"the edge of keep-in zone {self.name!r}"

    def clearance_m(self, start: Point, end: Point) -> float:
        """Return how far a straight line stays inside."""
        edge_m = self._edge_m(start, end)
        return edge_m if self.has(start) else -edge_m


@dataclass(frozen=True, slots=True)
class KnownRock:
    """A rock, or what else is round."""

    name: str
    x_m: float
    y_m: float
    radius_m: float

    def __post_init__(self) -> None:
        """Raise ValueError where it is nowhere or has no size."""
        check_name(self.name)
        if not _is_place(self.x_m, self.y_m):
            raise ValueError(f"rock {self.name!r} does not lie within {FARTHEST_M:g} m")
        if not 0 < self.radius_m <= FARTHEST_M:
            raise ValueError(f"rock {self.name!r}: radius_m {self.radius_m:g} is not above 0")

    @property
    def title(self) -> str:
        """What it is, with its name, for people."""
        return f"rock {self.name!r}"

    def clearance_m(self, start: Point, end: Point) -> float:
        """Return how far a straight line stays away."""
        return _to_line_m(Point(self.x_m, self.y_m), start, end) - self.radius_m


@dataclass(frozen=True, slots=True)
class ScannedObstacle(KnownRock):
    """A part of what the rover sees itself, and was not told of; the name tells nothing."""

    @property
    def title(self) -> str:
        """Where it is, for people."""
        return f"something seen at ({self.x_m:.2f}, {self.y_m:.2f})"


@dataclass(frozen=True, slots=True)
class ClearanceViolation:
    """Where a path comes too near to something.

    Attributes:
        obstacle: what it is.
        gap_m: what is left at the nearest between it and the rover; not above 0 if they meet.
        way_m: how far the rover can go until it is too near.
    """

    obstacle: Obstacle
    gap_m: float
    way_m: float


@dataclass(frozen=True, slots=True)
class Zones:
    """All that is known of where the asset may drive; names are used once, but of what is seen.

    Attributes:
        keep_in: the rover stays in each of them.
        margin_m: what is left at least between a planned motion and any of these.
    """

    keep_in: tuple[KeepIn, ...] = ()
    keep_out: tuple[KeepOut, ...] = ()
    rocks: tuple[KnownRock, ...] = ()
    margin_m: float = 0.1

    def __post_init__(self) -> None:
        """Raise ValueError where a figure or a name cannot be."""
        if not 0 <= self.margin_m <= MAX_MARGIN_M:
            raise ValueError(f"margin_m {self.margin_m:g} is not in 0 .. {MAX_MARGIN_M:g}")
        named = (each for each in self if not isinstance(each, ScannedObstacle))
        names = [each.name for each in named]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise ValueError(f"{twice!r} is the name of two zones or rocks")

    def __iter__(self) -> Iterator[KeepIn | KeepOut | KnownRock]:
        yield from self.keep_in
        yield from self.keep_out
        yield from self.rocks

    @property
    def seen(self) -> tuple[ScannedObstacle, ...]:
        """Those that the rover sees itself."""
        return tuple(each for each in self.rocks if isinstance(each, ScannedObstacle))

    @property
    def told(self) -> "Zones":
        """Those that it was told of."""
        rocks = tuple(each for each in self.rocks if not isinstance(each, ScannedObstacle))
        return self if len(rocks) == len(self.rocks) else replace(self, rocks=rocks)

    @property
    def any(self) -> bool:
        """Whether there are any."""
        return bool(self.keep_in or self.keep_out or self.rocks)

    def encounter(
        self, path: Sequence[Point], radius_m: float, apart_m: float
    ) -> ClearanceViolation | None:
        """Return where a disc that follows straight lines first comes too near to something.

        A disc that is too near at the beginning may go away, but not come nearer.

        Args:
            path: from where to where its middle goes.
            radius_m: of the disc.
            apart_m: what must be left between it and all obstacles.
        """
        first: ClearanceViolation | None = None
        middle, reach_m = _disc_of(path)
        for obstacle in self:
            if obstacle.clearance_m(middle, middle) > reach_m + radius_m + apart_m:
                continue
            found = _first_on(path, obstacle, radius_m + apart_m)
            if found is not None and (first is None or found[0] < first.way_m):
                way_m, clearance_m = found
                first = ClearanceViolation(obstacle, clearance_m - radius_m, way_m)
        return first


def check_name(name: str) -> None:
    """Do nothing where a zone or a rock can be told by a name.

    Raises:
        ValueError: it cannot.
    """
    if not (0 < len(name) <= 80 and name.strip() and name.isprintable()):
        raise ValueError(f"{name[:80]!r} is no name: 1 to 80 printable characters")


def _disc_of(path: Sequence[Point]) -> tuple[Point, float]:
    """Return the middle and the radius of a disc that a path lies within."""
    xs_m, ys_m = [each.x_m for each in path], [each.y_m for each in path]
    low, high = Point(min(xs_m), min(ys_m)), Point(max(xs_m), max(ys_m))
    return _along(low, high, low.distance_m(high) / 2), low.distance_m(high) / 2


def _first_on(
    path: Sequence[Point], obstacle: Obstacle, needed_m: float
) -> tuple[float, float] | None:
    """Return after which way a path first is too near to an obstacle, and how near it comes."""
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
            left_m = _way_out_m(start, end, obstacle, needed_m, (walked_m, now_m - FINEST_M))
            if left_m is None:
                return walked_m, obstacle.clearance_m(start, end)
            leaving = left_m > length_m
            begin_m = left_m
        if begin_m <= length_m:
            begin = _along(start, end, begin_m)
            nearest_m = obstacle.clearance_m(begin, end)
            if nearest_m < needed_m - FINEST_M / 2:
                way_m = begin_m + _until_m(begin, end, obstacle, needed_m)
                return walked_m + way_m, nearest_m
        walked_m += length_m
    return None


def _way_out_m(
    start: Point, end: Point, obstacle: Obstacle, needed_m: float, bounds: tuple[float, float]
) -> float | None:
    """Return after which way of a line it is far enough from an obstacle that it begins too near.

    More than the length of the line, if that is nowhere on it; None, if it comes nearer, or is
    still too near after `LEAVING_M`.

    Args:
        start: where the line begins.
        end: where it ends.
        obstacle: to what the distance is.
        needed_m: how far is far enough.
        bounds: the way before the line, and how near it may come.
    """
    length_m = start.distance_m(end)
    before_m, least_m = bounds
    count = int(length_m / LEAVING_STEP_M) + 1
    for step in range(count + 1):
        way_m = min(step * LEAVING_STEP_M, length_m)
        place = _along(start, end, way_m)
        clearance_m = obstacle.clearance_m(place, place)
        if clearance_m >= needed_m:
            return way_m
        if clearance_m < least_m or before_m + way_m > LEAVING_M:
            return None
    return length_m + LEAVING_STEP_M


def _until_m(start: Point, end: Point, obstacle: Obstacle, needed_m: float) -> float:
    """Return after which way of a line it is too near, by steps as long as there is room."""
    length_m, way_m = start.distance_m(end), 0.0
    while way_m < length_m:
        place = _along(start, end, way_m)
        room_m = obstacle.clearance_m(place, place) - needed_m
        if room_m < FINEST_M:
            break
        way_m += max(room_m, FINEST_M)
    return min(way_m, length_m)


def _along(start: Point, end: Point, way_m: float) -> Point:
    length_m = start.distance_m(end)
    part = way_m / length_m if length_m else 0.0
    return Point(start.x_m + part * (end.x_m - start.x_m), start.y_m + part * (end.y_m - start.y_m))


def _is_place(x_m: float, y_m: float) -> bool:
    return isfinite(x_m) and isfinite(y_m) and max(abs(x_m), abs(y_m)) <= FARTHEST_M


def _shown(place: Point) -> str:
    return f"[{place.x_m:g}, {place.y_m:g}]"


def _folds(one: tuple[Point, Point], other: tuple[Point, Point]) -> bool:
    """Return whether two sides that share a corner lie on each other."""
    (a, b), (c, d) = one, other
    shared, far, near = (b, a, d) if b == c else (a, b, c)
    ahead_m2 = (far.x_m - shared.x_m) * (near.x_m - shared.x_m) + (far.y_m - shared.y_m) * (
        near.y_m - shared.y_m
    )
    return _turn(shared, far, near) == 0.0 and ahead_m2 > 0.0


def _turn(a: Point, b: Point, c: Point) -> float:
    """Return twice the area of a triangle, positive if it turns counter-clockwise."""
    return (b.x_m - a.x_m) * (c.y_m - a.y_m) - (b.y_m - a.y_m) * (c.x_m - a.x_m)


def _to_line_m(place: Point, start: Point, end: Point) -> float:
    """Return the distance of a place from a straight line between two others."""
    dx_m, dy_m = end.x_m - start.x_m, end.y_m - start.y_m
    squared_m2 = dx_m * dx_m + dy_m * dy_m
    part = 0.0
    if squared_m2 > 0.0:
        along_m2 = (place.x_m - start.x_m) * dx_m + (place.y_m - start.y_m) * dy_m
        part = max(0.0, min(1.0, along_m2 / squared_m2))
    return hypot(start.x_m + part * dx_m - place.x_m, start.y_m + part * dy_m - place.y_m)


def _apart_m(a: Point, b: Point, c: Point, d: Point) -> float:
    """Return the distance between the straight lines from a to b and from c to d."""
    if (_turn(a, b, c) > 0) != (_turn(a, b, d) > 0) and (_turn(c, d, a) > 0) != (
        _turn(c, d, b) > 0
    ):
        return 0.0
    return min(_to_line_m(a, c, d), _to_line_m(b, c, d), _to_line_m(c, a, b), _to_line_m(d, a, b))
