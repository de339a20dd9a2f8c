"""`write_bag` exports a recording as a rosbag2 folder, with the ROS topics of such a rover."""

import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from heapq import merge
from pathlib import Path
from typing import Any, Final, get_args

from geometry_msgs.msg import TransformStamped
from rcl_interfaces.msg import Log
from rclpy.node import Node
from rclpy.serialization import serialize_message
from sensor_msgs.msg import BatteryState
from std_msgs.msg import Float64, String

from adapters.recording import RecordedMoments, RecordingError, RunReader, read_timed
from adapters.ros.context import ros_node
from adapters.ros.conversions import (
    ODOM,
    battery_message,
    odometry_message,
    time_message,
    velocity_message,
)
from adapters.ros.parameters import Topic, declare_topics
from adapters.ros.robot_model import (
    ROBOT_DESCRIPTION,
    TF,
    TF_STATIC,
    base_transform,
    camera_transforms,
    static_transforms,
    urdf,
)
from adapters.ros.sensors import declare_sensor_topics, sensor_message
from adapters.ros.tree_topic import TREE_TOPIC, to_json
from executive.core.recording import (
    FactObserved,
    Item,
    ProcessStart,
    ReportSent,
    Truth,
    VelocityCommanded,
)
from executive.settings import Settings, ros_parameter_file
from executive.values.facts import (
    Battery,
    CameraAngles,
    Fact,
    Odometry,
    SensorFact,
)
from executive.values.geometry import Velocity
from executive.values.reports import Report, Severity
from trees import TreeSnapshot

NODE_NAME: Final = "executive"
MAX_UTC_S: Final = 2**63 / 1e9
"""Upper bound of stamps: a bag has nanoseconds since 1970 in 63 bits."""
VERSION: Final = 9
"""Version of the bag's metadata: that of ROS 2 Jazzy."""
ROSOUT: Final = "/rosout"
TF_TYPE: Final = "tf2_msgs/msg/TFMessage"
LEVELS: Final = {
    Severity.INFORMATIONAL: Log.INFO,
    Severity.WARNING: Log.WARN,
    Severity.ALARM: Log.ERROR,
    Severity.SEVERE: Log.ERROR,
    Severity.CRITICAL: Log.FATAL,
}
_FACTS: Final = {Battery, CameraAngles, Odometry, *get_args(SensorFact)}


@dataclass(frozen=True, slots=True)
class BagMessage:
    """A message for a bag.

    Attributes:
        utc_s: time of reception or publication, s UTC.
        type: ROS type, such as nav_msgs/msg/Odometry.
        cdr: serialized message.
    """

    utc_s: float
    topic: str
    type: str
    cdr: bytes


def write_bag(recording: Path, folder: Path) -> dict[str, int]:
    """Write a recording as a rosbag2 folder, and return the number of messages of each topic.

    Topic names are taken from the ROS parameters of the asset in `config/`.

    Args:
        recording: path of the recording.
        folder: folder to create; must not exist.

    Raises:
        RecordingError: the file is not a valid recording.
        SettingsError: the parameters of the asset lack a topic.
        OSError: the folder cannot be written.
    """
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    recorded = RecordedMoments(recording)
    settings = _settings_of(recording)
    store = get_typestore(Stores.ROS2_JAZZY)
    parameters = ros_parameter_file(settings.asset)
    with ros_node(NODE_NAME, settings.asset, parameters=parameters) as node:
        converter = _Converter(node, settings, store)
    latched = _latched_qos()
    counts: dict[str, int] = {}
    with Writer(folder, version=VERSION, storage_plugin=StoragePlugin.MCAP) as bag:
        connections: dict[str, Any] = {}
        for each in _merged(converter, recording, recorded):
            if each.topic not in connections:
                connections[each.topic] = bag.add_connection(
                    each.topic,
                    each.type,
                    typestore=store,
                    offered_qos_profiles=[latched]
                    if each.topic in converter.latched_topics
                    else [],
                )
            bag.write(connections[each.topic], round(each.utc_s * 1e9), each.cdr)
            counts[each.topic] = counts.get(each.topic, 0) + 1
    return counts


def _merged(
    converter: "_Converter", recording: Path, recorded: RecordedMoments
) -> Iterator[BagMessage]:
    items, trees = converter.items(recording), converter.trees(recorded)
    try:
        for stamped in merge(items, trees, key=lambda stamped: stamped.utc_s):
            if not 0.0 <= stamped.utc_s < MAX_UTC_S:
                raise ValueError(f"time {stamped.utc_s:g} s since 1970")
            yield stamped
    except (AssertionError, OverflowError, TypeError, ValueError, struct.error) as error:
        text = f"{recording}: has a value that no ROS message can hold: {error!r}"
        raise RecordingError(text) from error


def _latched_qos() -> Any:
    """Return the quality of service of latched topics: late subscribers get the last message."""
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    unbounded = QosTime(2**31 - 1, 10**9 - 1)
    return Qos(
        QosHistory.KEEP_LAST,
        1,
        QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL,
        deadline=unbounded,
        lifespan=unbounded,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=unbounded,
        avoid_ros_namespace_conventions=False,
    )


def _settings_of(recording: Path) -> Settings:
    for timed in read_timed(RunReader(recording), ()):
        if isinstance(timed.item, ProcessStart):
            return timed.item.settings
    raise RecordingError(f"{recording}: the start is missing: no record on /start")


class _Converter:
    """Converts items of a recording to the ROS messages of such a rover.

    Args:
        node: resolves topic names.
        store: serializes message types that the PyPI wheels lack.

    Attributes:
        latched_topics: latched topics, with the last message for late subscribers.
    """

    def __init__(self, node: Node, settings: Settings, store: Any) -> None:
        def full(topic: Topic | None) -> str:
            return "" if topic is None else str(node.resolve_topic_name(topic.name))

        topics, sensors = declare_topics(node), declare_sensor_topics(node, settings.sensors)
        self._joints, self._mounting = sensors.joints, sensors.mounting
        self._sensors = {sensor: full(topic) for sensor, topic in sensors.topics.items()}
        self._odometry, self._battery = full(topics.odometry), full(topics.battery)
        self._pan, self._tilt = full(topics.camera_pan_state), full(topics.camera_tilt_state)
        self._cmd_vel, self._truth = full(topics.cmd_vel), full(topics.ground_truth)
        self._cmd_vel_type = topics.cmd_vel.type
        self._battery_type = topics.battery.type if topics.battery else BatteryState
        self._description = str(node.resolve_topic_name(ROBOT_DESCRIPTION))
        self._urdf = urdf(settings)
        self._tree = str(node.resolve_topic_name(TREE_TOPIC))
        self.latched_topics = {self._description, self._tree, TF_STATIC}
        self._name = node.get_fully_qualified_name()
        self._store = store

    def items(self, recording: Path) -> Iterator[BagMessage]:
        """Yield a message for each fact, velocity, report and ground truth, and the frames.

        Camera angles have no stamp: their frames get that of the last odometry.
        """
        stamp_s: float | None = None
        for timed in read_timed(
            RunReader(recording), {*_FACTS, VelocityCommanded, ReportSent, Truth}
        ):
            for topic, message in self._messages(timed.item, timed.utc_s):
                if topic:
                    yield _stamped(timed.utc_s, topic, message)
            match timed.item:
                case ProcessStart():
                    yield _stamped(timed.utc_s, self._description, String(data=self._urdf))
                    yield self._frames(timed.utc_s, TF_STATIC, static_transforms(0.0))
                case FactObserved(fact=Odometry() as fact):
                    stamp_s = fact.stamp_s
                    yield self._frames(timed.utc_s, TF, [base_transform(fact)])
                case FactObserved(fact=CameraAngles() as fact) if stamp_s is not None:
                    yield self._frames(timed.utc_s, TF, camera_transforms(fact, stamp_s))
                case _:
                    pass

    def trees(self, recorded: RecordedMoments) -> Iterator[BagMessage]:
        """Yield a message for each tick that changed the tree or the mode."""
        sent: TreeSnapshot | None = None
        for moment in recorded.moments:
            now = moment.snapshot
            if sent is None or (sent.nodes, sent.mode, sent.why) != (now.nodes, now.mode, now.why):
                sent = now
                yield _stamped(now.utc_s, self._tree, String(data=to_json(now)))

    def _messages(self, item: Item, utc_s: float) -> Iterator[tuple[str, object]]:
        match item:
            case FactObserved(fact=fact):
                yield from self._of_fact(fact, utc_s)
            case VelocityCommanded(velocity=velocity):
                message = velocity_message(velocity, self._cmd_vel_type, time_message(utc_s))
                yield self._cmd_vel, message
            case ReportSent(report=report):
                yield ROSOUT, _log(report, self._name)
            case Truth(pose=pose):
                yield self._truth, odometry_message(Odometry(utc_s, pose, Velocity()))
            case _:
                pass

    def _of_fact(self, fact: Fact, utc_s: float) -> Iterator[tuple[str, object]]:
        match fact:
            case Odometry():
                yield self._odometry, odometry_message(fact)
            case Battery():
                yield self._battery, battery_message(fact, utc_s, self._battery_type)
            case CameraAngles(pan_rad, tilt_rad):
                yield self._pan, Float64(data=pan_rad)
                yield self._tilt, Float64(data=tilt_rad)
            case _ if isinstance(fact, SensorFact):
                sensor, message = sensor_message(fact, self._joints, ODOM, self._mounting)
                yield self._sensors[sensor], message
            case _:
                pass

    def _frames(
        self, utc_s: float, topic: str, transforms: Iterable[TransformStamped]
    ) -> BagMessage:
        """Return a message of tf2_msgs, a package that the PyPI wheels lack."""
        types = self._store.types
        made = []
        for each in transforms:
            stamp, moved = each.header.stamp, each.transform
            position, turned = moved.translation, moved.rotation
            transform = types["geometry_msgs/msg/Transform"](
                types["geometry_msgs/msg/Vector3"](position.x, position.y, position.z),
                types["geometry_msgs/msg/Quaternion"](turned.x, turned.y, turned.z, turned.w),
            )
            time = types["builtin_interfaces/msg/Time"](stamp.sec, stamp.nanosec)
            header = types["std_msgs/msg/Header"](time, each.header.frame_id)
            stamped = types["geometry_msgs/msg/TransformStamped"]
            made.append(stamped(header, each.child_frame_id, transform))
        cdr = bytes(self._store.serialize_cdr(types[TF_TYPE](made), TF_TYPE))
        return BagMessage(utc_s, topic, TF_TYPE, cdr)


def _stamped(utc_s: float, topic: str, message: object) -> BagMessage:
    kind = type(message)
    package = kind.__module__.partition(".")[0]
    return BagMessage(utc_s, topic, f"{package}/msg/{kind.__name__}", serialize_message(message))


def _log(report: Report, name: str) -> Log:
    parts = (report.identity, report.stage and report.stage.name, report.text)
    return Log(
        stamp=time_message(report.utc_s),
        level=LEVELS[report.severity],
        name=name,
        msg=" ".join(str(each) for each in parts if each),
    )
