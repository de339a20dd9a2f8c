"""Segments of a motion: turns, lines, arcs and rests of base_link from its start to its end.

Each motion of the catalogue declares its segments. Checks, previews and energy estimates read its
end, length and turns there. They are ideal: controller and duration are not part of them.

Every segment has a `start` and an `end`, a length `by_m` (negative backward), a turn `by_rad`
(counter-clockwise positive; beyond pi if commanded so), and the `reference` of its end.
"""

from dataclasses import dataclass
from enum import Enum
from typing import ClassVar

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


Segment = Turn | Line | Arc | Rest
