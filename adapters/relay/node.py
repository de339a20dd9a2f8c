"""The relay's topics: commands out, notifications in, and what has been taken over."""

from collections.abc import Callable
from threading import Event
from typing import Final

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock as NodeClock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import String, UInt64

from adapters.bundle import Health
from adapters.mops.link_health import LinkHealth
from adapters.relay.diagnostics import diagnose
from adapters.ros.parameters import declare_optional_topic, declare_topic

HEALTH_S: Final = 1.0
CONFIRMATION_S: Final = 0.1
"""How long ROS is waited for at a time."""
AGAIN_AFTER: Final = 10
"""Commands that nobody confirmed for so many times are published again."""


class RelayNode:
    """Publishes and subscribes; it is the link's `Exits`.

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

    def listen(
        self,
        notify: Callable[[str], None],
        health: Callable[[], LinkHealth | None],
        agent: Callable[[], Health | None],
        refused: Callable[[], int],
    ) -> None:
        """Pass on notifications, and publish health, from now on."""
        self._health, self._agent, self._refused = health, agent, refused

        def take(text: String) -> None:
            notify(text.data)

        self._node.create_subscription(String, self._told.name, take, self._told.qos)
        steady = NodeClock(clock_type=ClockType.STEADY_TIME)
        self._node.create_timer(HEALTH_S, self._diagnose, clock=steady)

    def command(self, text: str, answered: Callable[[], bool]) -> bool:
        """Publish commands until ROS confirms that all who listen have them, or they are answered.

        A subscriber that was killed confirms nothing, and counts for as long as ROS takes to
        forget it; then nothing is left to be confirmed, which says nothing of whoever came after
        it. So what is not confirmed soon is published again, and what is, only counts if nobody
        was lost meanwhile.

        Returns:
            Whether somebody has them: False where nobody listens, or this is closed meanwhile.
        """
        while not self._ended.is_set() and (count := self._listener_count):
            listeners = self._listeners()
            self._commands.publish(String(data=text))
            for _ in range(AGAIN_AFTER):
                confirmed = self._commands.wait_for_all_acked(Duration(seconds=CONFIRMATION_S))
                if answered():
                    return True
                if confirmed or self._ended.is_set():
                    break
            if confirmed and count <= self._listener_count and listeners <= self._listeners():
                return True
        return False

    @property
    def heard(self) -> bool:
        """Whether somebody listens for commands."""
        return self._listener_count > 0

    def kept(self, sequence: int) -> None:
        """Publish the number of a report that is taken over."""
        if self._kept is not None:
            self._kept.publish(UInt64(data=sequence))

    def close(self) -> None:
        """Wait for no confirmation any more."""
        self._ended.set()

    @property
    def _listener_count(self) -> int:
        return self._commands.get_subscription_count()

    def _listeners(self) -> frozenset[bytes]:
        found = self._node.get_subscriptions_info_by_topic(self._commands.topic_name)
        return frozenset(bytes(each.endpoint_gid) for each in found)

    def _diagnose(self) -> None:
        refused = self._refused()
        self._diagnostics.publish(
            diagnose(
                self._health(),
                self._agent(),
                refused - self._refused_before,
                self.heard,
                self._asset,
                self._node.get_fully_qualified_name(),
                self._node.get_clock().now().to_msg(),
            )
        )
        self._refused_before = refused
