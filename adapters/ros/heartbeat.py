"""Heartbeats on ROS: a commander publishes them, and its receiver detects their timeout.

A commander publishes on a topic next to that of its commands, from the thread that does its work.
A process that is killed, stopped or hangs then becomes silent in the same manner. The message is a
number of the process: a different number means a different process, and the end of the former one.
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
    """Publish a heartbeat for the sender of commands every `HEARTBEAT_S`, while the node spins."""
    publisher = node.create_publisher(UInt64, _topic(commands), _qos())
    alive = UInt64(data=time.time_ns())
    steady_timer(node, HEARTBEAT_S, lambda: publisher.publish(alive))


class HeartbeatMonitor:
    """Detects that a commander is silent.

    It counts polls, not time: while this process itself is not scheduled, it polls nothing, and no
    commander times out.

    Args:
        silent_s: timeout of the commander, s.
        silent: called once each time that the commander times out, or another one replaces it.
    """

    def __init__(self, silent_s: float, silent: Callable[[], None]) -> None:
        self._max_misses = round(silent_s / HEARTBEAT_S)
        self._silent = silent
        self._sender: int | None = None
        self._misses = self._max_misses

    @property
    def alive(self) -> bool:
        """Whether the commander is within its timeout."""
        return self._misses < self._max_misses

    def heartbeat(self, sender: int) -> None:
        """Record a heartbeat of a process."""
        if self._sender not in (None, sender) and self.alive:
            self._silent()
        self._sender = sender
        self._misses = 0

    def command(self) -> None:
        """Record a command, which counts as a heartbeat."""
        self._misses = 0

    def update(self) -> None:
        """Count a poll without a message; call every `HEARTBEAT_S`."""
        self._misses += 1
        if self._misses == self._max_misses:
            self._silent()


def watch(node: Node, commands: Topic, monitor: HeartbeatMonitor) -> None:
    """Subscribe a monitor to the heartbeats of a commander, and poll it every `HEARTBEAT_S`."""

    def on_heartbeat(heartbeat: UInt64) -> None:
        monitor.heartbeat(heartbeat.data)

    subscription = node.create_subscription(UInt64, _topic(commands), on_heartbeat, _qos())

    def poll() -> None:
        # rclpy serves timers first: a queued heartbeat must not count as silence.
        waiting = subscription.handle
        with waiting:
            while (taken := waiting.take_message(UInt64, False)) is not None:
                on_heartbeat(taken[0])
        monitor.update()

    steady_timer(node, HEARTBEAT_S, poll)


def _topic(commands: Topic) -> str:
    return f"{commands.name}/heartbeat"


def _qos() -> QoSProfile:
    return QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)  # type: ignore[no-untyped-call]
