"""`rover-nxt` on ROS: parameters, topics and diagnostics, and the process from start to signal."""

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from math import inf
from pathlib import Path
from typing import Final

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import Odometry as OdometryMessage
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from sensor_msgs.msg import BatteryState
from std_msgs.msg import Float64, String
from usb.backend import IBackend

from adapters.mocup.brick.record import BrickRecord, BrickRecordError, Link
from adapters.mocup.brick.router import RESTARTED, Router
from adapters.mocup.brick.usb import Brick, BrickSession, Found, Heard, Lost, UsbAddress
from adapters.mops import Message, MopsError, facts_of, load_dictionary
from adapters.process import StartError, Termination, exclusive
from adapters.ros import (
    ParameterError,
    Topic,
    Topics,
    battery_message,
    declare_topic,
    declare_topics,
    declare_value,
    diagnostic_array,
    odometry_message,
    ros_node,
    single_threaded,
    stamp_s,
    steady_timer,
    subscribers_of,
)
from executive.state import Battery, CameraAngles, Odometry

NODE_NAME: Final = "nxt"
HEALTH_S: Final = 1.0
_LOG: Final = logging.getLogger(__name__)
HIGHEST_PERIOD_S: Final = 3600.0
_USB: Final = {
    "vendor_id": ("the brick's vendor id", 0xFFFF),
    "product_id": ("the brick's product id", 0xFFFF),
    "interface": ("number of the interface that is claimed", 0xFF),
    "endpoint_out": ("address of the bulk endpoint to the brick", 0x7F),
    "endpoint_in": ("address of the bulk endpoint from the brick", 0xFF),
}


@dataclass(frozen=True, slots=True)
class NxtSettings:
    """What `config/mocup.nxt.yaml` says.

    Attributes:
        brick: its name in messages.
        address: where it is on USB.
        commands, notifications: topics of each link.
        relay_telemetry_s: how often telemetry goes to the relay at most.
    """

    brick: str
    address: UsbAddress
    commands: Mapping[Link, Topic]
    notifications: Mapping[Link, Topic]
    relay_telemetry_s: float


def declare_settings(node: Node) -> NxtSettings:
    """Declare and read the parameters.

    Raises:
        ParameterError: one is missing or wrong.
    """
    numbers = {key: _number(node, key) for key in _USB}
    return NxtSettings(
        declare_value(node, "brick", Parameter.Type.STRING, "the brick's name in messages"),
        UsbAddress(**numbers),
        {link: _strings(node, link, "command") for link in Link},
        {link: _strings(node, link, "notification") for link in Link},
        _period_s(node),
    )


def _number(node: Node, key: str) -> int:
    meaning, highest = _USB[key]
    name = f"usb.{key}"
    value = int(declare_value(node, name, Parameter.Type.INTEGER, meaning))
    if not 0 <= value <= highest:
        raise ParameterError(f"parameter {name} is {value:#x}: 0 to {highest:#x}")
    return value


def _period_s(node: Node) -> float:
    name = "relay_telemetry_s"
    meaning = "how often telemetry goes to the relay at most, s"
    value = float(declare_value(node, name, Parameter.Type.DOUBLE, meaning))
    if not 0.0 <= value <= HIGHEST_PERIOD_S:
        raise ParameterError(f"parameter {name} is {value}: 0 to {HIGHEST_PERIOD_S:g} s")
    return value


def _strings(node: Node, link: Link, what: str) -> Topic:
    meaning = f"std_msgs/String, MOPS {what}s of the {link.value} link"
    return declare_topic(node, f"{link.value}_{what}", meaning)


class NxtNode:
    """Serves one brick. The router's ports are its publishers and the session.

    Args:
        node: publishes and subscribes.
        topics: where measurements go.
        settings: the brick's name, the topics of strings.
        record: what was asked before; what the brick still owed then is told as failed.
        claim: finds and claims the brick.
    """

    def __init__(
        self,
        node: Node,
        topics: Topics,
        settings: NxtSettings,
        record: BrickRecord,
        claim: Callable[[], Brick],
    ) -> None:
        self._node = node
        self._settings = settings
        spelling = load_dictionary().spelling
        self._telemetry = spelling.telemetry
        self._router = Router(spelling, settings.brick, self, self._refused, record)
        self._refused_since = 0
        self._why = "no brick yet"
        self._odometry = self._publisher(OdometryMessage, topics.odometry)
        self._battery = self._publisher(BatteryState, topics.battery)
        self._pan = self._publisher(Float64, topics.camera_pan_state)
        self._tilt = self._publisher(Float64, topics.camera_tilt_state)
        self._relay_telemetry_s = -inf
        self._notifications = {
            link: self._publisher(String, topic) for link, topic in settings.notifications.items()
        }
        self._listeners: dict[Link, frozenset[bytes]] = dict.fromkeys(Link, frozenset())
        self._commands = {
            link: node.create_subscription(String, topic.name, self._taker(link), topic.qos)
            for link, topic in settings.commands.items()
        }
        self._diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics", 1)
        steady_timer(node, HEALTH_S, self._look_around)
        self._router.lost(RESTARTED)
        woken = node.create_guard_condition(self._drain)
        self._session = BrickSession(claim, woken.trigger)
        self._session.start()

    def close(self) -> None:
        """Release the brick."""
        self._session.close()

    def to_brick(self, octets: bytes, visit: int | None) -> bool:
        """Hand octets to the session."""
        return self._session.send(octets, visit)

    def notify(self, link: Link, message: Message) -> None:
        """Publish a notification on a link's topic."""
        self._notifications[link].publish(String(data=str(message)))

    def telemetry(self, message: Message) -> None:
        """Publish what telemetry measures on a rover's topics, and it whole to the relay."""
        now_s = time.monotonic()
        if now_s - self._relay_telemetry_s >= self._settings.relay_telemetry_s:
            self._relay_telemetry_s = now_s
            self.notify(Link.RELAY, message)
        stamp = self._node.get_clock().now().to_msg()
        try:
            for fact in facts_of(message, self._telemetry, stamp_s(stamp)):
                self._publish(fact, stamp_s(stamp))
        except MopsError as error:
            self._refused(f"telemetry {message}: {error}")

    def _publish(self, fact: Odometry | Battery | CameraAngles, time_s: float) -> None:
        match fact:
            case Odometry():
                self._odometry.publish(odometry_message(fact))
            case Battery():
                self._battery.publish(battery_message(fact, time_s))
            case CameraAngles(pan_rad, tilt_rad):
                self._pan.publish(Float64(data=pan_rad))
                self._tilt.publish(Float64(data=tilt_rad))

    def _publisher(self, kind: type, topic: Topic) -> Publisher:
        return self._node.create_publisher(kind, topic.name, topic.qos)

    def _taker(self, link: Link) -> Callable[[String], None]:
        return lambda message: self._router.command(link, message.data)

    def _drain(self) -> None:
        for event in self._session.events():
            match event:
                case Heard(octets):
                    self._router.heard(octets)
                case Found(visit):
                    self._why = ""
                    self._router.found(visit)
                case Lost(why):
                    self._why = why
                    self._router.lost()

    def _look_around(self) -> None:
        self._router.look()
        self._diagnose()
        for link, publisher in self._notifications.items():
            found = subscribers_of(self._node, publisher)
            if found - self._listeners[link]:
                self._router.resend_last(link)
            self._listeners[link] = found
        if self._commands[Link.DIRECT].get_publisher_count() == 0:
            self._router.executive_gone()

    def _diagnose(self) -> None:
        """Publish one status: ERROR without the brick, WARN where messages were refused."""
        if not self._session.connected:
            level, text = DiagnosticStatus.ERROR, f"the brick is not there: {self._why}"
        elif self._refused_since:
            level, text = DiagnosticStatus.WARN, "messages were refused"
        else:
            level, text = DiagnosticStatus.OK, "the brick is there"
        name = f"{self._node.get_fully_qualified_name()}: brick"
        values = {"USB": self._settings.address, **asdict(self._router.counts)}
        stamp = self._node.get_clock().now().to_msg()
        self._diagnostics.publish(
            diagnostic_array(name, self._settings.brick, level, text, values, stamp)
        )
        self._refused_since = 0

    def _refused(self, line: str) -> None:
        if self._refused_since == 0:
            _LOG.warning("message refused: %s", line)
        self._refused_since += 1


def serve(
    asset: str,
    topics_file: Path,
    brick_file: Path,
    data: Path,
    ros_arguments: Sequence[str],
    backend: IBackend,
) -> None:
    """Serve until SIGINT or SIGTERM; the brick is released on any way out.

    Args:
        asset: namespace of the rover.
        topics_file: ROS parameter file of the rover's topics.
        brick_file: ROS parameter file of the brick.
        data: folder of the record.
        ros_arguments: what goes to ROS as it is.
        backend: what speaks USB.

    Raises:
        adapters.ros.parameters.ParameterError: a ROS parameter or argument makes no sense.
        executive.settings.SettingsError: the MOPS dictionary does not fit.
        StartError: the folder or the record cannot be used.
    """
    asked = Termination()
    try:
        with (
            exclusive(data, "nxt.lock"),
            closing(BrickRecord(data / "nxt.sqlite")) as record,
            ros_node(
                NODE_NAME,
                asset,
                parameters=topics_file,
                ros_arguments=("--params-file", str(brick_file), *ros_arguments),
            ) as node,
            single_threaded(node) as executor,
        ):
            topics, settings = declare_topics(node), declare_settings(node)
            address = settings.address
            served = NxtNode(node, topics, settings, record, lambda: Brick(address, backend))
            with closing(served):
                print(f"{settings.brick} is served for {asset}, USB {address}", flush=True)
                while not asked.requested:
                    executor.spin_once()
                _LOG.info("asked to end: the brick is released")
    except BrickRecordError as error:
        raise StartError(str(error)) from error
