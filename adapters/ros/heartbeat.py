"""Heartbeats on ROS: who commands says that it lives, and who obeys notices when it falls silent.

A commander publishes on a topic beside that of its commands, from the thread that does its work,
so that a process that is killed, stopped or hangs falls silent alike. What is published is a number
of the process: another number is another process, and the one before is gone.
"""

import time
from collections.abc import Callable
from typing import Final

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import UInt64

from adapters.ros.context import steady_timer
from adapters.ros.parameters import Topic

HEARTBEAT_S: Final = 0.1


def publish_heartbeat(node: Node, commands: Topic) -> None:
    """Say every `HEARTBEAT_S`, while the node is served, that the sender of commands lives."""
    publisher = node.create_publisher(UInt64, _topic(commands), _qos())
    alive = UInt64(data=time.time_ns())
    steady_timer(node, HEARTBEAT_S, lambda: publisher.publish(alive))


class HeartbeatMonitor:
    """Notices that a commander has fallen silent.

    Looks are counted, not time: where this process itself gets no time, no look is taken, and
    nobody is taken for gone on that account.

    Args:
        silent_s: a commander that was not heard for so long is gone.
        silent: called once each time that the commander falls silent, or another takes its place.
    """

    def __init__(self, silent_s: float, silent: Callable[[], None]) -> None:
        self._most = round(silent_s / HEARTBEAT_S)
        self._silent = silent
        self._sender: int | None = None
        self._misses = self._most

    @property
    def alive(self) -> bool:
        """Whether the commander was heard of late."""
        return self._misses < self._most

    def heartbeat(self, sender: int) -> None:
        """Take a heartbeat of a process."""
        if self._sender not in (None, sender) and self.alive:
            self._silent()
        self._sender = sender
        self._misses = 0

    def command(self) -> None:
        """Take a command for a sign of life."""
        self._misses = 0

    def look(self) -> None:
        """Count a look in which nothing was heard; call every `HEARTBEAT_S`."""
        self._misses += 1
        if self._misses == self._most:
            self._silent()


def watch(node: Node, commands: Topic, monitor: HeartbeatMonitor) -> None:
    """Have a monitor hear the heartbeats of who commands, and look every `HEARTBEAT_S`."""

    def hear(heartbeat: UInt64) -> None:
        monitor.heartbeat(heartbeat.data)

    subscription = node.create_subscription(UInt64, _topic(commands), hear, _qos())

    def look() -> None:
        # rclpy serves timers first: a heartbeat that waits is no silence.
        waiting = subscription.handle
        with waiting:
            while (taken := waiting.take_message(UInt64, False)) is not None:
                hear(taken[0])
        monitor.look()

    steady_timer(node, HEARTBEAT_S, look)


def _topic(commands: Topic) -> str:
    return f"{commands.name}/heartbeat"


def _qos() -> QoSProfile:
    return QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)  # type: ignore[no-untyped-call]
