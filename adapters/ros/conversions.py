"""Converts ROS messages to facts and back. Messages with non-finite numbers are rejected here."""

from collections.abc import Callable, Sequence
from enum import IntEnum
from io import BytesIO
from math import asin, atan2, isfinite, sqrt
from typing import Final

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose as PoseMessage
from geometry_msgs.msg import Quaternion, Twist, TwistStamped
from nav_msgs.msg import Odometry as OdometryMessage
from rclpy.duration import Duration
from sensor_msgs.msg import BatteryState, CompressedImage, Image, JointState
from std_msgs.msg import Float32, Float64, Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from executive.values.facts import Battery, Frame, Odometry
from executive.values.geometry import Pose, Velocity

_NORM_TOLERANCE: Final = 0.01
PERCENT: Final = 100.0
OVERFULL: Final = 1.1
"""Maximum reading of a battery gauge that reports ratios: it may err by 0.1."""
_FORMATS: Final = {"JPG": b"\xff\xd8\xff", "PNG": b"\x89PNG\r\n\x1a\n"}
_ENCODINGS: Final = {"rgb8": ("RGB", "RGB"), "bgr8": ("RGB", "BGR"), "mono8": ("L", "L")}
"""Encodings of raw images (sensor_msgs/image_encodings.hpp): Pillow's mode and raw mode."""
JPEG_QUALITY: Final = 85
"""Quality of raw images that are compressed here. Chosen, not measured."""


class MessageError(ValueError):
    """A message has an impossible value; the text names the field and the value."""


class IgnoredMessageError(MessageError):
    """A message to skip that valid publishers also send on the same topic."""


def finite(value: float, name: str) -> float:
    """Return the value.

    Raises:
        MessageError: it is NaN or infinite.
    """
    if not isfinite(value):
        raise MessageError(f"{name} is {value}")
    return value


class Precision(IntEnum):
    """Number of decimal digits of stored figures in SI units.

    They are about ten times finer than the noise of a rover's sensors. Finer digits would only
    enlarge recordings. Rounding precedes the core, so that it decides on the recorded figures.
    """

    TORQUE = 2
    ACCELERATION = 3
    WHEEL = 3
    RANGE = 3
    VOLTAGE = 3
    STAMP = 4
    LENGTH = 4
    SPEED = 4
    LEAN = 4
    RATIO = 4
    HEADING = 5
    DEVIATION = 6


def round_measurement(value: float, precision: Precision) -> float:
    """Return a figure rounded to its stored precision."""
    return round(value, precision)


def stamp_s(stamp: Time) -> float:
    """Return a stamp in seconds."""
    return round_measurement(stamp.sec + stamp.nanosec * 1e-9, Precision.STAMP)


def angles(
    quaternion: Quaternion, precision: Precision = Precision.HEADING
) -> tuple[float, float, float]:
    """Return roll, pitch and heading in rad (REP 103: about x, y, z, fixed axes).

    Raises:
        MessageError: the quaternion is not finite, or not of norm 1.
    """
    x, y, z, w = quaternion.x, quaternion.y, quaternion.z, quaternion.w
    norm = x * x + y * y + z * z + w * w
    if not abs(norm - 1.0) <= _NORM_TOLERANCE:
        raise MessageError(f"orientation ({x}, {y}, {z}, {w}) is not a rotation")
    return (
        round_measurement(atan2(2 * (w * x + y * z), norm - 2 * (x * x + y * y)), precision),
        round_measurement(asin(max(-1.0, min(1.0, 2 * (w * y - x * z) / norm))), precision),
        round_measurement(atan2(2 * (w * z + x * y), norm - 2 * (y * y + z * z)), precision),
    )


def pose_of(message: PoseMessage) -> Pose:
    """Return position (m) and orientation (rad).

    Raises:
        MessageError: the orientation is no rotation.
    """
    point = message.position
    roll_rad, pitch_rad, heading_rad = angles(message.orientation)
    x_m, y_m, z_m = (
        round_measurement(each, Precision.LENGTH) for each in (point.x, point.y, point.z)
    )
    return Pose(x_m, y_m, z_m, heading_rad, roll_rad, pitch_rad)


def odometry_fact(message: OdometryMessage) -> Odometry:
    """Return pose and velocity of base_link, with the standard deviations of the pose.

    Raises:
        MessageError: a used figure is not finite, or the orientation is no rotation.
    """
    twist = message.twist.twist
    fact = Odometry(
        stamp_s(message.header.stamp),
        pose_of(message.pose.pose),
        Velocity(
            round_measurement(twist.linear.x, Precision.SPEED),
            round_measurement(twist.angular.z, Precision.SPEED),
        ),
        *pose_sd(message.pose.covariance),
    )
    if not (fact.pose.finite and fact.velocity.finite):
        x_m, y_m, z_m = fact.pose.x_m, fact.pose.y_m, fact.pose.z_m
        speeds = f"{fact.velocity.travel_mps} m/s, {fact.velocity.rotate_radps} rad/s"
        raise MessageError(f"position ({x_m}, {y_m}, {z_m}) or velocity {speeds} is not finite")
    return fact


def twist_of(message: Twist | TwistStamped) -> Twist:
    """Return the twist of a velocity command, stamped or not."""
    return message.twist if isinstance(message, TwistStamped) else message


def velocity_message(velocity: Velocity, kind: type, stamp: Time) -> Twist | TwistStamped:
    """Return a velocity of base_link as a message of the kind."""
    twist = Twist()
    twist.linear.x, twist.angular.z = velocity.travel_mps, velocity.rotate_radps
    if kind is Twist:
        return twist
    return TwistStamped(header=Header(stamp=stamp, frame_id=BASE_LINK), twist=twist)


def pose_sd(covariance: Sequence[float]) -> tuple[float, float]:
    """Return standard deviations of position (m, maximum of x and y) and heading (rad).

    Args:
        covariance: 6 × 6 of x, y, z and the rotations about them, row by row; entries that are
            zero, negative or not finite mean unknown and give 0.
    """
    x_m2, y_m2, heading_rad2 = (
        float(covariance[at]) if isfinite(covariance[at]) else 0.0 for at in (0, 7, 35)
    )
    position_sd_m, heading_sd_rad = sqrt(max(x_m2, y_m2, 0.0)), sqrt(max(heading_rad2, 0.0))
    return round_measurement(position_sd_m, Precision.DEVIATION), round_measurement(
        heading_sd_rad, Precision.DEVIATION
    )


class BatteryReader:
    """Converts battery messages to facts, and detects the unit of the driver's percentage.

    Attributes:
        percent: whether it is in percent; set for good by the first value above 1.1; else a ratio.
        on_percent: called when that is detected.
    """

    def __init__(self, on_percent: Callable[[str], None]) -> None:
        self.percent = self._known = False
        self._on_percent = on_percent

    def fact(self, message: BatteryState | Float32) -> Battery:
        """Return the voltage in V, NaN if not measured, and the charge ratio, if known.

        A charge of 0 means an empty battery if a charge was reported before, or if the battery is
        present with a voltage: drivers that measure no charge set neither.
        """
        if isinstance(message, Float32):
            return Battery(round_measurement(message.data, Precision.VOLTAGE), None)
        charge, voltage_v = (
            message.percentage,
            round_measurement(message.voltage, Precision.VOLTAGE),
        )
        if OVERFULL < charge <= PERCENT and not self.percent:
            self.percent = True
            self._on_percent(f"the battery reports its charge as {charge:g}: taken as percent")
        if self.percent:
            charge /= PERCENT
        elif 1.0 < charge <= OVERFULL:
            charge = 1.0
        self._known |= charge > 0.0 or (message.present and voltage_v > 0.0)
        usable = 0.0 < charge <= 1.0 or (charge == 0.0 and self._known)
        return Battery(voltage_v, round_measurement(charge, Precision.RATIO) if usable else None)


def joint_angle(message: Float64 | JointState | JointTrajectory, joint: str) -> float | None:
    """Return the angle of a joint, measured or commanded, rad; None without this joint.

    Raises:
        MessageError: it is not finite, or missing.
    """
    if isinstance(message, Float64):
        return finite(message.data, "camera angle")
    if isinstance(message, JointTrajectory):
        names = list(message.joint_names)
        positions = message.points[-1].positions if message.points else []
    else:
        names, positions = list(message.name), message.position
    if joint not in names:
        return None
    index = names.index(joint)
    if index >= len(positions):
        raise MessageError(f"joint {joint} has no position")
    return finite(positions[index], f"joint {joint}")


def joint_state(kind: type, joint: str, angle_rad: float, time_s: float) -> Float64 | JointState:
    """Return the measured angle of a joint, in the message type of its topic."""
    if kind is Float64:
        return Float64(data=angle_rad)
    message = JointState(name=[joint], position=[angle_rad])
    message.header.stamp = time_message(time_s)
    return message


def joint_command(
    kind: type, joint: str, angle_rad: float, speed_radps: float, turn_rad: float
) -> Float64 | JointState | JointTrajectory:
    """Return the command that turns a joint to an angle.

    Args:
        kind: type of the message.
        joint: name of the joint.
        angle_rad: set point.
        speed_radps: maximum speed; gives a trajectory its duration.
        turn_rad: angle between the present set point and this one.
    """
    if kind is JointState:
        return JointState(name=[joint], position=[angle_rad], velocity=[speed_radps])
    if kind is JointTrajectory:
        duration = Duration(seconds=abs(turn_rad) / speed_radps).to_msg()
        point = JointTrajectoryPoint(positions=[angle_rad], time_from_start=duration)
        return JointTrajectory(joint_names=[joint], points=[point])
    return Float64(data=angle_rad)


def frame_fact(message: CompressedImage | Image) -> Frame:
    """Return the picture; a raw one is compressed as JPEG.

    Raises:
        MessageError: the octets are not a picture in a known format, or the encoding of a raw
            image is not supported.
    """
    if isinstance(message, Image):
        return Frame(stamp_s(message.header.stamp), "JPG", _as_jpeg(message))
    data = bytes(message.data)
    for name, magic in _FORMATS.items():
        if data.startswith(magic):
            return Frame(stamp_s(message.header.stamp), name, data)
    raise MessageError(f"camera frame of format {message.format!r} is neither JPEG nor PNG")


def _as_jpeg(message: Image) -> bytes:
    from PIL import Image as Pillow

    if message.encoding not in _ENCODINGS:
        known = ", ".join(_ENCODINGS)
        raise MessageError(
            f"camera image of encoding {message.encoding[:40]!r}: {known}; convert others, e.g. by"
            " image_proc"
        )
    mode, raw = _ENCODINGS[message.encoding]
    size = (message.width, message.height)
    try:
        picture = Pillow.frombuffer(mode, size, bytes(message.data), "raw", raw, message.step, 1)
        picture.save(buffer := BytesIO(), "JPEG", quality=JPEG_QUALITY)
    except (ValueError, SystemError) as error:
        octets, step = len(message.data), message.step
        raise MessageError(
            f"camera image {size[0]} x {size[1]} {message.encoding}, step {step}, {octets} octets:"
            f" {error}"
        ) from error
    return buffer.getvalue()


ODOM: Final = "odom"
BASE_LINK: Final = "base_link"


def time_message(time_s: float) -> Time:
    """Return seconds as a stamp.

    Raises:
        OverflowError: out of range; rclpy would write another time or fail without a cause.
    """
    seconds, nanoseconds = divmod(round(time_s * 1e9), 10**9)
    if not -(2**31) <= seconds < 2**31:
        raise OverflowError(f"{time_s:g} s since 1970 do not fit into a stamp")
    return Time(sec=seconds, nanosec=nanoseconds)


def quaternion(pose: Pose) -> Quaternion:
    """Return roll, pitch and heading as a quaternion."""
    x, y, z, w = pose.quaternion
    return Quaternion(x=x, y=y, z=z, w=w)


def odometry_message(fact: Odometry) -> OdometryMessage:
    """Return pose and velocity of base_link in the odometry frame, with the pose covariance."""
    message = OdometryMessage()
    message.header.stamp = time_message(fact.stamp_s)
    message.header.frame_id = ODOM
    message.child_frame_id = BASE_LINK
    position = message.pose.pose.position
    position.x, position.y, position.z = fact.pose.x_m, fact.pose.y_m, fact.pose.z_m
    message.pose.pose.orientation = quaternion(fact.pose)
    message.twist.twist.linear.x = fact.velocity.travel_mps
    message.twist.twist.angular.z = fact.velocity.rotate_radps
    if fact.position_sd_m or fact.heading_sd_rad:
        message.pose.covariance = pose_covariance(fact.position_sd_m, fact.heading_sd_rad)
    return message


def pose_covariance(position_sd_m: float, heading_sd_rad: float) -> list[float]:
    """Return the covariance of a pose, row by row, with equal variances for all axes."""
    covariance = [0.0] * 36
    covariance[0] = covariance[7] = covariance[14] = position_sd_m * position_sd_m
    covariance[21] = covariance[28] = covariance[35] = heading_sd_rad * heading_sd_rad
    return covariance


def battery_message(
    fact: Battery, time_s: float, kind: type = BatteryState
) -> BatteryState | Float32:
    """Return voltage and charge, or as Float32 the voltage alone; unmeasured fields are NaN."""
    if kind is Float32:
        return Float32(data=fact.voltage_v)
    unknown = float("nan")
    message = BatteryState(
        voltage=fact.voltage_v,
        temperature=unknown,
        current=unknown,
        charge=unknown,
        capacity=unknown,
        design_capacity=unknown,
        percentage=unknown if fact.charge_ratio is None else fact.charge_ratio,
        power_supply_technology=BatteryState.POWER_SUPPLY_TECHNOLOGY_LION,
        present=True,
    )
    message.header.stamp = time_message(time_s)
    return message
