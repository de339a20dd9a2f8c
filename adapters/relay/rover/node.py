"""`rover-relay` on ROS: its topics and diagnostics, and the process from start to signal."""

import logging
import signal
from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from threading import Event
from typing import Final

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import String, UInt64

from adapters.bundle import BundleError, ContactPlan, Health, listen_error, load_contact_plan
from adapters.mops import LinkHealth, load_dictionary
from adapters.process import StartError, Termination, exclusive
from adapters.relay.rover.bridge import BundleBridge
from adapters.relay.rover.settings import RelaySettings
from adapters.ros import (
    declare_optional_topic,
    declare_topic,
    diagnostic_array,
    ros_node,
    single_threaded,
    steady_timer,
    subscribers_of,
)

HEALTH_S: Final = 1.0
CONFIRMATION_S: Final = 0.1
"""How long ROS is waited for at a time."""
AGAIN_AFTER: Final = 10
"""Commands that nobody confirmed for so many times are published again."""


class RelayNode:
    """Publishes and subscribes; it is the bridge's `RoverTopics`.

    Args:
        node: its topics are named by ROS parameters.
        asset: the rover's name.
    """

    def __init__(self, node: Node, asset: str) -> None:
        """Make the publishers.

        Raises:
            ParameterError: a parameter is missing or wrong.
        """
        self._node, self._asset = node, asset
        command = declare_topic(node, "relay_command", "std_msgs/String, MOPS to the rover")
        self._told = declare_topic(node, "relay_notification", "std_msgs/String, MOPS of the rover")
        kept = declare_optional_topic(
            node, "relay_kept", "std_msgs/UInt64, number of a report that is taken over"
        )
        # Fast DDS asks for acknowledgement at once where the history is full, else after 3 s.
        one = QoSProfile(depth=1, reliability=command.qos.reliability)  # type: ignore[no-untyped-call]
        self._commands = node.create_publisher(String, command.name, one)
        self._kept = node.create_publisher(UInt64, kept.name, kept.qos) if kept else None
        self._diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics", 1)
        self._refused_before = 0
        self._ended = Event()

    def serve(self, bridge: BundleBridge) -> None:
        """Pass on notifications, and publish health, from now on."""

        def on_notification(text: String) -> None:
            bridge.notify(text.data)

        self._node.create_subscription(String, self._told.name, on_notification, self._told.qos)
        steady_timer(self._node, HEALTH_S, partial(self._diagnose, bridge))

    def publish(self, text: str, answered: Callable[[], bool]) -> bool:
        """Publish commands until ROS confirms that all who listen have them, or they are answered.

        A subscriber that was killed confirms nothing until ROS forgets it, after 20 s at most;
        then nothing is left to be confirmed, which says nothing of whoever came after it. So what
        is not confirmed soon is published again, and a confirmation counts only if nobody was lost
        meanwhile.

        Returns:
            Whether somebody has them: False where nobody listens, or this is closed meanwhile.
        """
        while not self._ended.is_set() and (count := self._listener_count):
            listeners = subscribers_of(self._node, self._commands)
            self._commands.publish(String(data=text))
            for _ in range(AGAIN_AFTER):
                confirmed = self._commands.wait_for_all_acked(Duration(seconds=CONFIRMATION_S))
                if answered():
                    return True
                if confirmed or self._ended.is_set():
                    break
            if (
                confirmed
                and count <= self._listener_count
                and listeners <= subscribers_of(self._node, self._commands)
            ):
                return True
        return False

    @property
    def has_listener(self) -> bool:
        """Whether somebody listens for commands."""
        return self._listener_count > 0

    def confirm(self, sequence: int) -> None:
        """Publish the number of a report that is taken over."""
        if self._kept is not None:
            self._kept.publish(UInt64(data=sequence))

    def close(self) -> None:
        """Wait for no confirmation any more."""
        self._ended.set()

    @property
    def _listener_count(self) -> int:
        return self._commands.get_subscription_count()

    def _diagnose(self, bridge: BundleBridge) -> None:
        refused = bridge.refused
        self._diagnostics.publish(
            diagnose(
                bridge.health,
                bridge.agent_health,
                refused - self._refused_before,
                self.has_listener,
                self._asset,
                self._node.get_fully_qualified_name(),
                self._node.get_clock().now().to_msg(),
            )
        )
        self._refused_before = refused


def diagnose(
    health: LinkHealth | None,
    agent: Health | None,
    refused: int,
    heard: bool,
    asset: str,
    name: str,
    stamp: Time,
) -> DiagnosticArray:
    """Return one status: ERROR without an agent, WARN where it is full or nobody takes commands.

    Args:
        health: how the link is, as the ground is told; None before the first look.
        agent: how the agent itself is.
        refused: messages refused since the last diagnosis.
        heard: whether somebody takes commands.
        asset: the rover's name.
        name: the node's full name.
        stamp: when, on the node's clock.
    """
    if health is None or agent is None:
        level, text = DiagnosticStatus.ERROR, "the bundle agent is not there"
    elif agent.full:
        level, text = DiagnosticStatus.WARN, agent.no_room
    elif not heard:
        level, text = DiagnosticStatus.WARN, "nobody takes commands"
    elif refused:
        level, text = DiagnosticStatus.WARN, "messages were refused"
    else:
        level, text = DiagnosticStatus.OK, f"{health.queued} bundles wait to be sent"
    values: dict[str, object] = {} if health is None else asdict(health)
    if agent is not None:
        values |= {"expired": agent.expired, "room_octets": agent.room_octets}
    return diagnostic_array(f"{name}: relay", asset, level, text, values, stamp)


NODE_NAME: Final = "relay"
_LOG: Final = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Options:
    """What the command line says.

    Attributes:
        asset: namespace of the rover.
        settings_file: where the settings were read; the contact plan is beside it.
        topics: ROS parameter file with the topics of the relay.
        data: folder of the store.
        ros_arguments: what goes to ROS as it is.
    """

    asset: str
    settings: RelaySettings
    settings_file: Path
    topics: Path
    data: Path
    ros_arguments: tuple[str, ...] = ()


def serve(options: Options) -> None:
    """Serve until SIGINT or SIGTERM.

    Raises:
        StartError: it cannot start or go on.
        adapters.ros.parameters.ParameterError: a ROS parameter or argument makes no sense.
        executive.settings.SettingsError: the MOPS dictionary does not fit.
    """
    asked, asked_again = Termination(), list[int]()
    signal.signal(signal.SIGUSR1, lambda number, _: asked_again.append(number))
    settings = options.settings
    try:
        with (
            exclusive(options.data, "relay.lock"),
            ros_node(
                NODE_NAME,
                options.asset,
                parameters=options.topics,
                ros_arguments=options.ros_arguments,
            ) as node,
            single_threaded(node) as executor,
        ):
            topics = RelayNode(node, settings.asset)
            store = options.data / "relay.sqlite"
            read_plan = partial(
                load_contact_plan,
                *(options.settings_file, settings.contact_plan, options.data, settings.node()),
            )
            bridge = BundleBridge(settings, store, read_plan(), load_dictionary(), topics)
            _start(bridge, options)
            with closing(bridge), closing(topics):
                topics.serve(bridge)
                print(f"{settings.eid} relays for {settings.asset}", flush=True)
                while not asked.requested:
                    executor.spin_once()
                    if asked_again:
                        asked_again.clear()
                        _read_again(bridge, read_plan)
                    if not bridge.alive:
                        raise StartError("the bundle agent is down; its error is in the log")
                _LOG.info("asked to end: what waits is kept")
    except (BundleError, OSError) as error:
        raise StartError(str(error)) from error


def _read_again(bridge: BundleBridge, read_plan: Callable[[], ContactPlan | None]) -> None:
    """Go by the plan as it is in the file now; one that is broken changes nothing."""
    try:
        bridge.set_plan(read_plan())
        _LOG.info("asked to read the contact plan again")
    except (BundleError, OSError) as error:
        _LOG.error("the contact plan stays as it was: %s", error)


def _start(bridge: BundleBridge, options: Options) -> None:
    try:
        bridge.start()
    except OSError as error:
        why = listen_error(error, options.settings.listen, options.settings_file)
        raise StartError(why) from error
