"""`survey_robot` searches the ROS graph for a robot: the topics that the executive needs."""

import re
import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise
from statistics import median
from typing import Any, Final, NamedTuple

from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import BatteryState, CompressedImage, Image, Imu, JointState, LaserScan
from std_msgs.msg import Bool, Float32

from adapters.ros.context import ros_node, single_threaded, steady_timer
from adapters.ros.conversions import MessageError, frame_fact, odometry_fact, stamp_s
from adapters.ros.parameters import type_name
from adapters.ros.rover import NAME_UNKNOWN
from adapters.ros.sensors import WheelJoints, imu_fact, joints_fact
from executive.values.reports import printable

POLL_S: Final = 0.25
DEPTH: Final = 10
RELIABLE, VOLATILE = ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE
MAX_LEAN_RAD: Final = 0.2
"""Lean above which the IMU of a robot on level ground is not mounted as base_link."""
MIN_VOLTAGE_V: Final = 2.0
VELOCITY: Final = "cmd_vel"
_NEVER: Final = "$^"
_LEFT, _RIGHT = "left|(^|_)[fmrb]?l(_|$)", "right|(^|_)[fmrb]?r(_|$)"
_REAR: Final = "rear|back|(^|_)[rb][lr](_|$)"


class _Kind(NamedTuple):
    """Types, and patterns of names: of preferred topics, and of less preferred ones."""

    types: tuple[type, ...]
    preferred: str = _NEVER
    avoided: str = _NEVER


_KINDS: Final = {
    "odometry": _Kind(
        (Odometry,), "filtered|ekf|fused", "truth|gps|gnss|visual|vio|laser|lidar|map|global|second"
    ),
    "imu": _Kind((Imu,), avoided="raw|camera|oakd|realsense"),
    "joints": _Kind((JointState,), avoided="command|target|desired|camera"),
    "laser": _Kind((LaserScan,)),
    "battery": _Kind((BatteryState, Float32)),
    "camera": _Kind((CompressedImage, Image), "color|rgb", "depth|infra|/ir/"),
    "emergency_stop": _Kind((Bool,)),
    VELOCITY: _Kind((TwistStamped, Twist), "/cmd_vel$"),
}
_NAMES: Final = {Float32: "batt|volt", Bool: "(^|[/_])e_?stop|emergency"}
"""What topics of these general types are called."""
_TYPES: Final = {
    type_name(each): (key, each) for key, kind in _KINDS.items() for each in kind.types
}


class SurveyError(ValueError):
    """No robot was found, or more than one; the text is for the user."""


@dataclass(eq=False)
class FoundTopic:
    """A topic with the last message received on it.

    Attributes:
        key: in the parameter file.
        others: names of the topics of its kind that were not chosen.
    """

    key: str
    name: str
    type: type
    qos: QoSProfile
    last: Any = None
    others: tuple[str, ...] = ()
    _stamps_s: list[float] = field(default_factory=list)

    def take(self, message: Any) -> None:
        """Store a message."""
        self.last = message
        if hasattr(message, "header"):
            self._stamps_s.append(stamp_s(message.header.stamp))

    @property
    def rate_hz(self) -> float | None:
        """Rate of the stamps; None if messages have none, or too few arrived."""
        periods_s = [after - before for before, after in pairwise(self._stamps_s)]
        period_s = median(periods_s) if periods_s else 0.0
        return 1 / period_s if period_s > 0.0 else None

    @property
    def problem(self) -> str:
        """Why its messages cannot be used; empty if they can."""
        if self.key in (VELOCITY, "emergency_stop"):
            return ""
        try:
            return "no message arrived" if self.last is None else printable(_problem(self.last))
        except (MessageError, ImportError) as error:
            return printable(str(error))

    @property
    def rank(self) -> tuple[object, ...]:
        """Sorts the best topic of its kind to the front."""
        kind, name = _KINDS[self.key], self.name.lower()
        avoided, preferred = (
            bool(re.search(each, name)) for each in (kind.avoided, kind.preferred)
        )
        order = kind.types.index(self.type)
        return avoided, bool(self.problem), not preferred, name.count("/"), order, name


@dataclass(frozen=True, slots=True)
class FoundRobot:
    """A robot as it was found: the chosen topics, by their keys in the parameter file."""

    namespace: str
    simulated_time: bool
    topics: dict[str, FoundTopic]


def survey_robot(namespace: str | None, seconds: float) -> FoundRobot:
    """Listen to the ROS graph for a time of this machine's clock, and return the robot in it.

    Args:
        namespace: of the robot, with a leading slash; None if there is only one.
        seconds: time of listening.

    Raises:
        SurveyError: there is none, or more than one.
    """
    found: dict[str, FoundTopic] = {}
    driven: set[str] = set()
    with ros_node("robot_survey", "") as node, single_threaded(node) as executor:
        steady_timer(node, POLL_S, lambda: _poll(node, found, driven))
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s:
            executor.spin_once(timeout_sec=POLL_S)
        simulated_time = node.count_publishers("/clock") > 0
    if namespace is None and len(driven) > 1:
        raise SurveyError(
            f"nodes in several namespaces take velocities, {', '.join(sorted(driven))}: choose the"
            " robot's by --namespace"
        )
    namespace = namespace or next(iter(driven), "/")
    foreign = [each for each in driven if not _inside(namespace, each)]
    ours = [
        each
        for each in found.values()
        if _inside(each.name, namespace) and not any(_inside(each.name, one) for one in foreign)
    ]
    return FoundRobot(namespace, simulated_time, _chosen(ours, namespace))


def _poll(node: Node, found: dict[str, FoundTopic], driven: set[str]) -> None:
    """Subscribe to topics that are new, and find the namespaces of nodes that take velocities."""
    for name, types in node.get_topic_names_and_types():
        for type_text in set(types) & _TYPES.keys() if name not in found else ():
            key, kind = _TYPES[type_text]
            ends = (
                node.get_subscriptions_info_by_topic(name)
                if key == VELOCITY
                else node.get_publishers_info_by_topic(name)
            )
            ends = [each for each in ends if each.topic_type == type_text]
            known = all(each.node_name != NAME_UNKNOWN for each in ends)
            if not ends or not known or not re.search(_NAMES.get(kind, ""), name.lower()):
                continue
            if key == VELOCITY:
                found[name] = FoundTopic(key, name, kind, _matching([]))
                for each in ends:
                    first = f"/{each.node_namespace.split('/')[1]}"
                    driven.add(first if _inside(name, first) else "/")
            else:
                qos = _matching([each.qos_profile for each in ends])
                found[name] = FoundTopic(key, name, kind, qos)
                node.create_subscription(kind, name, found[name].take, qos)
            break  # a node takes one type for each topic


def _chosen(found: Iterable[FoundTopic], namespace: str) -> dict[str, FoundTopic]:
    """Return the best topic of each kind.

    Raises:
        SurveyError: there is no odometry, or no topic for velocities.
    """
    chosen: dict[str, FoundTopic] = {}
    for each in sorted(found, key=lambda each: each.rank):
        best = chosen.setdefault(each.key, each)
        if best is not each:
            best.others += (each.name,)
    needed = {
        "odometry": "no node publishes nav_msgs/Odometry",
        VELOCITY: "no node subscribes to Twist or TwistStamped",
    }
    if lacking := [text for key, text in needed.items() if key not in chosen]:
        raise SurveyError(
            f"no robot in namespace {namespace}: {' and '.join(lacking)}; does `ros2 topic list`"
            " show it with this ROS_DOMAIN_ID and ROS_AUTOMATIC_DISCOVERY_RANGE? Without the"
            " robot, use --like or --minimal"
        )
    return {key: chosen[key] for key in _KINDS if key in chosen}


def _matching(offered: list[QoSProfile]) -> QoSProfile:
    """Return the strictest quality of service that all publishers offer: the maximum values."""
    return QoSProfile(  # type: ignore[no-untyped-call]
        depth=DEPTH,
        reliability=max((each.reliability for each in offered), default=RELIABLE),
        durability=max((each.durability for each in offered), default=VOLATILE),
    )


def _inside(name: str, namespace: str) -> bool:
    return f"{name}/".startswith(f"{namespace.rstrip('/')}/")


def _problem(message: Any) -> str:
    match message:
        case Odometry():
            odometry_fact(message)
        case Imu():
            fact = imu_fact(message)
            if message.orientation.w == 1.0 and not any(message.orientation_covariance):
                return "its orientation is (0, 0, 0, 1) without covariance, as if not measured"
            lean_rad = max(abs(fact.roll_rad), abs(fact.pitch_rad))
            if lean_rad > MAX_LEAN_RAD:
                return f"it leans by {lean_rad:.2f} rad: it needs a mounting (rover robot check)"
        case JointState():
            wheels = wheels_of(message)
            if not (wheels.left and wheels.right):
                return f"no names of wheels on both sides: {', '.join(message.name)}"
            joints_fact(message, wheels)
        case BatteryState() | Float32() if voltage_v(message) < MIN_VOLTAGE_V:
            return "it reports no voltage"
        case CompressedImage() | Image():
            frame_fact(message)
        case _:
            pass
    return ""


def wheels_of(message: JointState) -> WheelJoints:
    """Return the joints that are named as wheels, by side, front first."""
    wheels = [each for each in message.name if "wheel" in each.lower()]
    wheels.sort(key=lambda each: bool(re.search(_REAR, each.lower())))
    left, right = (
        tuple(each for each in wheels if re.search(side, each.lower())) for side in (_LEFT, _RIGHT)
    )
    return WheelJoints(left, right)


def voltage_v(message: BatteryState | Float32) -> float:
    """Return the voltage of a battery, V."""
    return float(message.data if isinstance(message, Float32) else message.voltage)
