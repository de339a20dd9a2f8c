"""`declare_topics` and others: topics, quality of service and rates as ROS parameters of a node."""

from dataclasses import dataclass
from typing import Annotated, Any, Final, get_type_hints

from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import BatteryState, CompressedImage, Image, JointState
from std_msgs.msg import Bool, Float32, Float64
from trajectory_msgs.msg import JointTrajectory

from executive.settings import SettingsError

try:
    from tf2_msgs import msg as _tf2
except ImportError:  # the wheels of PyPI have none
    _tf2 = None
TF_MESSAGE: Final[Any] = getattr(_tf2, "TFMessage", None)

_RELIABILITY = {
    "reliable": ReliabilityPolicy.RELIABLE,
    "best_effort": ReliabilityPolicy.BEST_EFFORT,
}


_DURABILITY = {
    "volatile": DurabilityPolicy.VOLATILE,
    "transient_local": DurabilityPolicy.TRANSIENT_LOCAL,
}


TF_TYPE: Final = "tf2_msgs/msg/TFMessage"
NO_TF2_MSGS: Final = "this ROS has no tf2_msgs (an apt installation has: ros-jazzy-tf2-msgs)"


class ParameterError(SettingsError):
    """A ROS parameter is missing or invalid; the text names it and its valid values."""


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic with its message type and quality of service.

    Attributes:
        joint: name of the joint in messages with several joints; empty for other types.
        follows: whether a subscription has the reliability of its publishers, because the file
            states none; a publisher is reliable then.
    """

    name: str
    type: type
    qos: QoSProfile
    joint: str = ""
    follows: bool = False


@dataclass(frozen=True, slots=True)
class Topics:
    """All topics of an asset (thesis fig. 22 and 23), named as in the parameter file.

    Each is annotated with its meaning and the accepted message types, the default first. Optional
    ones are None if the file omits them or gives an empty name.
    """

    odometry: Annotated[Topic, "pose and velocity of the rover", Odometry, TF_MESSAGE]
    battery: Annotated[
        Topic | None, "state of the battery, or its voltage, V", BatteryState, Float32
    ]
    camera_pan_state: Annotated[Topic | None, "measured pan, rad", Float64, JointState]
    camera_tilt_state: Annotated[Topic | None, "measured tilt, rad", Float64, JointState]
    camera: Annotated[Topic | None, "pictures of the camera", CompressedImage, Image]
    cmd_vel: Annotated[Topic, "velocity of the rover", Twist, TwistStamped]
    camera_pan: Annotated[Topic | None, "commanded pan, rad", Float64, JointTrajectory, JointState]
    camera_tilt: Annotated[
        Topic | None, "commanded tilt, rad", Float64, JointTrajectory, JointState
    ]
    camera_speed: Annotated[Topic | None, "maximum speed of pan and tilt, rad/s", Float64]
    emergency_stop: Annotated[Topic | None, "state of the robot's emergency stop", Bool]
    ground_truth: Annotated[Topic | None, "true pose of a simulated rover", Odometry]
    camera_raw: Annotated[Topic | None, "raw pictures of a simulated rover", Image]


def declare_topics(node: Node) -> Topics:
    """Declare and read the parameters of every topic.

    Raises:
        ParameterError: one is missing or invalid.
    """
    declared: dict[str, Any] = {}
    for name, hint in get_type_hints(Topics, include_extras=True).items():
        declare = declare_topic if hint.__origin__ is Topic else declare_optional_topic
        declared[name] = declare(node, name, *hint.__metadata__)
    return Topics(**declared)


def declare_rate(node: Node, name: str, meaning: str) -> float:
    """Declare and read a rate in Hz, above 0.

    Raises:
        ParameterError: it is missing or invalid.
    """
    rate_hz = float(declare_value(node, name, Parameter.Type.DOUBLE, f"{meaning}, Hz"))
    if not 0.0 < rate_hz <= 1000.0:
        raise ParameterError(f"parameter {name} is {rate_hz}: a rate is in 0 .. 1000 Hz")
    return rate_hz


def declare_flag(node: Node, name: str, meaning: str, *, default: bool = False) -> bool:
    """Declare and read a flag; a missing parameter means the default.

    Raises:
        ParameterError: it is not a Boolean.
    """
    flag = _declared(node, name, Parameter.Type.BOOL, meaning)
    return default if flag is None else bool(flag)


def declare_optional_text(node: Node, name: str, meaning: str) -> str:
    """Declare and read a text; a missing parameter means an empty one.

    Raises:
        ParameterError: it is not a text.
    """
    return _declared(node, name, Parameter.Type.STRING, meaning) or ""


def declare_topic(node: Node, key: str, meaning: str, *types: type) -> Topic:
    """Declare and read the parameters of one topic.

    Args:
        node: declares them.
        key: name of the topic in the parameter file.
        meaning: description of its messages.
        types: accepted message types; the first is the default of the parameter `type`.

    Raises:
        ParameterError: one is missing or invalid.
    """
    name = declare_value(node, f"{key}.topic", Parameter.Type.STRING, f"topic: {meaning}")
    return _declared_topic(node, key, meaning, name, types)


def declare_optional_topic(node: Node, key: str, meaning: str, *types: type) -> Topic | None:
    """Declare and read the parameters of an optional topic; return None if its name is empty.

    Raises:
        ParameterError: it has a name, and another parameter is missing or invalid.
    """
    name = _declared(node, f"{key}.topic", Parameter.Type.STRING, f"topic: {meaning}")
    return _declared_topic(node, key, meaning, name, types) if name else None


def type_name(kind: type) -> str:
    """Return the name of a message type as `ros2 topic info` prints it."""
    return f"{kind.__module__.partition('.')[0]}/msg/{kind.__name__}"


def _declared_topic(
    node: Node, key: str, meaning: str, name: str, types: tuple[type | None, ...]
) -> Topic:
    known = {type_name(each): each for each in types if each is not None}
    text = f"{' or '.join(known)}: {meaning}"
    kind = _declared(node, f"{key}.type", Parameter.Type.STRING, text) or next(iter(known))
    if kind == TF_TYPE and TF_MESSAGE is None:
        raise ParameterError(f"parameter {key}.type is {kind!r}: {NO_TF2_MSGS}")
    if kind not in known:
        raise ParameterError(f"parameter {key}.type is {kind!r}: {' or '.join(known)}")
    joint = ""
    if known[kind] in (JointTrajectory, JointState) and Float64 in types:
        joint = declare_value(node, f"{key}.joint", Parameter.Type.STRING, "name of its joint")
    reliability = declare_optional_text(
        node, f"{key}.reliability", f"reliable or best_effort: {meaning}"
    )
    qos = _declare_qos(node, key, meaning, reliability or "reliable")
    return Topic(name, known[kind], qos, joint, follows=not reliability)


def _declare_qos(node: Node, key: str, meaning: str, reliability: str) -> QoSProfile:
    depth = declare_value(node, f"{key}.depth", Parameter.Type.INTEGER, f"history: {meaning}")
    if reliability not in _RELIABILITY:
        raise ParameterError(
            f"parameter {key}.reliability is {reliability!r}: reliable or best_effort"
        )
    durability = _declared(
        node, f"{key}.durability", Parameter.Type.STRING, f"volatile or transient_local: {meaning}"
    )
    if (durability or "volatile") not in _DURABILITY:
        raise ParameterError(
            f"parameter {key}.durability is {durability!r}: volatile or transient_local"
        )
    if depth < 1:
        raise ParameterError(f"parameter {key}.depth is {depth}: at least 1")
    return QoSProfile(  # type: ignore[no-untyped-call]
        depth=depth,
        reliability=_RELIABILITY[reliability],
        durability=_DURABILITY[durability or "volatile"],
    )


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
