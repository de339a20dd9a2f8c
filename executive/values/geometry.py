"""Planar geometry of the rover, in SI units and the frames of REP 103 and REP 105."""

from dataclasses import dataclass, replace
from math import atan2, ceil, cos, hypot, isfinite, pi, sin
from typing import Final

GRAVITY_MPS2: Final = 9.81


def wrap_rad(angle_rad: float) -> float:
    """Return the angle in (-pi, pi]."""
    wrapped = (angle_rad + pi) % (2 * pi) - pi
    return pi if wrapped == -pi else wrapped


@dataclass(frozen=True, slots=True)
class Point:
    """A position in the plane of a frame."""

    x_m: float
    y_m: float

    def distance_m(self, other: "Point") -> float:
        """Return the straight-line distance to another point."""
        return hypot(other.x_m - self.x_m, other.y_m - self.y_m)

    def bearing_rad(self, other: "Point") -> float:
        """Return the direction to another point, counter-clockwise from x."""
        return atan2(other.y_m - self.y_m, other.x_m - self.x_m)


@dataclass(frozen=True, slots=True)
class Pose:
    """Position and orientation of base_link in the odometry frame."""

    x_m: float = 0.0
    y_m: float = 0.0
    z_m: float = 0.0
    heading_rad: float = 0.0
    roll_rad: float = 0.0
    pitch_rad: float = 0.0

    @property
    def point(self) -> Point:
        """Position of base_link in the plane."""
        return Point(self.x_m, self.y_m)

    def ahead(self, distance_m: float) -> Point:
        """Return the point at this distance along the heading (behind, if negative)."""
        return Point(
            self.x_m + distance_m * cos(self.heading_rad),
            self.y_m + distance_m * sin(self.heading_rad),
        )

    @property
    def quaternion(self) -> tuple[float, float, float, float]:
        """Roll, pitch and heading as a quaternion x, y, z, w."""
        cr, sr = cos(self.roll_rad / 2), sin(self.roll_rad / 2)
        cp, sp = cos(self.pitch_rad / 2), sin(self.pitch_rad / 2)
        ch, sh = cos(self.heading_rad / 2), sin(self.heading_rad / 2)
        return (
            sr * cp * ch - cr * sp * sh,
            cr * sp * ch + sr * cp * sh,
            cr * cp * sh - sr * sp * ch,
            cr * cp * ch + sr * sp * sh,
        )

    @property
    def finite(self) -> bool:
        """Whether every component is finite."""
        is_position_finite = isfinite(self.x_m) and isfinite(self.y_m) and isfinite(self.z_m)
        return is_position_finite and all(
            map(isfinite, (self.heading_rad, self.roll_rad, self.pitch_rad))
        )


@dataclass(frozen=True, slots=True)
class Velocity:
    """A planar velocity of base_link: forward positive, counter-clockwise positive."""

    travel_mps: float = 0.0
    rotate_radps: float = 0.0

    @property
    def finite(self) -> bool:
        """Whether both components are finite."""
        return isfinite(self.travel_mps) and isfinite(self.rotate_radps)

    def interpolate(self, other: "Velocity", part: float) -> "Velocity":
        """Interpolate between this velocity (part 0) and another (part 1)."""
        return Velocity(
            self.travel_mps + part * (other.travel_mps - self.travel_mps),
            self.rotate_radps + part * (other.rotate_radps - self.rotate_radps),
        )


STANDING = Velocity()


ARC_RESOLUTION_RAD: Final = 0.2
"""Maximum turn of an arc for each line segment that approximates it; chosen, not measured."""


def arc(pose: Pose, velocity: Velocity, duration_s: float) -> tuple[list[Point], Pose]:
    """Approximate the arc of a constant velocity by line segments, and return its end pose.

    Of an arc of more than one revolution only the first revolution is returned.
    """
    turn_rad = velocity.rotate_radps * duration_s
    length_m = velocity.travel_mps * duration_s
    pieces = max(1, ceil(min(abs(turn_rad), 2 * pi) / ARC_RESOLUTION_RAD))
    whole = pieces * max(1.0, abs(turn_rad) / (2 * pi))
    parts = [step / whole for step in range(pieces + 1)]
    points = [arc_end(pose, length_m * part, turn_rad * part).point for part in parts]
    return points, arc_end(pose, length_m, turn_rad)


def arc_end(pose: Pose, length_m: float, turn_rad: float) -> Pose:
    """Return the end pose of an arc that starts at a pose, along its heading."""
    half_rad = turn_rad / 2
    chord_m = length_m * (sin(half_rad) / half_rad if half_rad else 1.0)
    along_rad = pose.heading_rad + half_rad
    return replace(
        pose,
        x_m=pose.x_m + chord_m * cos(along_rad),
        y_m=pose.y_m + chord_m * sin(along_rad),
        heading_rad=wrap_rad(pose.heading_rad + turn_rad),
    )
