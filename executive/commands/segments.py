"""What a motion means: the turns, lines, arcs and rests that lead base_link from a pose to its end.

Each motion of the catalogue declares its segments; whoever needs to know where it leads, how long
its way is, or what it takes, reads those. They are ideal: how the rover is driven there, by which
controller and in what time, is not in them.

Every segment has a `start` and an `end`, a length `by_m` (negative backward) and a turn `by_rad`
(counter-clockwise positive; beyond pi where it was commanded so), and the `reference` of its end.
"""

from dataclasses import dataclass
from enum import Enum
from typing import ClassVar

from executive.values.geometry import Pose, Velocity, on_arc


class Reference(Enum):
    """What the end of a segment is given by."""

    START = "start"
    """Its start: a distance, an angle, or a velocity and a time."""
    FRAME = "frame"
    """The odometry frame: a place or a heading in it."""
    NEXT_LINE = "next line"
    """The line that follows: a turn towards its end, whose heading is not commanded itself."""


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
        tolerance_m: how near to its end is near enough; None for the asset's own.
    """

    by_rad: ClassVar[float] = 0.0
    start: Pose
    end: Pose
    by_m: float
    reference: Reference
    tolerance_m: float | None = None


@dataclass(frozen=True, slots=True)
class Arc:
    """A velocity held for a time."""

    reference: ClassVar[Reference] = Reference.START
    start: Pose
    velocity: Velocity
    duration_s: float

    @property
    def by_m(self) -> float:
        """Its length."""
        return self.velocity.travel_mps * self.duration_s

    @property
    def by_rad(self) -> float:
        """By how much it turns."""
        return self.velocity.rotate_radps * self.duration_s

    @property
    def end(self) -> Pose:
        """Where it ends."""
        return on_arc(self.start, self.by_m, self.by_rad)


@dataclass(frozen=True, slots=True)
class Rest:
    """Standing for a time."""

    by_m: ClassVar[float] = 0.0
    by_rad: ClassVar[float] = 0.0
    reference: ClassVar[Reference] = Reference.START
    start: Pose
    duration_s: float

    @property
    def end(self) -> Pose:
        """Where it ends."""
        return self.start


Segment = Turn | Line | Arc | Rest
