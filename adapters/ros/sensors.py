"""`PolledSensors`: topics and subscriptions of an asset's sensors other than its odometry."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter

from adapters.ros.parameters import (
    ParameterError,
    Topic,
    declare_optional_topic,
    declare_value,
)
from adapters.ros.sensor_messages import SENSOR_MESSAGES, WheelJoints, sensor_facts
from adapters.ros.subscription import TopicSubscription
from executive.settings import Sensor, Sensors
from executive.values.facts import Source
from executive.values.geometry import Rotation


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
