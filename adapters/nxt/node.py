"""Wires the router to ROS and to the brick's session: all of it on the thread that spins."""

import logging
from collections.abc import Callable
from typing import Final

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry as OdometryMessage
from rclpy.clock import Clock as NodeClock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import BatteryState
from std_msgs.msg import Float64, String

from adapters.mops.dictionary import Dictionary
from adapters.mops.message import Message, MopsError
from adapters.mops.telemetry import facts_of
from adapters.nxt.brick import Brick
from adapters.nxt.diagnostics import Health, diagnose
from adapters.nxt.record import Link, Record
from adapters.nxt.router import RESTARTED, Router
from adapters.nxt.session import BrickSession, Found, Heard, Lost
from adapters.nxt.settings import NxtSettings
from adapters.ros.conversions import battery_message, odometry_message, stamp_s
from adapters.ros.parameters import Topic, Topics
from executive.facts import Battery, CameraAngles, Odometry

HEALTH_S: Final = 1.0
_LOG: Final = logging.getLogger(__name__)


class NxtNode:
    """Serves one brick. The router's exits are its publishers and the session.

    Args:
        node: publishes and subscribes.
        topics: where measurements go.
        settings: the brick's name, the topics of strings.
        dictionary: how telemetry is spelled.
        claim: finds and claims the brick.
        record: what was asked before; what the brick still owed then is told as failed.
    """

    def __init__(
        self,
        node: Node,
        topics: Topics,
        settings: NxtSettings,
        dictionary: Dictionary,
        claim: Callable[[], Brick],
        record: Record,
    ) -> None:
        """Subscribe, and begin to look for the brick."""
        self._node = node
        self._settings = settings
        self._telemetry = dictionary.spelling.telemetry
        self._router = Router(dictionary.spelling, settings.brick, self, self._refused, record)
        self._refused_since = 0
        self._why = "no brick yet"
        self._odometry = self._publisher(OdometryMessage, topics.odometry)
        self._battery = self._publisher(BatteryState, topics.battery)
        self._pan = self._publisher(Float64, topics.camera_pan_state)
        self._tilt = self._publisher(Float64, topics.camera_tilt_state)
        self._relay_telemetry_ns: int | None = None
        self._notifications = {
            link: self._publisher(String, topic) for link, topic in settings.notifications.items()
        }
        self._listeners: dict[Link, frozenset[bytes]] = dict.fromkeys(Link, frozenset())
        self._commands = {
            link: node.create_subscription(String, topic.name, self._taker(link), topic.qos)
            for link, topic in settings.commands.items()
        }
        self._diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics", 1)
        self._steady = NodeClock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(HEALTH_S, self._look_around, clock=self._steady)
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
        now_ns = self._steady.now().nanoseconds
        last_ns, period_ns = self._relay_telemetry_ns, self._settings.relay_telemetry_s * 1e9
        if last_ns is None or now_ns - last_ns >= period_ns:
            self._relay_telemetry_ns = now_ns
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
        self._diagnostics.publish(
            diagnose(
                Health(
                    self._settings.brick,
                    str(self._settings.address),
                    self._session.connected,
                    self._why,
                    self._refused_since,
                ),
                self._router.counts,
                self._node.get_fully_qualified_name(),
                self._node.get_clock().now().to_msg(),
            )
        )
        self._refused_since = 0
        for link, publisher in self._notifications.items():
            infos = self._node.get_subscriptions_info_by_topic(publisher.topic_name)
            found = frozenset(bytes(info.endpoint_gid) for info in infos)
            if found - self._listeners[link]:
                self._router.again(link)
            self._listeners[link] = found
        if self._commands[Link.DIRECT].get_publisher_count() == 0:
            self._router.deserted()

    def _refused(self, line: str) -> None:
        if self._refused_since == 0:
            _LOG.warning("message refused: %s", line)
        self._refused_since += 1
