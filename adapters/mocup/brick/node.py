"""`NxtNode`, the ROS node of `rover-nxt`: its parameters, topics and diagnostics."""

import logging
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from math import inf
from typing import Final

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from std_msgs.msg import Float64, String, UInt64

from adapters.mocup.brick.ownership import HEARTBEAT_TIMEOUT_S
from adapters.mocup.brick.record import BrickLink, BrickRecord
from adapters.mocup.brick.router import SOURCE, Router
from adapters.mocup.brick.service import MAX_INBOX, BrickService, DurableOutput
from adapters.mocup.brick.usb import (
    KEEP_ALIVE_S,
    Brick,
    BrickSession,
    UsbAddress,
)
from adapters.mops import (
    Housekeeping,
    Message,
    MopsError,
    RelayAuthority,
    Spelling,
    encode,
    facts_of,
    housekeeping_message,
    load_dictionary,
)
from adapters.ros import (
    HeartbeatMonitor,
    ParameterError,
    Topic,
    Topics,
    battery_message,
    declare_optional_topic,
    declare_topic,
    declare_value,
    diagnostic_array,
    odometry_message,
    stamp_s,
    steady_timer,
    subscribers_of,
    watch,
)
from executive.values.clock import SystemClock
from executive.values.facts import Battery, CameraAngles, Odometry

NODE_NAME: Final = "nxt"
HEALTH_S: Final = 1.0
HOUSEKEEPING_S: Final = {BrickLink.DIRECT: 5.0, BrickLink.RELAY: 30.0}
"""Period of the housekeeping of this process; longer for the relay, because its link is narrow."""
_LOG: Final = logging.getLogger(__name__)
MAX_PERIOD_S: Final = 3600.0
_TAKEN: Final = "fingerprint of an accepted string"
_USB: Final = {
    "vendor_id": ("the brick's vendor id", 0xFFFF),
    "product_id": ("the brick's product id", 0xFFFF),
    "interface": ("number of the interface that is claimed", 0xFF),
    "endpoint_out": ("address of the bulk endpoint to the brick", 0x7F),
    "endpoint_in": ("address of the bulk endpoint from the brick", 0xFF),
}


@dataclass(frozen=True, slots=True)
class NxtSettings:
    """Content of `config/mocup.nxt.yaml`.

    Attributes:
        brick: name of the brick in messages.
        address: its USB address.
        commands, notifications: topics of each link.
        stops: topic of the relay's stops, which overtake its commands.
        acknowledgements: topic of each link for the acknowledgement of its strings.
        confirmations: topic on which `rover-relay` acknowledges replies; None without.
        relay_telemetry_s: minimum period of telemetry to the relay, s.
        relay_needs_authority: whether the relay's commands need the authority until an executive
            has published it.
    """

    brick: str
    address: UsbAddress
    commands: Mapping[BrickLink, Topic]
    notifications: Mapping[BrickLink, Topic]
    stops: Topic
    acknowledgements: Mapping[BrickLink, Topic]
    confirmations: Topic | None
    relay_telemetry_s: float
    relay_needs_authority: bool


def declare_settings(node: Node) -> NxtSettings:
    """Declare and read the parameters.

    Raises:
        ParameterError: one is missing or invalid.
    """
    numbers = {key: _number(node, key) for key in _USB}
    return NxtSettings(
        declare_value(node, "brick", Parameter.Type.STRING, "name of the brick in messages"),
        UsbAddress(**numbers),
        {link: _strings(node, link, "command") for link in BrickLink},
        {link: _strings(node, link, "notification") for link in BrickLink},
        declare_topic(node, "relay_stop", "MOPS of the relay's stops", String),
        {
            link: declare_topic(node, f"{link.value}_command_ack", _TAKEN, UInt64)
            for link in BrickLink
        },
        declare_optional_topic(
            node,
            "relay_notification_ack",
            "fingerprint of a reply that is stored",
            UInt64,
        ),
        _period_s(node),
        declare_value(
            node,
            "relay_needs_authority",
            Parameter.Type.BOOL,
            "whether the relay's commands need the authority until an executive publishes it",
        ),
    )


def _number(node: Node, key: str) -> int:
    meaning, upper = _USB[key]
    name = f"usb.{key}"
    value = int(declare_value(node, name, Parameter.Type.INTEGER, meaning))
    if not 0 <= value <= upper:
        raise ParameterError(f"parameter {name} is {value:#x}: 0 to {upper:#x}")
    return value


def _period_s(node: Node) -> float:
    name = "relay_telemetry_s"
    meaning = "minimum period of telemetry to the relay, s"
    value = float(declare_value(node, name, Parameter.Type.DOUBLE, meaning))
    if not 0.0 <= value <= MAX_PERIOD_S:
        raise ParameterError(f"parameter {name} is {value}: 0 to {MAX_PERIOD_S:g} s")
    return value


def _strings(node: Node, link: BrickLink, what: str) -> Topic:
    meaning = f"MOPS {what}s of the {link.value} link"
    return declare_topic(node, f"{link.value}_{what}", meaning, String)


def keep_alive(spelling: Spelling, brick: str) -> bytes:
    """Return the heartbeat for the brick, with the timeout that the brick applies to it."""
    entry = spelling.keep_alive
    return encode(Message(entry.code, SOURCE, brick, entry.command, (f"{HEARTBEAT_TIMEOUT_S:g}",)))


class NxtNode:
    """Serves one brick. The router's ports are its publishers and the session.

    Args:
        node: publishes and subscribes.
        settings: name of the brick, topics of the strings.
        record: earlier commands; those that the brick has not answered are reported as failed.
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
        dictionary = load_dictionary()
        spelling = dictionary.spelling
        self._telemetry = spelling.telemetry
        self._housekeeping = spelling.housekeeping
        self._house_s = dict.fromkeys(BrickLink, -inf)
        self._syncer = ThreadPoolExecutor(1, "nxt-sync")
        self._synced = node.create_guard_condition(self._on_synced)
        stop = spelling.commands["stop"]
        self._output = DurableOutput(record, stop, self._put, self._start_sync, self._on_refused)
        self.notify = self._output.put
        authority = RelayAuthority(settings.relay_needs_authority)
        self._router = Router(
            dictionary, settings.brick, self, self._on_refused, record, authority, SystemClock()
        )
        self._refused_since = 0
        self._odometry = self._publisher(topics.odometry)
        self._battery = self._publisher(topics.battery)
        self._pan = self._publisher(topics.camera_pan_state)
        self._tilt = self._publisher(topics.camera_tilt_state)
        self._relay_telemetry_s = -inf
        self._notifications = {
            link: self._publisher(topic) for link, topic in settings.notifications.items()
        }
        self._ack_publisher = {
            link: self._publisher(topic) for link, topic in settings.acknowledgements.items()
        }
        ack = settings.confirmations
        self._service = BrickService(self._router, self._output.put, confirmed=ack is not None)
        if ack is not None:
            confirmed = self._service.on_confirmed
            node.create_subscription(UInt64, ack.name, lambda m: confirmed(m.data), ack.qos)  # type: ignore[attr-defined]
        self._commands = {
            link: node.create_subscription(
                String, topic.name, self._command_callback(link), topic.qos
            )
            for link, topic in settings.commands.items()
        }
        self._inbox_waits = node.create_guard_condition(self._serve_inbox)
        self._commanders = {
            link: HeartbeatMonitor(HEARTBEAT_TIMEOUT_S, partial(self._router.on_host_silent, link))
            for link in BrickLink
        }
        for link, topic in settings.commands.items():
            watch(node, topic, self._commanders[link])
        node.create_subscription(
            String, settings.stops.name, self._command_callback(BrickLink.RELAY), settings.stops.qos
        )
        self._diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics", 1)
        steady_timer(node, HEALTH_S, self._poll)
        self._session: BrickSession
        woken = node.create_guard_condition(lambda: self._service.drain(self._session.events()))
        self._session = BrickSession(claim, woken.trigger, keep_alive(spelling, settings.brick))
        self.stop_brick = self._session.stop
        steady_timer(node, KEEP_ALIVE_S, self._session.feed_watchdog)
        self._session.start()

    def close(self) -> None:
        """Release the brick."""
        self._session.close()
        self._syncer.shutdown()

    def to_brick(self, octets: bytes, visit: int) -> bool:
        """Pass a message to the session, which sends it once its command is on the disk."""
        self._output.sync()
        return self._session.send(octets, visit, self._output.record.sealed)

    def publish_telemetry(self, message: Message) -> None:
        """Publish telemetry on the rover's topics, and the whole message to the relay."""
        now_s = time.monotonic()
        if now_s - self._relay_telemetry_s >= self._settings.relay_telemetry_s:
            self._relay_telemetry_s = now_s
            self._put(BrickLink.RELAY, message)
        stamp = self._node.get_clock().now().to_msg()
        try:
            for fact in facts_of(message, self._telemetry, stamp_s(stamp)):
                self._publish(fact, stamp_s(stamp))
        except MopsError as error:
            self._on_refused(f"telemetry {message}: {error}")

    def _publish(self, fact: Odometry | Battery | CameraAngles, time_s: float) -> None:
        match fact:
            case Odometry():
                self._odometry.publish(odometry_message(fact))
            case Battery():
                self._battery.publish(battery_message(fact, time_s))
            case CameraAngles(pan_rad, tilt_rad):
                self._pan.publish(Float64(data=pan_rad))
                self._tilt.publish(Float64(data=tilt_rad))

    def _publisher(self, topic: Topic | None) -> Publisher:
        if topic is None:
            raise ParameterError("battery, camera_pan_state and camera_tilt_state need a topic")
        return self._node.create_publisher(topic.type, topic.name, topic.qos)

    def _command_callback(self, link: BrickLink) -> Callable[[String], None]:
        def take(message: String) -> None:
            self._on_command(link, message)
            self._serve_inbox()

        return take

    def _on_command(self, link: BrickLink, message: String) -> None:
        if not self._service.inbox.put(link, message.data):
            self._on_refused(f"{link.value} link: {MAX_INBOX} texts are queued")

    def _serve_inbox(self) -> None:
        """Process one received text of either link, a stop first."""
        for link, subscription in self._commands.items():
            waiting = subscription.handle
            with waiting:
                while (taken := waiting.take_message(String, False)) is not None:
                    self._on_command(link, taken[0])
        if (served := self._service.serve()) is not None:
            self._commanders[served].command()
            self._inbox_waits.trigger()  # type: ignore[no-untyped-call]

    def _put(self, link: BrickLink, output: Message | int) -> None:
        if isinstance(output, int):
            self._ack_publisher[link].publish(UInt64(data=output))
        else:
            self._notifications[link].publish(String(data=str(output)))

    def _start_sync(self) -> None:
        self._sync = self._syncer.submit(self._output.record.sync)
        self._sync.add_done_callback(lambda _: self._synced.trigger())  # type: ignore[no-untyped-call]

    def _on_synced(self) -> None:
        self._session.release(self._output.record.durable)
        self._output.on_synced(self._sync.exception())

    def _poll(self) -> None:
        found = {link: subscribers_of(self._node, p) for link, p in self._notifications.items()}
        self._service.poll(found)
        self._output.sync()
        self._diagnose()
        self._publish_housekeeping()

    def _publish_housekeeping(self) -> None:
        """Publish the health figures of this process on both links."""
        now_s, counts = time.monotonic(), self._router.counts
        listeners = self._service.listeners
        due = [link for link in BrickLink if now_s >= self._house_s[link] and listeners[link]]
        self._house_s |= {link: now_s + HOUSEKEEPING_S[link] for link in due}
        figures = {
            "NXT_CONNECTED": float(self._session.connected),
            "NXT_QUEUED": counts.queued,
            "NXT_COMMANDS": counts.commands,
            "NXT_REPEATS": counts.repeats,
            "NXT_REFUSED": counts.refused,
            "NXT_DEAD_MAN": counts.dead_man,
        }
        data = Housekeeping(time.time(), figures)
        for link in due:
            self._put(link, housekeeping_message(data, self._housekeeping, self._settings.brick))

    def _diagnose(self) -> None:
        """Publish one status: ERROR without the brick, WARN if messages were refused."""
        if not self._session.connected:
            level, text = DiagnosticStatus.ERROR, f"no brick connected: {self._service.why}"
        elif self._refused_since:
            level, text = DiagnosticStatus.WARN, "messages were refused"
        else:
            level, text = DiagnosticStatus.OK, "brick connected"
        name = f"{self._node.get_fully_qualified_name()}: brick"
        values = {"USB": self._settings.address, **asdict(self._router.counts)}
        stamp = self._node.get_clock().now().to_msg()
        self._diagnostics.publish(
            diagnostic_array(name, self._settings.brick, level, text, values, stamp)
        )
        self._refused_since = 0

    def _on_refused(self, line: str) -> None:
        if self._refused_since == 0:
            _LOG.warning("message refused: %s", line)
        self._refused_since += 1
