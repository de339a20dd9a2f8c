"""Topic names, quality of service and rates, as ROS parameters of the node."""

from dataclasses import dataclass
from typing import Annotated, Any, get_type_hints

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy

from executive.settings import SettingsError

_RELIABILITY = {
    "reliable": ReliabilityPolicy.RELIABLE,
    "best_effort": ReliabilityPolicy.BEST_EFFORT,
}


class ParameterError(SettingsError):
    """A ROS parameter is missing or wrong; the text names it and says what it should be."""


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic and how it is spoken."""

    name: str
    qos: QoSProfile


@dataclass(frozen=True, slots=True)
class Topics:
    """All topics of an asset (thesis fig. 22 and 23), named as in the parameter file."""

    odometry: Annotated[Topic, "nav_msgs/Odometry of the rover"]
    battery: Annotated[Topic, "sensor_msgs/BatteryState of the rover"]
    camera_pan_state: Annotated[Topic, "std_msgs/Float64, measured pan, rad"]
    camera_tilt_state: Annotated[Topic, "std_msgs/Float64, measured tilt, rad"]
    camera_compressed: Annotated[Topic, "sensor_msgs/CompressedImage of the camera"]
    camera_image: Annotated[Topic, "sensor_msgs/Image of the camera"]
    cmd_vel: Annotated[Topic, "geometry_msgs/Twist that moves the rover"]
    camera_pan: Annotated[Topic, "std_msgs/Float64, wanted pan, rad"]
    camera_tilt: Annotated[Topic, "std_msgs/Float64, wanted tilt, rad"]
    camera_speed: Annotated[Topic, "std_msgs/Float64, greatest speed of pan and tilt, rad/s"]
    ground_truth: Annotated[Topic, "nav_msgs/Odometry, where a simulated rover really is"]


def declare_topics(node: Node) -> Topics:
    """Declare and read the parameters of every topic.

    Raises:
        ParameterError: one is missing or wrong.
    """
    hints = get_type_hints(Topics, include_extras=True)
    return Topics(
        **{name: declare_topic(node, name, hint.__metadata__[0]) for name, hint in hints.items()}
    )


def declare_rate(node: Node, name: str, meaning: str) -> float:
    """Declare and read a rate in Hz, above 0.

    Raises:
        ParameterError: it is missing or wrong.
    """
    rate_hz = float(declare_value(node, name, Parameter.Type.DOUBLE, f"{meaning}, Hz"))
    if not 0.0 < rate_hz <= 1000.0:
        raise ParameterError(f"parameter {name} is {rate_hz}: a rate is in 0 .. 1000 Hz")
    return rate_hz


def declare_flag(node: Node, name: str, meaning: str) -> bool:
    """Declare and read whether something is wanted; it is not where the parameter is missing.

    Raises:
        ParameterError: it is wrong.
    """
    return bool(_declared(node, name, Parameter.Type.BOOL, meaning))


def declare_topic(node: Node, key: str, meaning: str) -> Topic:
    """Declare and read the parameters of one topic.

    Raises:
        ParameterError: one is missing or wrong.
    """
    name = declare_value(node, f"{key}.topic", Parameter.Type.STRING, f"topic: {meaning}")
    return Topic(name, _declare_qos(node, key, meaning))


def declare_optional_topic(node: Node, key: str, meaning: str) -> Topic | None:
    """Declare and read the parameters of a topic that an asset need not have: it may be empty.

    Raises:
        ParameterError: it has one, and a parameter is missing or wrong.
    """
    name = _declared(node, f"{key}.topic", Parameter.Type.STRING, f"topic: {meaning}")
    return Topic(name, _declare_qos(node, key, meaning)) if name else None


def _declare_qos(node: Node, key: str, meaning: str) -> QoSProfile:
    reliability = declare_value(
        node, f"{key}.reliability", Parameter.Type.STRING, f"reliable or best_effort: {meaning}"
    )
    depth = declare_value(node, f"{key}.depth", Parameter.Type.INTEGER, f"history: {meaning}")
    if reliability not in _RELIABILITY:
        raise ParameterError(
            f"parameter {key}.reliability is {reliability!r}: reliable or best_effort"
        )
    if depth < 1:
        raise ParameterError(f"parameter {key}.depth is {depth}: at least 1")
    return QoSProfile(depth=depth, reliability=_RELIABILITY[reliability])  # type: ignore[no-untyped-call]


def declare_value(node: Node, name: str, kind: Parameter.Type, description: str) -> Any:
    """Declare and read one parameter.

    Raises:
        ParameterError: it is missing, or of another kind.
    """
    value = _declared(node, name, kind, description)
    if value is None:
        raise ParameterError(f"parameter {name} ({description}) is not in the parameter file")
    return value


def _declared(node: Node, name: str, kind: Parameter.Type, description: str) -> Any:
    descriptor = ParameterDescriptor(description=description, read_only=True)
    try:
        return node.declare_parameter(name, kind, descriptor).value
    except InvalidParameterTypeException as error:
        raise ParameterError(f"parameter {name} ({description}): {error}") from error
