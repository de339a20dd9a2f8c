"""Planar geometry of the rover, in SI units and the frames of REP 103 and REP 105."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum, unique
from itertools import pairwise
from math import atan2, ceil, cos, hypot, isfinite, pi, sin
from typing import Final

GRAVITY_MPS2: Final = 9.81


def wrap_rad(angle_rad: float) -> float:
    """Return the angle in (-pi, pi]."""
    wrapped = (angle_rad + pi) % (2 * pi) - pi
    return pi if wrapped == -pi else wrapped


@unique
class TargetFrame(Enum):
    """Frame of the waypoints of a command (REP 105)."""

    ODOM = "odom"
    MAP = "map"


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

    def compose(self, other: "Pose") -> "Pose":
        """Return the pose in this pose's frame of another that is given relative to this pose.

        Only heading and position are composed; roll and pitch are those of the other pose.
        """
        cosine, sine = cos(self.heading_rad), sin(self.heading_rad)
        return Pose(
            other.x_m * cosine - other.y_m * sine + self.x_m,
            other.x_m * sine + other.y_m * cosine + self.y_m,
            other.z_m + self.z_m,
            wrap_rad(other.heading_rad + self.heading_rad),
            other.roll_rad,
            other.pitch_rad,
        )

    @property
    def inverse(self) -> "Pose":
        """The pose of this pose's frame relative to this pose, in the plane."""
        turned = Pose(heading_rad=-self.heading_rad)
        return replace(
            turned.compose(Pose(-self.x_m, -self.y_m)), heading_rad=wrap_rad(-self.heading_rad)
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


def step_between(before: Pose, after: Pose) -> tuple[float, float, float]:
    """Return the displacement ahead and to the left, along the mean heading, and the turn."""
    turned_rad = wrap_rad(after.heading_rad - before.heading_rad)
    along_rad = before.heading_rad + turned_rad / 2
    dx_m, dy_m = after.x_m - before.x_m, after.y_m - before.y_m
    cosine, sine = cos(along_rad), sin(along_rad)
    return dx_m * cosine + dy_m * sine, dy_m * cosine - dx_m * sine, turned_rad


STANDING = Velocity()

Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Rotation:
    """Orientation of a sensor's axes in those of base_link, as the `rpy` of a URDF.

    Attributes:
        roll_rad, pitch_rad, yaw_rad: about x, then y, then z, fixed axes (REP 103).
    """

    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    yaw_rad: float = 0.0

    def apply(self, vector: Vector) -> Vector:
        """Return a vector of the sensor's axes in those of base_link."""
        x, y, z = vector
        y, z = _turned(y, z, self.roll_rad)
        z, x = _turned(z, x, self.pitch_rad)
        return *_turned(x, y, self.yaw_rad), z

    def reverse(self, vector: Vector) -> Vector:
        """Return a vector of base_link's axes in those of the sensor."""
        x, y, z = vector
        x, y = _turned(x, y, -self.yaw_rad)
        z, x = _turned(z, x, -self.pitch_rad)
        return x, *_turned(y, z, -self.roll_rad)


def _turned(x: float, y: float, by_rad: float) -> tuple[float, float]:
    cosine, sine = cos(by_rad), sin(by_rad)
    return x * cosine - y * sine, x * sine + y * cosine


def up_of(roll_rad: float, pitch_rad: float) -> Vector:
    """Return the vertical in the axes of a body that is inclined."""
    level = cos(pitch_rad)
    return -sin(pitch_rad), sin(roll_rad) * level, cos(roll_rad) * level


def inclination(up: Vector) -> tuple[float, float]:
    """Return roll and pitch of a body, by the vertical in its axes."""
    return atan2(up[1], up[2]), atan2(-up[0], hypot(up[1], up[2]))


ARC_RESOLUTION_RAD: Final = 0.2
"""Maximum turn of an arc for each line segment that approximates it; chosen, not measured."""


def path_length_m(path: Sequence[Point]) -> float:
    """Return the length of the straight lines between points."""
    return sum(start.distance_m(end) for start, end in pairwise(path))


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
