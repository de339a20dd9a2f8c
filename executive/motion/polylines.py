"""`initial_guesses` of a trajectory: straight lines, with turns on the spot between them.

Lines are arcs for a base that cannot turn on the spot, see `executive.motion.minimum_time`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from math import ceil, copysign, cos, pi, sin
from typing import Final

from executive.motion.locomotion import Bounds, duration_s
from executive.values.geometry import ARC_RESOLUTION_RAD, Point, Pose, arc_end, wrap_rad

OFFSETS_M: Final = (0.3, 0.8)
"""Lengths of a first or last line, along the start or end heading. Chosen, not measured."""
TRY_BOTH_TURNS_RAD: Final = 2.2
"""Turn angle above which the opposite direction is tried, too."""
MIN_SEGMENT_M: Final = 1e-3


@dataclass(frozen=True, slots=True)
class TurnSegment:
    """A turn on the spot."""

    point: Point
    from_rad: float
    by_rad: float


@dataclass(frozen=True, slots=True)
class LineSegment:
    """A straight line, or an arc; its length is negative if driven backward."""

    point: Point
    heading_rad: float
    by_m: float
    curvature_radpm: float = 0.0

    def at(self, distance_m: float) -> tuple[Point, float]:
        """Return the position and the heading, not wrapped, after a signed distance."""
        turn_rad = self.curvature_radpm * distance_m
        start = Pose(self.point.x_m, self.point.y_m, heading_rad=self.heading_rad)
        return arc_end(start, distance_m, turn_rad).point, self.heading_rad + turn_rad


@dataclass(frozen=True, slots=True)
class Polyline:
    """Turns and lines, each from rest to rest, and their total duration.

    Attributes:
        end_rad: the heading at its end, not wrapped.
    """

    parts: tuple[TurnSegment | LineSegment, ...]
    duration_s: float
    end_rad: float

    @property
    def corners(self) -> list[Point]:
        """The start points of its parts, points of its arcs, and its end."""
        points = [self.parts[0].point]
        for part in self.parts:
            if isinstance(part, LineSegment):
                pieces = ceil(abs(part.curvature_radpm * part.by_m) / ARC_RESOLUTION_RAD) or 1
                points += [part.at(part.by_m * k / pieces)[0] for k in range(1, pieces + 1)]
        return points

    @property
    def direction(self) -> float:
        """The length of its first line: negative if driven backward; 0 without a line."""
        return next((part.by_m for part in self.parts if isinstance(part, LineSegment)), 0.0)

    def at(self, time_s: float, travel: Bounds, rotate: Bounds) -> tuple[float, ...]:
        """Return x, y, heading, speed and rotation at a time after its start."""
        for index, part in enumerate(self.parts):
            takes_s = _takes_s(part, travel, rotate)
            if time_s <= takes_s or index == len(self.parts) - 1:
                break
            time_s -= takes_s
        match part:
            case TurnSegment(point, from_rad, by_rad):
                distance, speed = _along(by_rad, rotate, time_s, takes_s)
                return point.x_m, point.y_m, from_rad + distance, 0.0, speed
            case LineSegment(by_m=by_m, curvature_radpm=curvature):
                bounds = _line_bounds(part, travel, rotate)
                distance, speed = _along(by_m, bounds, time_s, takes_s)
                point, heading_rad = part.at(distance)
                return point.x_m, point.y_m, heading_rad, speed, speed * curvature


def initial_guesses(
    start: Point,
    start_rad: float,
    end: Point,
    end_rad: float | None,
    travel: Bounds,
    rotate: Bounds,
    around: Sequence[Point] = (),
) -> list[Polyline]:
    """Return the polylines from one pose to another, the fastest first.

    Without `end_rad` the end heading is free. All pass through the points `around`.
    """
    found = [
        _join(points, signs, other, start_rad, end_rad, travel, rotate)
        for points, signs in _corner_sequences(start, start_rad, end, end_rad, around)
        for other in (False, True)
    ]
    return sorted((each for each in found if each is not None), key=lambda each: each.duration_s)


def _corner_sequences(
    start: Point, start_rad: float, end: Point, end_rad: float | None, around: Sequence[Point]
) -> Iterator[tuple[list[Point], list[float]]]:
    """Yield corners, and 1 or -1 for each line between them: forward or backward."""
    offsets = [sign * offset_m for offset_m in OFFSETS_M for sign in (1.0, -1.0)]
    lasts_m = [0.0] if end_rad is None else [0.0, *offsets]
    for first_m, last_m, sign in product([0.0, *offsets], lasts_m, (1.0, -1.0)):
        points, signs = [start], []
        if first_m:
            points.append(_beside(start, start_rad, first_m))
            signs.append(copysign(1.0, first_m))
        points += around
        signs += [sign] * (len(around) + 1)
        if last_m and end_rad is not None:
            points.append(_beside(end, end_rad, last_m))
            signs.append(copysign(1.0, -last_m))
        yield [*points, end], signs


def _join(
    points: Sequence[Point],
    signs: Sequence[float],
    other: bool,
    start_rad: float,
    end_rad: float | None,
    travel: Bounds,
    rotate: Bounds,
) -> Polyline | None:
    """Return the polyline of corners; None if `other` is set and no turn is large enough."""
    parts: list[TurnSegment | LineSegment] = []
    heading_rad, differs = start_rad, False

    def turn(point: Point, to_rad: float) -> None:
        nonlocal heading_rad, differs
        by_rad = wrap_rad(to_rad - heading_rad)
        if abs(by_rad) > TRY_BOTH_TURNS_RAD and other and not differs:
            by_rad -= copysign(2 * pi, by_rad)
            differs = True
        if by_rad:
            parts.append(TurnSegment(point, heading_rad, by_rad))
        heading_rad += by_rad

    for (point, after), sign in zip(pairwise(points), signs, strict=True):
        length_m = point.distance_m(after)
        if length_m > MIN_SEGMENT_M:
            turn(point, point.bearing_rad(after) + (pi if sign < 0 else 0.0))
            parts.append(LineSegment(point, heading_rad, sign * length_m))
    if end_rad is not None:
        turn(points[-1], end_rad)
    if differs is not other or not parts:
        return None
    return make_polyline(parts, heading_rad, travel, rotate)


def make_polyline(
    parts: Sequence[TurnSegment | LineSegment], end_rad: float, travel: Bounds, rotate: Bounds
) -> Polyline:
    """Return the polyline of parts."""
    takes_s = sum(_takes_s(part, travel, rotate) for part in parts)
    return Polyline(tuple(parts), takes_s, end_rad)


def _beside(point: Point, heading_rad: float, ahead_m: float) -> Point:
    return Point(point.x_m + ahead_m * cos(heading_rad), point.y_m + ahead_m * sin(heading_rad))


def _takes_s(part: TurnSegment | LineSegment, travel: Bounds, rotate: Bounds) -> float:
    match part:
        case TurnSegment():
            return duration_s(part.by_rad, rotate)
        case LineSegment():
            return duration_s(part.by_m, _line_bounds(part, travel, rotate))


def _line_bounds(line: LineSegment, travel: Bounds, rotate: Bounds) -> Bounds:
    """Return the bounds along a line, and along an arc by those of its turning."""
    if not line.curvature_radpm:
        return travel
    radius_m = 1.0 / abs(line.curvature_radpm)
    return Bounds(
        min(travel.speed, rotate.speed * radius_m),
        min(travel.acceleration, rotate.acceleration * radius_m),
    )


def _along(distance: float, bounds: Bounds, time_s: float, takes_s: float) -> tuple[float, float]:
    """Return the distance covered and the speed, by a trapezoidal speed profile."""
    peak = min(bounds.speed, bounds.acceleration * takes_s / 2)
    ramp_s = peak / bounds.acceleration
    left_s = max(takes_s - time_s, 0.0)
    if time_s < ramp_s:
        done, speed = bounds.acceleration * time_s**2 / 2, bounds.acceleration * time_s
    elif left_s < ramp_s:
        done, speed = (
            abs(distance) - bounds.acceleration * left_s**2 / 2,
            bounds.acceleration * left_s,
        )
    else:
        done, speed = peak * (time_s - ramp_s / 2), peak
    return copysign(done, distance), copysign(speed, distance)
