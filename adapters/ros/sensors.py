"""Topics and subscriptions of an asset's sensors other than its odometry."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

from nav_msgs.msg import Odometry
from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.subscription import Subscription
from sensor_msgs.msg import Imu, JointState, LaserScan

from adapters.ros.parameters import (
    ParameterError,
    Topic,
    declare_optional_topic,
    declare_value,
)
from adapters.ros.sensor_messages import (
    WheelJoints,
    imu_fact,
    joints_fact,
    laser_fact,
    second_odometry_fact,
)
from executive.settings import Sensor, Sensors
from executive.values.facts import Fact, Source

MESSAGES: Final[Mapping[Sensor, type]] = {
    Sensor.IMU: Imu,
    Sensor.JOINTS: JointState,
    Sensor.SECOND_ODOMETRY: Odometry,
    Sensor.LASER: LaserScan,
}


@dataclass(frozen=True, slots=True)
class SensorTopics:
    """The topics of the sensors that an asset has.

    Attributes:
        topics: topic of each sensor; sensors without one are absent.
        joints: names of the wheels' joints; empty if the asset has no such sensor.
        zero_is_free: as in the settings of the laser.
    """

    topics: Mapping[Sensor, Topic]
    joints: WheelJoints
    zero_is_free: bool = False

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
        kind = MESSAGES[sensor]
        meaning = f"{kind.__module__.partition('.')[0]}/{kind.__name__} of sensors.{sensor.value}"
        topic = declare_optional_topic(node, sensor.value, meaning)
        if topic is not None:
            topics[sensor] = topic
    joints = WheelJoints((), ())
    if Sensor.JOINTS in topics:
        joints = WheelJoints(_names(node, "left"), _names(node, "right"))
    return SensorTopics(topics, joints, sensors.laser is not None and sensors.laser.zero_is_free)


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
        facts: Mapping[Sensor, Callable[[Any], Fact]] = {
            Sensor.IMU: imu_fact,
            Sensor.JOINTS: partial(joints_fact, joints=sensors.joints),
            Sensor.SECOND_ODOMETRY: second_odometry_fact,
            Sensor.LASER: partial(laser_fact, zero_is_free=sensors.zero_is_free),
        }
        unwaited = _Unwaited()
        quiet = SubscriptionEventCallbacks(use_default_callbacks=False)
        self._polled: list[tuple[type, int, Subscription]] = [
            (
                MESSAGES[sensor],
                topic.qos.depth,
                node.create_subscription(
                    MESSAGES[sensor],
                    topic.name,
                    receiving(Source[sensor.name], facts[sensor]),
                    topic.qos,
                    callback_group=unwaited,
                    event_callbacks=quiet,
                ),
            )
            for sensor, topic in sensors.topics.items()
        ]

    def poll(self) -> None:
        """Observe the messages received since the last call."""
        for kind, depth, subscription in self._polled:
            waiting = subscription.handle
            with waiting:
                for _ in range(depth):
                    taken = waiting.take_message(kind, False)
                    if taken is None:
                        break
                    subscription.callback(taken[0])


class _Unwaited(CallbackGroup):
    """Callback group of subscriptions that no executor waits for."""

    def can_execute(self, entity: Any) -> bool:
        """Return False."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Return False."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Ignore the call: no execution begins."""
