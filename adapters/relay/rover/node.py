"""`serve`, the body of `rover-relay`: a ROS node with topics and diagnostics, until a signal."""

import logging
import signal
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Final

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node
from std_msgs.msg import String, UInt64

from adapters.bundle import (
    BundleError,
    ContactPlan,
    Health,
    listen_error,
    load_contact_plan,
    load_security,
)
from adapters.mops import LinkHealth, load_dictionary
from adapters.process import StartError, Termination, announce, exclusive
from adapters.relay.rover.bridge import BundleBridge
from adapters.relay.rover.settings import RelaySettings
from adapters.ros import (
    declare_optional_topic,
    declare_topic,
    diagnostic_array,
    publish_heartbeat,
    ros_node,
    single_threaded,
    steady_timer,
)

NODE_NAME: Final = "relay"
HEALTH_S: Final = 1.0
_LOG: Final = logging.getLogger(__name__)


class RelayNode:
    """Publishers and subscriptions; implements the bridge's `RoverTopics`.

    Args:
        node: its ROS parameters name the topics.
        asset: the rover's name.
    """

    def __init__(self, node: Node, asset: str) -> None:
        """Create the publishers.

        Raises:
            ParameterError: a parameter is missing or invalid.
        """
        self._node, self._asset = node, asset
        command = declare_topic(node, "relay_command", "MOPS to the rover", String)
        stop = declare_topic(node, "relay_stop", "MOPS of stops to the rover", String)
        self._taken = declare_topic(
            node, "relay_command_ack", "fingerprint of a confirmed string of commands", UInt64
        )
        self._notification_topic = declare_topic(
            node, "relay_notification", "MOPS of the rover", String
        )
        ack = declare_optional_topic(
            node, "relay_notification_ack", "fingerprint of a stored string of reports", UInt64
        )
        publish_heartbeat(node, command)
        self._publishers = {
            stops: node.create_publisher(String, topic.name, topic.qos)
            for stops, topic in ((True, stop), (False, command))
        }
        self._confirmation_topic = node.create_publisher(UInt64, ack.name, ack.qos) if ack else None
        self._diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics", 1)
        self._refused_before = 0

    def serve(self, bridge: BundleBridge) -> None:
        """Forward notifications and publish health, from now on."""

        def on_notification(text: String) -> None:
            bridge.notify(text.data)

        def on_taken(mark: UInt64) -> None:
            bridge.on_confirmed(mark.data)

        self._node.create_subscription(
            String, self._notification_topic.name, on_notification, self._notification_topic.qos
        )
        self._node.create_subscription(UInt64, self._taken.name, on_taken, self._taken.qos)
        steady_timer(self._node, HEALTH_S, partial(self._diagnose, bridge))

    def publish(self, text: str, *, stops: bool) -> None:
        """Publish commands; stops use a topic of their own."""
        self._publishers[stops].publish(String(data=text))

    def has_listener(self, *, stops: bool) -> bool:
        """Whether the commands have a subscriber."""
        return bool(self._publishers[stops].get_subscription_count())

    def confirm(self, mark: int) -> None:
        """Publish the fingerprint of a stored string."""
        if self._confirmation_topic is not None:
            self._confirmation_topic.publish(UInt64(data=mark))

    def _diagnose(self, bridge: BundleBridge) -> None:
        refused, self._refused_before = bridge.refused - self._refused_before, bridge.refused
        level, text, values = diagnose(
            bridge.health, bridge.agent_health, refused, self.has_listener(stops=False)
        )
        name = f"{self._node.get_fully_qualified_name()}: relay"
        stamp = self._node.get_clock().now().to_msg()
        self._diagnostics.publish(diagnostic_array(name, self._asset, level, text, values, stamp))


def diagnose(
    health: LinkHealth | None, agent: Health | None, refused: int, has_subscriber: bool
) -> tuple[bytes, str, dict[str, object]]:
    """Return level, text and values: ERROR without an agent, WARN if nothing gets through.

    Args:
        health: state of the link, as sent to the ground; None before the first poll.
        agent: state of the bundle agent.
        refused: messages refused since the last diagnosis.
        has_subscriber: whether commands have a subscriber.
    """
    if health is None or agent is None:
        return DiagnosticStatus.ERROR, "the bundle agent is not running", {}
    if agent.full_text:
        level, text = DiagnosticStatus.WARN, agent.full_text
    elif not has_subscriber:
        level, text = DiagnosticStatus.WARN, "no subscriber to commands"
    elif refused:
        level, text = DiagnosticStatus.WARN, "messages were refused"
    else:
        level, text = DiagnosticStatus.OK, f"{health.queued} bundles wait to be sent"
    figures = {"expired": agent.expired, "free_octets": agent.free_octets}
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
        settings: settings of the relay.
        settings_file: file of the settings; the contact plan's path is relative to it.
        topics_file: ROS parameter file with the topics of the relay.
        data: folder of the store.
        ros_arguments: arguments passed to ROS unchanged.

    Raises:
        StartError: it cannot start or continue.
        adapters.ros.parameters.ParameterError: a ROS parameter or argument is invalid.
        executive.settings.SettingsError: the MOPS dictionary is invalid.
    """
    termination, reload_requests = Termination(), list[int]()
    signal.signal(signal.SIGUSR1, lambda number, _: reload_requests.append(number))
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
            security = load_security(settings_file, settings.security, settings.node().node)
            bridge = BundleBridge(settings, store, read_plan(), load_dictionary(), topics, security)
            _start(bridge, settings, settings_file)
            with closing(bridge):
                topics.serve(bridge)
                announce(f"{settings.eid} relays for {settings.asset}")
                while not termination.requested:
                    executor.spin_once()
                    if reload_requests:
                        reload_requests.clear()
                        _reload_plan(bridge, read_plan)
                    if not bridge.alive:
                        raise StartError("the bundle agent has ended; the log has its error")
                _LOG.info("signal received: queued bundles are retained")
    except (BundleError, OSError) as error:
        raise StartError(str(error)) from error


def _reload_plan(bridge: BundleBridge, read_plan: Callable[[], ContactPlan | None]) -> None:
    """Reload the contact plan; an invalid one changes nothing."""
    try:
        bridge.set_plan(read_plan())
        _LOG.info("contact plan reloaded on request")
    except (BundleError, OSError) as error:
        _LOG.error("contact plan not reloaded, the present one stays: %s", error)


def _start(bridge: BundleBridge, settings: RelaySettings, settings_file: Path) -> None:
    try:
        bridge.start()
    except OSError as error:
        raise StartError(listen_error(error, settings.listen, settings_file)) from error
