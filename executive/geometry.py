"""Planar geometry of the rover, in SI units and the frames of REP 103 and REP 105."""

from dataclasses import dataclass
from math import atan2, cos, hypot, isfinite, pi, sin


def wrap_rad(angle_rad: float) -> float:
    """Return the angle in (-pi, pi]."""
    wrapped = (angle_rad + pi) % (2 * pi) - pi
    return pi if wrapped == -pi else wrapped


@dataclass(frozen=True, slots=True)
class Point:
    """A place in the plane of a frame."""

    x_m: float
    y_m: float

    def distance_m(self, other: "Point") -> float:
        """Return the straight distance to another place."""
        return hypot(other.x_m - self.x_m, other.y_m - self.y_m)

    def bearing_rad(self, other: "Point") -> float:
        """Return the direction in which another place lies, counter-clockwise from x."""
        return atan2(other.y_m - self.y_m, other.x_m - self.x_m)


@dataclass(frozen=True, slots=True)
class Pose:
    """Where base_link is in the odometry frame, and how the rover leans."""

    x_m: float = 0.0
    y_m: float = 0.0
    z_m: float = 0.0
    heading_rad: float = 0.0
    roll_rad: float = 0.0
    pitch_rad: float = 0.0

    @property
    def point(self) -> Point:
        """The place of base_link in the plane."""
        return Point(self.x_m, self.y_m)

    def ahead(self, distance_m: float) -> Point:
        """Return the point that lies this far along the heading (behind, if negative)."""
        return Point(
            self.x_m + distance_m * cos(self.heading_rad),
            self.y_m + distance_m * sin(self.heading_rad),
        )

    @property
    def finite(self) -> bool:
        """Whether every figure is a finite number."""
        place = isfinite(self.x_m) and isfinite(self.y_m) and isfinite(self.z_m)
        return place and all(map(isfinite, (self.heading_rad, self.roll_rad, self.pitch_rad)))


@dataclass(frozen=True, slots=True)
class Velocity:
    """A planar velocity of base_link: forward positive, counter-clockwise positive."""

    travel_mps: float = 0.0
    rotate_radps: float = 0.0

    @property
    def finite(self) -> bool:
        """Whether both figures are finite numbers."""
        return isfinite(self.travel_mps) and isfinite(self.rotate_radps)


STANDING = Velocity()
