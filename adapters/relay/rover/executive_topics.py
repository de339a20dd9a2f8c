"""`ExecutiveRelayTopics`: ROS topics from and to `rover-relay`, at the executive."""

from collections.abc import Callable
from typing import Any, Protocol

from rclpy.node import Node
from std_msgs.msg import String, UInt64

from adapters.mops import MopsError
from adapters.relay.rover.executive_link import POLL_S, ExecutiveRelayLink
from adapters.ros import MessageError, Topic, declare_topic, steady_timer


class SubscriptionHost(Protocol):
    """Host of subscriptions that contains exceptions of callbacks: `adapters.ros.node`."""

    def subscribe(self, topic: Topic, callback: Callable[[Any], None]) -> None:
        """Subscribe to a topic."""
        ...

    def subscribe_apart(self, topic: Topic, callback: Callable[[Any], None]) -> None:
        """Subscribe to a topic, with the callback on a thread of its own."""
        ...

    def contained(self, callback: Callable[..., None]) -> Callable[..., None]:
        """Return a callback that raises no exception."""
        ...


class ExecutiveRelayTopics:
    """Publishers and subscriptions; implements the link's `RelayTopics`.

    Args:
        node: its ROS parameters name the topics.

    Raises:
        adapters.ros.parameters.ParameterError: a parameter is missing or invalid.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._stops, self._commands = (
            declare_topic(node, key, "MOPS of the relay", String)
            for key in ("relay_stop", "relay_command")
        )
        reports = declare_topic(node, "relay_notification", "MOPS to the relay", String)
        self._confirmation_topic = declare_topic(
            node, "relay_notification_ack", "fingerprint of a stored string of reports", UInt64
        )
        taken = declare_topic(
            node, "relay_command_ack", "fingerprint of a confirmed string of commands", UInt64
        )
        self._taken = node.create_publisher(UInt64, taken.name, taken.qos)
        self._reports = node.create_publisher(String, reports.name, reports.qos)

    def serve(self, link: ExecutiveRelayLink, served: SubscriptionHost) -> None:
        """Pass commands and confirmations to the link from now on; stops on a separate thread."""

        def on_command(text: String) -> None:
            try:
                link.command(text.data)
            except MopsError as error:
                raise MessageError(f"relay: {error}") from error

        def on_ack(mark: UInt64) -> None:
            link.on_confirmed(mark.data)

        served.subscribe_apart(self._stops, on_command)
        served.subscribe(self._commands, on_command)
        served.subscribe(self._confirmation_topic, on_ack)
        steady_timer(self._node, POLL_S, served.contained(link.poll))

    def publish(self, text: str) -> None:
        """Publish reports and telemetry, as whole messages."""
        self._reports.publish(String(data=text))

    def confirm(self, mark: int) -> None:
        """Publish the fingerprint of a confirmed string of commands."""
        self._taken.publish(UInt64(data=mark))

    def count_listeners(self) -> int:
        """Return the number of subscribers to reports."""
        return int(self._reports.get_subscription_count())
