"""ROS messages into facts. What is not a finite number is refused here and nowhere passed on."""

from math import asin, atan2, isfinite
from typing import Final

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion
from nav_msgs.msg import Odometry as OdometryMessage
from sensor_msgs.msg import BatteryState, CompressedImage

from executive.facts import Battery, Frame, Odometry
from executive.geometry import Pose, Velocity

_NORM_TOLERANCE: Final = 0.01
_FORMATS: Final = {"JPG": b"\xff\xd8\xff", "PNG": b"\x89PNG\r\n\x1a\n"}


class MessageError(ValueError):
    """A message says something that cannot be; the text names the field and its value."""


def finite(value: float, name: str) -> float:
    """Return the value.

    Raises:
        MessageError: it is NaN or infinite.
    """
    if not isfinite(value):
        raise MessageError(f"{name} is {value}")
    return value


def stamp_s(stamp: Time) -> float:
    """Return a stamp in seconds."""
    return float(stamp.sec + stamp.nanosec * 1e-9)


def angles(quaternion: Quaternion) -> tuple[float, float, float]:
    """Return roll, pitch and heading in rad (REP 103: about x, y, z, fixed axes).

    Raises:
        MessageError: it is not finite, or not of norm 1.
    """
    x, y, z, w = quaternion.x, quaternion.y, quaternion.z, quaternion.w
    norm = x * x + y * y + z * z + w * w
    if not abs(norm - 1.0) <= _NORM_TOLERANCE:
        raise MessageError(f"orientation ({x}, {y}, {z}, {w}) is no rotation")
    return (
        atan2(2 * (w * x + y * z), norm - 2 * (x * x + y * y)),
        asin(max(-1.0, min(1.0, 2 * (w * y - x * z) / norm))),
        atan2(2 * (w * z + x * y), norm - 2 * (y * y + z * z)),
    )


def odometry(message: OdometryMessage) -> Odometry:
    """Return pose and velocity of base_link.

    Raises:
        MessageError: a figure that is used is not finite, or the orientation is no rotation.
    """
    place, twist = message.pose.pose.position, message.twist.twist
    roll_rad, pitch_rad, heading_rad = angles(message.pose.pose.orientation)
    fact = Odometry(
        stamp_s(message.header.stamp),
        Pose(place.x, place.y, place.z, heading_rad, roll_rad, pitch_rad),
        Velocity(twist.linear.x, twist.angular.z),
    )
    if not (fact.pose.finite and fact.velocity.finite):
        raise MessageError(f"odometry is not finite: {fact.pose}, {fact.velocity}")
    return fact


def battery(message: BatteryState) -> Battery:
    """Return the voltage.

    Raises:
        MessageError: it is not finite, as where it is not measured.
    """
    return Battery(finite(message.voltage, "battery voltage"))


def frame(message: CompressedImage) -> Frame:
    """Return the picture.

    Raises:
        MessageError: the octets are not of a picture in a known format.
    """
    data = bytes(message.data)
    for name, magic in _FORMATS.items():
        if data.startswith(magic):
            return Frame(stamp_s(message.header.stamp), name, data)
    raise MessageError(f"camera frame of format {message.format!r} is neither JPEG nor PNG")
