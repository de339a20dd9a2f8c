"""Segments of a motion: turns, lines, curves, arcs and rests of base_link from start to end.

Each motion of the catalogue declares its segments. Checks, previews and energy estimates read its
end, length and turns there. They are ideal: controller and duration are not part of them.

Every segment has a `start` and an `end`, a length `by_m` (negative backward), a turn `by_rad`
(counter-clockwise positive; beyond pi if commanded so), and the `reference` of its end.
"""

from dataclasses import dataclass
from enum import Enum
from math import asin, copysign, sin
from typing import ClassVar, Final

from executive.values.geometry import Pose, Velocity, arc_end


class Reference(Enum):
    """Reference of the end of a segment."""

    START = "start"
    """Its start: a distance, an angle, or a velocity and a time."""
    FRAME = "frame"
    """The odometry frame: a position or a heading in it."""
    NEXT_LINE = "next line"
    """The next line: a turn towards its end, without a commanded heading of its own."""


@dataclass(frozen=True, slots=True)
class Turn:
    """A turn on the spot."""

    by_m: ClassVar[float] = 0.0
    start: Pose
    end: Pose
    by_rad: float
    reference: Reference


@dataclass(frozen=True, slots=True)
class Line:
    """A straight line at the heading of its start.

    Attributes:
        tolerance_m: position tolerance at its end; None for the asset's own.
    """

    by_rad: ClassVar[float] = 0.0
    start: Pose
    end: Pose
    by_m: float
    reference: Reference
    tolerance_m: float | None = None


@dataclass(frozen=True, slots=True)
class Arc:
    """A velocity that is held for a time."""

    reference: ClassVar[Reference] = Reference.START
    start: Pose
    velocity: Velocity
    duration_s: float

    @property
    def by_m(self) -> float:
        """Length of the arc."""
        return self.velocity.travel_mps * self.duration_s

    @property
    def by_rad(self) -> float:
        """Turn of the arc."""
        return self.velocity.rotate_radps * self.duration_s

    @property
    def end(self) -> Pose:
        """End pose of the arc."""
        return arc_end(self.start, self.by_m, self.by_rad)


@dataclass(frozen=True, slots=True)
class Rest:
    """A standstill for a time."""

    by_m: ClassVar[float] = 0.0
    by_rad: ClassVar[float] = 0.0
    reference: ClassVar[Reference] = Reference.START
    start: Pose
    duration_s: float

    @property
    def end(self) -> Pose:
        """End pose of the rest."""
        return self.start


@dataclass(frozen=True, slots=True)
class Curve:
    """An arc of a length and a turn, at any speed."""

    start: Pose
    by_m: float
    by_rad: float
    reference: Reference

    @property
    def end(self) -> Pose:
        """End pose of the arc."""
        return arc_end(self.start, self.by_m, self.by_rad)


MIN_CURVE_M: Final = 0.2
"""Minimum length of the first arc, while which wheels are steered. Chosen, not measured."""
MIN_FIRST_RAD: Final = 1e-3


def curves_of(turn: Turn, radius_m: float, backward: bool = False) -> tuple[Curve, ...]:
    """Return the arcs of a turn of a base that cannot turn on the spot; they end at its start.

    Of three arcs the one in the middle is driven in the other direction. With half of the turn a
    and half of the middle arc b, the path backward equals that ahead: sin a = 2 sin b.

    Args:
        turn: the turn.
        radius_m: minimum radius of the arcs.
        backward: whether the first is driven backward.
    """
    half_rad = abs(turn.by_rad) / 2
    middle_rad = asin(sin(half_rad) / 2)
    first_rad = half_rad - middle_rad
    radius_m = max(radius_m, MIN_CURVE_M / max(first_rad, MIN_FIRST_RAD))
    pose, curves, side = turn.start, [], copysign(1.0, turn.by_rad)
    for index, angle_rad in enumerate((first_rad, 2 * middle_rad, first_rad)):
        sign = 1.0 if backward is (index == 1) else -1.0
        if angle_rad > 0.0:
            by_m, by_rad = sign * radius_m * angle_rad, side * angle_rad
            curves.append(Curve(pose, by_m, by_rad, turn.reference))
            pose = curves[-1].end
    return tuple(curves)


Segment = Turn | Line | Arc | Curve | Rest
