"""`ObstacleConstraints` hold the points of an optimized trajectory off rocks and zones."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from math import hypot
from typing import Final

from executive.obstacles.detour import Detours, search_detour
from executive.obstacles.zones import KeepIn, KeepOut, Zones
from executive.values.geometry import Point

SLOTS: Final = 2
"""Rows of each point: one for each of the nearest obstacles."""
ROW: Final = 6
"""Number of figures of a row: x, y, curvature, the normal's x and y, distance."""
TRACKING_MARGIN_M: Final = 0.012
"""Clearance above the margin, for the tracking error of the rover. Chosen, not measured."""
MARGIN_ALLOWANCE_M: Final = 0.01
"""Part of the margin that a trajectory may use, as the rover may be off the previous one."""
CONSTRAINT_RANGE_M: Final = 1.0
"""Range beyond the required distance; obstacles farther away have no row."""
ESCAPE_RATIO: Final = 0.3
"""Clearance gained per distance travelled, if the rover begins too close to an obstacle."""
_NONE: Final = (0.0, 0.0, 0.0, 0.0, 0.0, -1.0)
_LENGTH_RESOLUTION_M: Final = 1e-6


@dataclass(frozen=True, slots=True)
class _Edge:
    """A side of a zone, or a rock as a side of no length.

    Attributes:
        radius_m: of a rock; 0 for a side.
    """

    start: Point
    end: Point
    radius_m: float = 0.0

    def is_outside(self, low: Point, high: Point, apart_m: float) -> bool:
        """Return whether it lies farther than `apart_m` from a rectangle."""
        reach_m = apart_m + self.radius_m
        return (
            max(self.start.x_m, self.end.x_m) < low.x_m - reach_m
            or min(self.start.x_m, self.end.x_m) > high.x_m + reach_m
            or max(self.start.y_m, self.end.y_m) < low.y_m - reach_m
            or min(self.start.y_m, self.end.y_m) > high.y_m + reach_m
        )


@dataclass(frozen=True, slots=True)
class _Proximity:
    """The distance of a point from an edge.

    Attributes:
        gap_m: distance to the edge; negative inside a forbidden area.
        at: the nearest point of the edge.
        away: a unit vector away from it.
    """

    edge: _Edge
    gap_m: float
    at: Point
    away: tuple[float, float]

    def row(self, clearance_m: float) -> tuple[float, ...]:
        """Return the row for a minimum distance: outside of a circle, or beyond a tangent."""
        x_m, y_m = self.at.x_m, self.at.y_m
        if not self.edge.radius_m:
            return x_m, y_m, 0.0, *self.away, clearance_m
        clearance_m += self.edge.radius_m
        return x_m, y_m, 0.5 / clearance_m, 0.0, 0.0, clearance_m / 2


class ObstacleConstraints:
    """All obstacles of the disc that encloses the rover.

    The rows of rocks are exact. Those of zone sides are infinite straight lines, which also forbid
    the area beside the side. They move with the guess of the next trajectory.

    Args:
        zones: the obstacles.
        radius_m: of the disc, about base_link.
    """

    def __init__(self, zones: Zones, radius_m: float) -> None:
        self.zones = zones
        self._radius_m = radius_m
        self._rocks = [
            _Edge(point, point, rock.radius_m)
            for rock in zones.rocks
            for point in (Point(rock.x_m, rock.y_m),)
        ]
        areas: list[KeepIn | KeepOut] = [*zones.keep_out, *zones.keep_in]
        self._areas = [(area, [_Edge(*edge) for edge in area.edges]) for area in areas]

    def __repr__(self) -> str:
        """Return its arguments as text: recordings compare problems by their texts."""
        return f"Obstacles({self.zones!r}, {self._radius_m!r})"

    @property
    def needed_m(self) -> float:
        """The minimum distance of the disc's centre from an obstacle."""
        return self._radius_m + self.zones.margin_m

    def is_free(self, path: Sequence[Point]) -> bool:
        """Return whether the disc may follow straight lines."""
        apart_m = max(self.zones.margin_m - MARGIN_ALLOWANCE_M, 0.0)
        return self.zones.encounter(path, self._radius_m, apart_m) is None

    def detour(self, start: Point, end: Point, pause: Callable[[], None]) -> tuple[Point, ...]:
        """Return the corners of a detour of straight lines; empty if a straight line is free.

        Also empty if no detour is found. `pause` is called between the slices of the search.
        """
        if self.is_free((start, end)):
            return ()
        clearance_m = self.needed_m + TRACKING_MARGIN_M
        search = partial(search_detour, start, end, self.zones, clearance_m)
        detours, begin = Detours(), partial(search, lambda point: self.is_free((start, point)))
        while (detour := detours.find((), begin)) is None:
            pause()
            detours.advance()
        return detour.corners if detour.reaches_goal else ()

    def rows(self, path: Sequence[Point]) -> list[float]:
        """Return the rows of each point of a path except the first, concatenated."""
        clearance_m = self.needed_m + TRACKING_MARGIN_M
        low = Point(min(each.x_m for each in path), min(each.y_m for each in path))
        high = Point(max(each.x_m for each in path), max(each.y_m for each in path))

        def in_range(edges: Sequence[_Edge]) -> list[_Edge]:
            return [
                each
                for each in edges
                if not each.is_outside(low, high, clearance_m + CONSTRAINT_RANGE_M)
            ]

        rocks = in_range(self._rocks)
        areas = [(area, in_range(edges)) for area, edges in self._areas]
        within_m = clearance_m + CONSTRAINT_RANGE_M
        begun_m = {near.edge: near.gap_m for near in _all_near(path[0], rocks, areas, within_m)}
        figures: list[float] = []
        walked_m, before = 0.0, path[0]
        for point in path[1:]:
            walked_m += before.distance_m(point)
            before = point
            nearest = _nearest(_all_near(point, rocks, areas, within_m))
            for near in nearest:
                leaving_m = begun_m.get(near.edge, clearance_m) + ESCAPE_RATIO * walked_m
                figures += near.row(min(clearance_m, leaving_m))
            figures += _NONE * (SLOTS - len(nearest))
        return figures


def _nearest(found: Iterator[_Proximity]) -> list[_Proximity]:
    """Return the nearest, without those at the same nearest point: two sides at a corner."""
    retained: list[_Proximity] = []
    for near in sorted(found, key=lambda each: each.gap_m):
        if len(retained) == SLOTS:
            break
        if all(near.at.distance_m(each.at) > _LENGTH_RESOLUTION_M for each in retained):
            retained.append(near)
    return retained


def _all_near(
    point: Point,
    rocks: Sequence[_Edge],
    areas: Sequence[tuple[KeepIn | KeepOut, Sequence[_Edge]]],
    within_m: float,
) -> Iterator[_Proximity]:
    """Yield the distances to edges; inside a forbidden area only that to the nearest edge."""
    for rock in rocks:
        if rock.start.distance_m(point) <= rock.radius_m + within_m:
            yield _near(point, rock)
    for area, edges in areas:
        if edges and area.contains(point) is isinstance(area, KeepOut):
            near = min((_near(point, edge) for edge in edges), key=lambda each: each.gap_m)
            inward = -near.away[0], -near.away[1]
            yield _Proximity(near.edge, -near.gap_m, near.at, inward)
        else:
            found = (_near(point, edge) for edge in edges)
            yield from (near for near in found if near.gap_m <= within_m)


def _near(point: Point, edge: _Edge) -> _Proximity:
    start, end = edge.start, edge.end
    dx_m, dy_m = end.x_m - start.x_m, end.y_m - start.y_m
    squared_m2 = dx_m * dx_m + dy_m * dy_m
    part = 0.0
    if squared_m2:
        along_m2 = (point.x_m - start.x_m) * dx_m + (point.y_m - start.y_m) * dy_m
        part = max(0.0, min(1.0, along_m2 / squared_m2))
    at = Point(start.x_m + part * dx_m, start.y_m + part * dy_m)
    x_m, y_m = point.x_m - at.x_m, point.y_m - at.y_m
    apart_m = hypot(x_m, y_m)
    if apart_m < _LENGTH_RESOLUTION_M:
        x_m, y_m = -dy_m, dx_m
    length_m = hypot(x_m, y_m) or 1.0
    return _Proximity(edge, apart_m - edge.radius_m, at, (x_m / length_m, y_m / length_m))
