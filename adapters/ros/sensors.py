"""Sensors other than the odometry: topics, subscriptions, conversion of their messages to facts.

Axes are those of REP 103. Measurements of the IMU are turned into base_link by its mounting. The
laser's frame is assumed parallel to base_link's, and poses of a second odometry to be those of
base_link (REP 105).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import inf, isfinite, nan
from typing import Any, Final

from nav_msgs.msg import Odometry as OdometryMessage
from rclpy.node import Node
from rclpy.parameter import Parameter
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
from adapters.ros.parameters import (
    ParameterError,
    Topic,
    declare_optional_topic,
    declare_value,
)
from adapters.ros.subscription import TopicSubscription
from executive.settings import Sensor, Sensors
from executive.values.facts import Imu, Joints, LaserScan, SecondOdometry, SensorFact, Source
from executive.values.geometry import Pose, Rotation, Vector, inclination, up_of

MAX_RAYS: Final = 20_000
IMU_LINK: Final = "imu_link"
UNKNOWN: Final = -1.0
"""First element of the covariance of an unmeasured quantity (sensor_msgs/Imu)."""
RATES: Final = 3
"""Number of rates, before the accelerations."""
LEAN_VARIANCE_RAD2: Final = 1e-6
"""Variance of a measured orientation: all zero with a level one means that there is none."""


@dataclass(frozen=True, slots=True)
class WheelJoints:
    """Names of the driven wheels' joints, front first."""

    left: tuple[str, ...]
    right: tuple[str, ...]


def imu_fact(message: ImuMessage, mounting: Rotation | None = None) -> Imu:
    """Return orientation, rates and accelerations in the axes of base_link.

    Roll, pitch and accelerations are NaN if not measured. An orientation that is exactly level and
    without any covariance is the default of a driver that measures none.

    Args:
        message: in the axes of the IMU.
        mounting: those axes in base_link; None if they are parallel.

    Raises:
        MessageError: rates are not measured; rates or accelerations are not finite or, which
            gravity excludes, all zero; or the orientation is no rotation.
    """
    if message.angular_velocity_covariance[0] == UNKNOWN:
        raise MessageError("the IMU reports its rates as not measured (covariance -1)")
    roll_rad = pitch_rad = nan
    turned, covariance = message.orientation, message.orientation_covariance
    filled = any((turned.x, turned.y, turned.z, turned.w))  # some drivers leave it zero
    if filled and covariance[0] != UNKNOWN:
        lean = angles(turned, Precision.LEAN)
        if any((turned.x, turned.y, *covariance)):
            roll_rad, pitch_rad, _ = lean
    rate, force = message.angular_velocity, message.linear_acceleration
    figures: tuple[float, ...] = (rate.x, rate.y, rate.z, force.x, force.y, force.z)
    if message.linear_acceleration_covariance[0] == UNKNOWN:
        figures = figures[:RATES]
    if not all(map(isfinite, figures)):
        raise MessageError(f"the IMU's rates and accelerations are {figures}")
    if len(figures) > RATES and not any(figures):
        raise MessageError("the IMU's rates and accelerations are all zero")
    rates = _rounded(figures[:RATES], Precision.SPEED)
    forces = _rounded(figures[RATES:], Precision.ACCELERATION)
    fact = Imu(stamp_s(message.header.stamp), roll_rad, pitch_rad, *rates, *(forces or (nan,) * 3))
    return fact if mounting is None else rotate_imu(fact, mounting.apply)


def rotate_imu(fact: Imu, rotate: Callable[[Vector], Vector]) -> Imu:
    """Return the measurement in other axes, given the rotation of a vector."""
    return Imu(
        fact.stamp_s,
        *_rounded(inclination(rotate(up_of(fact.roll_rad, fact.pitch_rad))), Precision.LEAN),
        *_rounded(rotate(fact.rates), Precision.SPEED),
        *_rounded(rotate(fact.acceleration), Precision.ACCELERATION),
    )


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
    return tuple(_rounded([values[index] for index in digits], precision))


def _rounded(values: Sequence[float], precision: Precision) -> list[float]:
    return [round_measurement(each, precision) for each in values]


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


def imu_message(fact: Imu, mounting: Rotation | None = None) -> ImuMessage:
    """Return the known measurements in the axes of the IMU; the heading is 0."""
    message = ImuMessage()
    message.header.stamp = time_message(fact.stamp_s)
    message.header.frame_id = BASE_LINK if mounting is None else IMU_LINK
    fact = fact if mounting is None else rotate_imu(fact, mounting.reverse)
    if isfinite(fact.roll_rad):
        message.orientation = quaternion(Pose(roll_rad=fact.roll_rad, pitch_rad=fact.pitch_rad))
        for at in (0, 4, 8):
            message.orientation_covariance[at] = LEAN_VARIANCE_RAD2
    else:
        message.orientation_covariance[0] = UNKNOWN
    rate, force = message.angular_velocity, message.linear_acceleration
    rate.x, rate.y, rate.z = fact.gyro_x_radps, fact.gyro_y_radps, fact.gyro_z_radps
    if not isfinite(fact.acceleration_x_mps2):
        message.linear_acceleration_covariance[0] = UNKNOWN
        return message
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


SENSOR_MESSAGES: Final[Mapping[Sensor, type]] = {
    Sensor.IMU: ImuMessage,
    Sensor.JOINTS: JointState,
    Sensor.SECOND_ODOMETRY: OdometryMessage,
    Sensor.LASER: LaserScanMessage,
}


def sensor_message(
    fact: SensorFact, joints: WheelJoints, frame: str, mounting: Rotation | None
) -> tuple[Sensor, object]:
    """Return the sensor and its message; frame: of the second odometry, mounting: of the IMU."""
    match fact:
        case Imu():
            return Sensor.IMU, imu_message(fact, mounting)
        case Joints():
            return Sensor.JOINTS, joints_message(fact, joints)
        case SecondOdometry():
            return Sensor.SECOND_ODOMETRY, second_odometry_message(fact, frame)
        case LaserScan():
            return Sensor.LASER, laser_message(fact)


def sensor_facts(
    joints: WheelJoints, zero_is_free: bool, mounting: Rotation | None
) -> Mapping[Sensor, Callable[[Any], SensorFact]]:
    """Return the conversion of each sensor's message; the figures are those of its settings."""
    return {
        Sensor.IMU: partial(imu_fact, mounting=mounting),
        Sensor.JOINTS: partial(joints_fact, joints=joints),
        Sensor.SECOND_ODOMETRY: second_odometry_fact,
        Sensor.LASER: partial(laser_fact, zero_is_free=zero_is_free),
    }


@dataclass(frozen=True, slots=True)
class SensorTopics:
    """The topics of the sensors that an asset has.

    Attributes:
        topics: topic of each sensor; sensors without one are absent.
        joints: names of the wheels' joints; empty if the asset has no such sensor.
        zero_is_free: as in the settings of the laser.
        mounting: as in the settings of the IMU.
    """

    topics: Mapping[Sensor, Topic]
    joints: WheelJoints
    zero_is_free: bool = False
    mounting: Rotation | None = None

    def without_topicless(self, sensors: Sensors) -> Sensors:
        """Return settings without the sensors that have no topic."""
        lacking = sensors.present - self.topics.keys()
        removed: dict[str, Any] = {each.value: None for each in lacking}
        return replace(sensors, **removed)


def declare_sensor_topics(node: Node, sensors: Sensors) -> SensorTopics:
    """Declare and read the parameters of the sensors in the settings.

    Raises:
        ParameterError: one is missing or invalid.
    """
    topics: dict[Sensor, Topic] = {}
    for sensor in sorted(sensors.present, key=list(Sensor).index):
        topic = declare_optional_topic(
            node, sensor.value, f"sensors.{sensor.value}", SENSOR_MESSAGES[sensor]
        )
        if topic is not None:
            topics[sensor] = topic
    joints = WheelJoints((), ())
    if Sensor.JOINTS in topics:
        joints = WheelJoints(_names(node, "left"), _names(node, "right"))
    zero_is_free = sensors.laser is not None and sensors.laser.zero_is_free
    mounting = None if sensors.imu is None else sensors.imu.mounting
    return SensorTopics(topics, joints, zero_is_free, mounting)


def _names(node: Node, side: str) -> tuple[str, ...]:
    key, meaning = f"joints.{side}", f"names of the joints of the {side} wheels, front first"
    names = declare_value(node, key, Parameter.Type.STRING_ARRAY, meaning)
    if not names or not all(names) or len(set(names)) != len(names):
        raise ParameterError(f"parameter {key} is {list(names)}: {meaning}, each once")
    return tuple(names)


class PolledSensors:
    """Receives the messages of sensors when it is polled.

    They do not wake the executor: at a hundred messages per second that would cost more than the
    messages themselves.

    Args:
        receiving: returns the callback for the messages of a source, given its conversion.
    """

    def __init__(
        self,
        node: Node,
        sensors: SensorTopics,
        receiving: Callable[..., Callable[[Any], None]],
    ) -> None:
        facts = sensor_facts(sensors.joints, sensors.zero_is_free, sensors.mounting)
        self.subscriptions = [
            TopicSubscription(
                node,
                topic,
                receiving(Source[sensor.name], facts[sensor]),
                polled=True,
            )
            for sensor, topic in sensors.topics.items()
        ]

    def poll(self) -> None:
        """Observe the messages received since the last call."""
        for each in self.subscriptions:
            each.poll()
