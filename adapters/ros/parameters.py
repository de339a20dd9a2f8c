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
    """A ROS parameter is missing or invalid; the text names it and its valid values."""


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic with its quality of service."""

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
    camera_pan: Annotated[Topic, "std_msgs/Float64, commanded pan, rad"]
    camera_tilt: Annotated[Topic, "std_msgs/Float64, commanded tilt, rad"]
    camera_speed: Annotated[Topic, "std_msgs/Float64, maximum speed of pan and tilt, rad/s"]
    ground_truth: Annotated[Topic, "nav_msgs/Odometry, true pose of a simulated rover"]


def declare_topics(node: Node) -> Topics:
    """Declare and read the parameters of every topic.

    Raises:
        ParameterError: one is missing or invalid.
    """
    hints = get_type_hints(Topics, include_extras=True)
    return Topics(
        **{name: declare_topic(node, name, hint.__metadata__[0]) for name, hint in hints.items()}
    )


def declare_rate(node: Node, name: str, meaning: str) -> float:
    """Declare and read a rate in Hz, above 0.

    Raises:
        ParameterError: it is missing or invalid.
    """
    rate_hz = float(declare_value(node, name, Parameter.Type.DOUBLE, f"{meaning}, Hz"))
    if not 0.0 < rate_hz <= 1000.0:
        raise ParameterError(f"parameter {name} is {rate_hz}: a rate is in 0 .. 1000 Hz")
    return rate_hz


def declare_flag(node: Node, name: str, meaning: str) -> bool:
    """Declare and read a flag; a missing parameter means False.

    Raises:
        ParameterError: it is not a Boolean.
    """
    return bool(_declared(node, name, Parameter.Type.BOOL, meaning))


def declare_topic(node: Node, key: str, meaning: str) -> Topic:
    """Declare and read the parameters of one topic.

    Raises:
        ParameterError: one is missing or invalid.
    """
    name = declare_value(node, f"{key}.topic", Parameter.Type.STRING, f"topic: {meaning}")
    return Topic(name, _declare_qos(node, key, meaning))


def declare_optional_topic(node: Node, key: str, meaning: str) -> Topic | None:
    """Declare and read the parameters of an optional topic; return None if its name is empty.

    Raises:
        ParameterError: it has a name, and another parameter is missing or invalid.
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
        ParameterError: it is missing, or of another type.
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
