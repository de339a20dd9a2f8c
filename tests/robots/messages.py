"""Messages of a stand-in, as its drivers fill them."""

from collections import deque
from math import atan2, cos, nan, pi, sin
from random import Random

from builtin_interfaces.msg import Time
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import BatteryState, Image, Imu, JointState, LaserScan
from std_msgs.msg import Float32

from adapters.ros import time_message
from tests.robots.interfaces import (
    BatterySource,
    CameraSource,
    ImuSource,
    JointSource,
    OdometrySource,
)
from tests.robots.motion import Motion

RAYS = 361
GRAVITY_MPS2 = 9.81
GYRO_NOISE_RADPS = 0.002
GYRO_BIAS_RADPS = 0.001
FORCE_NOISE_MPS2 = 0.05
WHEEL_NOISE_RADPS = 0.02


class OdometryMessages:
    """Odometry of a motion; its twist may be a mean over some samples."""

    def __init__(self, source: OdometrySource, random: Random) -> None:
        self._source, self._random = source, random
        self._travel: deque[float] = deque(maxlen=source.mean_of)
        self._rates: deque[float] = deque(maxlen=source.mean_of)
        self._last_rad: float | None = None

    def message(self, motion: Motion) -> Odometry:
        source = self._source
        message = Odometry(child_frame_id=source.child)
        message.header.frame_id = source.frame
        message.header.stamp = stamp(motion)
        position, orientation = message.pose.pose.position, message.pose.pose.orientation
        position.x = motion.x_m + self._random.gauss(0, source.noise_m)
        position.y = motion.y_m + self._random.gauss(0, source.noise_m)
        orientation.z, orientation.w = sin(motion.odometry_rad / 2), cos(motion.odometry_rad / 2)
        self._travel.append(motion.travel_mps)
        self._rates.append(self._rate(motion))
        message.twist.twist.linear.x = sum(self._travel) / len(self._travel)
        message.twist.twist.angular.z = sum(self._rates) / len(self._rates)
        for index in (0, 7, 14, 21, 28):
            message.pose.covariance[index] = message.twist.covariance[index] = 0.001
        message.pose.covariance[35] = message.twist.covariance[35] = 0.01
        return message

    def _rate(self, motion: Motion) -> float:
        if not self._source.unwrapped:
            return motion.odometry_radps
        heading_rad = atan2(sin(motion.odometry_rad), cos(motion.odometry_rad))
        last_rad, self._last_rad = self._last_rad, heading_rad
        return 0.0 if last_rad is None else (heading_rad - last_rad) * self._source.rate_hz


def imu_message(source: ImuSource, motion: Motion, random: Random) -> Imu:
    message = Imu()
    message.header.stamp, message.header.frame_id = stamp(motion), "imu_link"
    rate, force = message.angular_velocity, message.linear_acceleration
    rate.x, rate.y = random.gauss(0, GYRO_NOISE_RADPS), random.gauss(0, GYRO_NOISE_RADPS)
    rate.z = motion.turn_radps + GYRO_BIAS_RADPS + random.gauss(0, GYRO_NOISE_RADPS)
    force.x = motion.travel_mps2 + random.gauss(0, FORCE_NOISE_MPS2)
    force.y = motion.travel_mps * motion.turn_radps + random.gauss(0, FORCE_NOISE_MPS2)
    force.z = GRAVITY_MPS2 + random.gauss(0, FORCE_NOISE_MPS2)
    if source.oriented:
        message.orientation.z = sin(motion.heading_rad / 2)
        message.orientation.w = cos(motion.heading_rad / 2)
        for index in (0, 4, 8):
            message.orientation_covariance[index] = 0.001
    return message


def joints_message(source: JointSource, motion: Motion, random: Random) -> JointState:
    message = JointState()
    message.header.stamp = stamp(motion)
    rates_radps = motion.wheel_rates()
    for side, names in enumerate((source.left, source.right)):
        for name in names:
            message.name.append(name)
            message.position.append(motion.wheels_rad[side])
            message.velocity.append(rates_radps[side] + random.gauss(0, WHEEL_NOISE_RADPS))
            message.effort.append(nan)
    return message


def battery_message(source: BatterySource, motion: Motion) -> BatteryState | Float32:
    if source.voltage_only:
        return Float32(data=source.voltage_v)
    message = BatteryState(voltage=source.voltage_v, percentage=source.charge_ratio, present=True)
    message.header.stamp = stamp(motion)
    return message


def scan_message(motion: Motion, rate_hz: float) -> LaserScan:
    """Return a scan in the open: 0 without a return, as LDS-01 reports it."""
    message = LaserScan(
        angle_min=-pi,
        angle_max=pi,
        angle_increment=2 * pi / (RAYS - 1),
        range_min=0.12,
        range_max=3.5,
        scan_time=1 / rate_hz,
        ranges=[0.0] * RAYS,
    )
    message.header.stamp, message.header.frame_id = stamp(motion), "base_scan"
    return message


def image_message(source: CameraSource, motion: Motion) -> Image:
    """Return a picture of stripes."""
    width = source.width_px
    row = bytes(128 if column % 2 else 60 for column in range(width) for _ in range(3))
    message = Image(
        width=width,
        height=source.height_px,
        encoding=source.encoding,
        step=len(row),
        data=row * source.height_px,
    )
    message.header.stamp, message.header.frame_id = stamp(motion), "camera_optical_frame"
    return message


def transform(
    motion: Motion, parent: str, child: str, place: tuple[float, float, float]
) -> TransformStamped:
    """Return a transform in the plane, in m and rad."""
    x_m, y_m, turned_rad = place
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id, message.header.stamp = parent, stamp(motion)
    message.transform.translation.x, message.transform.translation.y = x_m, y_m
    rotation = message.transform.rotation
    rotation.z, rotation.w = sin(turned_rad / 2), cos(turned_rad / 2)
    return message


def odometry_transform(message: Odometry) -> TransformStamped:
    """Return what a driver sends of its odometry on /tf."""
    sent = TransformStamped(header=message.header, child_frame_id=message.child_frame_id)
    at = message.pose.pose.position
    sent.transform.translation.x, sent.transform.translation.y = at.x, at.y
    sent.transform.rotation = message.pose.pose.orientation
    return sent


def stamp(motion: Motion) -> Time:
    return time_message(motion.now_s)
