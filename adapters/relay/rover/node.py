"""`rover-relay` on ROS: its topics and diagnostics, and the process from start to signal."""

import logging
import signal
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import asdict
from functools import partial
from pathlib import Path
from threading import Event
from typing import Final

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

NODE_NAME: Final = "relay"
HEALTH_S: Final = 1.0
CONFIRMATION_S: Final = 0.1
"""How long one wait for acknowledgements lasts."""
AGAIN_AFTER: Final = 10
"""After so many waits without acknowledgement commands are published again."""
_LOG: Final = logging.getLogger(__name__)


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
        """Publish the number of a report that is stored."""
        if self._kept is not None:
            self._kept.publish(UInt64(data=sequence))

    def close(self) -> None:
        """End every wait for acknowledgements."""
        self._ended.set()

    @property
    def _listener_count(self) -> int:
        return self._commands.get_subscription_count()

    def _diagnose(self, bridge: BundleBridge) -> None:
        refused, self._refused_before = bridge.refused - self._refused_before, bridge.refused
        level, text, values = diagnose(
            bridge.health, bridge.agent_health, refused, self.has_listener
        )
        name = f"{self._node.get_fully_qualified_name()}: relay"
        stamp = self._node.get_clock().now().to_msg()
        self._diagnostics.publish(diagnostic_array(name, self._asset, level, text, values, stamp))


def diagnose(
    health: LinkHealth | None, agent: Health | None, refused: int, heard: bool
) -> tuple[bytes, str, dict[str, object]]:
    """Return level, text and values: ERROR without an agent, WARN where nothing gets through.

    Args:
        health: how the link is, as the ground is told; None before the first look.
        agent: how the agent itself is.
        refused: messages refused since the last diagnosis.
        heard: whether somebody takes commands.
    """
    if health is None or agent is None:
        return DiagnosticStatus.ERROR, "the bundle agent is not there", {}
    if agent.full:
        level, text = DiagnosticStatus.WARN, agent.no_room
    elif not heard:
        level, text = DiagnosticStatus.WARN, "nobody takes commands"
    elif refused:
        level, text = DiagnosticStatus.WARN, "messages were refused"
    else:
        level, text = DiagnosticStatus.OK, f"{health.queued} bundles wait to be sent"
    figures = {"expired": agent.expired, "room_octets": agent.room_octets}
    return level, text, asdict(health) | figures


def serve(
    asset: str,
    settings: RelaySettings,
    settings_file: Path,
    topics_file: Path,
    data: Path,
    ros_arguments: Sequence[str],
) -> None:
    """Serve until SIGINT or SIGTERM.

    Args:
        asset: namespace of the rover.
        settings: of the relay.
        settings_file: where they were read; the contact plan is beside it.
        topics_file: ROS parameter file with the topics of the relay.
        data: folder of the store.
        ros_arguments: what goes to ROS as it is.

    Raises:
        StartError: it cannot start or go on.
        adapters.ros.parameters.ParameterError: a ROS parameter or argument makes no sense.
        executive.settings.SettingsError: the MOPS dictionary does not fit.
    """
    asked, asked_again = Termination(), list[int]()
    signal.signal(signal.SIGUSR1, lambda number, _: asked_again.append(number))
    try:
        with (
            exclusive(data, "relay.lock"),
            ros_node(NODE_NAME, asset, parameters=topics_file, ros_arguments=ros_arguments) as node,
            single_threaded(node) as executor,
        ):
            topics = RelayNode(node, settings.asset)
            store = data / "relay.sqlite"
            read_plan = partial(
                load_contact_plan, *(settings_file, settings.contact_plan, data, settings.node())
            )
            bridge = BundleBridge(settings, store, read_plan(), load_dictionary(), topics)
            _start(bridge, settings, settings_file)
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
    """Read the contact plan again; a broken one changes nothing."""
    try:
        bridge.set_plan(read_plan())
        _LOG.info("asked to read the contact plan again")
    except (BundleError, OSError) as error:
        _LOG.error("the contact plan stays as it was: %s", error)


def _start(bridge: BundleBridge, settings: RelaySettings, settings_file: Path) -> None:
    try:
        bridge.start()
    except OSError as error:
        raise StartError(listen_error(error, settings.listen, settings_file)) from error
