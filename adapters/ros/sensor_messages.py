"""Conversion between facts and messages of the sensors other than odometry.

Axes are those of REP 103. IMU and laser frames are assumed parallel to base_link's, and poses of
a second odometry to be those of base_link (REP 105).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isfinite, nan
from typing import Final

from nav_msgs.msg import Odometry as OdometryMessage
from sensor_msgs.msg import Imu as ImuMessage
from sensor_msgs.msg import JointState
from sensor_msgs.msg import LaserScan as LaserScanMessage

from adapters.ros.conversions import (
    BASE_LINK,
    IgnoredMessageError,
    MessageError,
    Precision,
    angles,
    pose_covariance,
    pose_of,
    pose_sd,
    quaternion,
    round_measurement,
    stamp_s,
    time_message,
)
from executive.values.facts import Imu, Joints, LaserScan, SecondOdometry
from executive.values.geometry import Pose

MAX_RAYS: Final = 20_000
UNKNOWN: Final = -1.0
"""First element of the covariance of an unmeasured quantity (sensor_msgs/Imu)."""


@dataclass(frozen=True, slots=True)
class WheelJoints:
    """Names of the driven wheels' joints, front first."""

    left: tuple[str, ...]
    right: tuple[str, ...]


def imu_fact(message: ImuMessage) -> Imu:
    """Return orientation, rates and accelerations; roll and pitch are NaN if not measured.

    Raises:
        MessageError: rates or accelerations are not measured, not finite or, which gravity
            excludes, all zero; or the orientation is no rotation.
    """
    for name, covariance in (
        ("rates", message.angular_velocity_covariance),
        ("accelerations", message.linear_acceleration_covariance),
    ):
        if covariance[0] == UNKNOWN:
            raise MessageError(f"the IMU reports its {name} as not measured (covariance -1)")
    roll_rad = pitch_rad = nan
    turned = message.orientation
    filled = any((turned.x, turned.y, turned.z, turned.w))  # some drivers leave it zero
    if filled and message.orientation_covariance[0] != UNKNOWN:
        roll_rad, pitch_rad, _ = angles(turned, Precision.LEAN)
    rate, force = message.angular_velocity, message.linear_acceleration
    figures = (rate.x, rate.y, rate.z, force.x, force.y, force.z)
    if not all(map(isfinite, figures)):
        raise MessageError(f"the IMU's rates and accelerations are {figures}")
    if not any(figures):
        raise MessageError("the IMU's rates and accelerations are all zero")
    rates = (round_measurement(each, Precision.SPEED) for each in figures[:3])
    forces = (round_measurement(each, Precision.ACCELERATION) for each in figures[3:])
    return Imu(stamp_s(message.header.stamp), roll_rad, pitch_rad, *rates, *forces)


def joints_fact(message: JointState, joints: WheelJoints) -> Joints:
    """Return speeds and torques of the wheels. Incomplete torques are omitted.

    Raises:
        IgnoredMessageError: it has other joints only.
        MessageError: some of the wheels are missing, its arrays differ in length, or a speed is
            not finite.
    """
    names = list(message.name)
    wanted = (*joints.left, *joints.right)
    missing = [name for name in wanted if name not in names]
    if missing:
        text = f"joint states lack {', '.join(missing)}; they name {', '.join(names)}"
        raise (IgnoredMessageError if len(missing) == len(wanted) else MessageError)(text)
    if len(message.velocity) != len(names):
        raise MessageError(
            f"joint states of {len(names)} joints have {len(message.velocity)} speeds"
        )
    left, right = (tuple(map(names.index, side)) for side in (joints.left, joints.right))
    speeds = [_at(message.velocity, side, Precision.WHEEL) for side in (left, right)]
    if not all(map(isfinite, (*speeds[0], *speeds[1]))):
        raise MessageError(f"speeds of the wheels are {speeds[0]}, {speeds[1]}")
    efforts: list[tuple[float, ...]] = [(), ()]
    if len(message.effort) == len(names):
        efforts = [_at(message.effort, side, Precision.TORQUE) for side in (left, right)]
    if not all(map(isfinite, (*efforts[0], *efforts[1]))):
        efforts = [(), ()]
    return Joints(stamp_s(message.header.stamp), speeds[0], speeds[1], efforts[0], efforts[1])


def _at(values: Sequence[float], digits: Sequence[int], precision: Precision) -> tuple[float, ...]:
    return tuple(round_measurement(values[index], precision) for index in digits)


def second_odometry_fact(message: OdometryMessage) -> SecondOdometry:
    """Return the pose with its standard deviations.

    Raises:
        MessageError: a figure is not finite, or the orientation is no rotation.
    """
    pose = pose_of(message.pose.pose)
    if not pose.finite:
        raise MessageError(f"second odometry is not finite: {pose}")
    return SecondOdometry(stamp_s(message.header.stamp), pose, *pose_sd(message.pose.covariance))


def laser_fact(message: LaserScanMessage, zero_is_free: bool = False) -> LaserScan:
    """Return the ranges as in REP 117; NaN also for 0 and for less than the minimum range.

    An infinite maximum range, as sent by pointcloud_to_laserscan, is no bound.

    Args:
        message: the scan.
        zero_is_free: whether 0 means no return, if another ray has a measurement.

    Raises:
        MessageError: the number of rays is 0 or too large, or an angle or a bound is invalid.
    """
    min_m, max_m = message.range_min, message.range_max
    figures = (message.angle_min, message.angle_increment, min_m, max_m)
    finite = all(map(isfinite, figures[:3]))
    if not (finite and 0 <= min_m < max_m and message.angle_increment):
        raise MessageError(f"angles and bounds of the scan are {figures}")
    if not 0 < len(message.ranges) <= MAX_RAYS:
        raise MessageError(f"a scan of {len(message.ranges)} rays is not in 1 .. {MAX_RAYS}")
    free_m = {inf}
    if zero_is_free and any(0.0 < each < inf for each in message.ranges):
        free_m.add(0.0)
    return LaserScan(
        stamp_s(message.header.stamp),
        *figures,
        tuple(
            inf
            if each in free_m or each > max_m
            else round_measurement(each, Precision.RANGE)
            if 0.0 < each >= min_m
            else each
            if each == -inf
            else nan
            for each in message.ranges
        ),
    )


def imu_message(fact: Imu) -> ImuMessage:
    """Return orientation if known, rates and accelerations; the heading is 0."""
    message = ImuMessage()
    message.header.stamp = time_message(fact.stamp_s)
    message.header.frame_id = BASE_LINK
    if isfinite(fact.roll_rad):
        message.orientation = quaternion(Pose(roll_rad=fact.roll_rad, pitch_rad=fact.pitch_rad))
    else:
        message.orientation_covariance[0] = UNKNOWN
    rate, force = message.angular_velocity, message.linear_acceleration
    rate.x, rate.y, rate.z = fact.gyro_x_radps, fact.gyro_y_radps, fact.gyro_z_radps
    force.x, force.y = fact.acceleration_x_mps2, fact.acceleration_y_mps2
    force.z = fact.acceleration_z_mps2
    return message


def joints_message(fact: Joints, joints: WheelJoints) -> JointState:
    """Return speeds and torques, without positions."""
    message = JointState(
        name=[*joints.left, *joints.right],
        velocity=[*fact.left_radps, *fact.right_radps],
        effort=[*fact.left_nm, *fact.right_nm],
    )
    message.header.stamp = time_message(fact.stamp_s)
    return message


def second_odometry_message(fact: SecondOdometry, frame: str) -> OdometryMessage:
    """Return the pose in its own frame, with the variances of position and heading."""
    message = OdometryMessage()
    message.header.stamp = time_message(fact.stamp_s)
    message.header.frame_id = frame
    message.child_frame_id = BASE_LINK
    position = message.pose.pose.position
    position.x, position.y, position.z = fact.pose.x_m, fact.pose.y_m, fact.pose.z_m
    message.pose.pose.orientation = quaternion(fact.pose)
    message.pose.covariance = pose_covariance(fact.position_sd_m, fact.heading_sd_rad)
    return message


def laser_message(fact: LaserScan) -> LaserScanMessage:
    """Return the ranges, all measured at the same time."""
    message = LaserScanMessage(
        angle_min=fact.angle_min_rad,
        angle_max=fact.angle_min_rad + (len(fact.ranges_m) - 1) * fact.angle_increment_rad,
        angle_increment=fact.angle_increment_rad,
        range_min=fact.range_min_m,
        range_max=fact.range_max_m,
        ranges=fact.ranges_m,
    )
    message.header.stamp = time_message(fact.stamp_s)
    message.header.frame_id = BASE_LINK
    return message
