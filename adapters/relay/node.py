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

from adapters.mops.link_health import LinkHealth
from adapters.relay.diagnostics import diagnose
from adapters.ros.parameters import declare_optional_topic, declare_topic

HEALTH_S: Final = 1.0
CONFIRMATION_S: Final = 0.5


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
        refused: Callable[[], int],
    ) -> None:
        """Pass on notifications, and publish health, from now on."""
        self._health, self._refused = health, refused

        def take(text: String) -> None:
            notify(text.data)

        self._node.create_subscription(String, self._told.name, take, self._told.qos)
        steady = NodeClock(clock_type=ClockType.STEADY_TIME)
        self._node.create_timer(HEALTH_S, self._diagnose, clock=steady)

    def command(self, text: str) -> bool:
        """Publish commands, and wait until ROS confirms that somebody has them.

        Returns:
            Whether somebody has: False where nobody listens, or this is closed meanwhile.
        """
        if self._ended.is_set() or not self._heard:
            return False
        self._commands.publish(String(data=text))
        while not self._commands.wait_for_all_acked(Duration(seconds=CONFIRMATION_S)):
            if self._ended.is_set():
                return False
        return True

    def kept(self, sequence: int) -> None:
        """Publish the number of a report that is taken over."""
        if self._kept is not None:
            self._kept.publish(UInt64(data=sequence))

    def close(self) -> None:
        """Wait for no confirmation any more."""
        self._ended.set()

    @property
    def _heard(self) -> bool:
        return bool(self._commands.get_subscription_count())

    def _diagnose(self) -> None:
        refused = self._refused()
        self._diagnostics.publish(
            diagnose(
                self._health(),
                refused - self._refused_before,
                self._heard,
                self._asset,
                self._node.get_fully_qualified_name(),
                self._node.get_clock().now().to_msg(),
            )
        )
        self._refused_before = refused
