"""Listens to the rover's topics beside the session: where it was, and what its tree did."""

import os
import threading
import time
from bisect import bisect
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy
from std_msgs.msg import Float64, String

from adapters.ros import declare_topics, odometry_fact, ros_node, single_threaded
from adapters.ros.tree_topic import from_json, tree_qos
from executive.values.geometry import Pose
from trees import NodeStatus, TreeSnapshot

_STARTTIME: Final = 19
"""Field 22 of proc(5)'s stat, counted behind the name of the program."""


def since_start_s() -> float:
    """Return seconds since the kernel made this process, to 10 ms."""
    fields = Path("/proc/self/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    started_s = int(fields[_STARTTIME]) / os.sysconf("SC_CLK_TCK")
    return time.clock_gettime(time.CLOCK_BOOTTIME) - started_s


def told(seconds: float) -> str:
    """Return a time since the start in words, as the launcher may have installed first."""
    installed = " (installation included)" if os.environ.get("ROVER_INSTALLED") else ""
    return f"{seconds:.1f} s{installed}"


_SPIN_S: Final = 0.1


@dataclass(frozen=True, slots=True)
class PoseSample:
    """Where the rover was, and how far its camera was turned.

    Attributes:
        utc_s: when this was heard.
        stamp_s: the rover's own time; simulated, if its clock is.
    """

    utc_s: float
    stamp_s: float
    pose: Pose
    pan_rad: float


class RoverRecorder:
    """Keeps what it hears. Written by the thread that spins the node, read by any.

    Attributes:
        driven: where odometry said that base_link was.
        true: where it really was.
        busiest: the last snapshot of the tree among those with most running nodes.
        moved_after_s: when the rover was first told to move, since this process's start.
    """

    def __init__(self, node: Node, asset: str) -> None:
        self.driven: list[PoseSample] = []
        self.true: list[PoseSample] = []
        self._pan_rad = 0.0
        self.busiest: TreeSnapshot | None = None
        self.moved_after_s: float | None = None
        topics = declare_topics(node)
        self._node = node
        self._odometry = node.resolve_topic_name(topics.odometry.name)
        for kind, topic, callback in (
            (Odometry, topics.odometry, partial(self._see, self.driven)),
            (Odometry, topics.ground_truth, partial(self._see, self.true)),
            (Twist, topics.cmd_vel, self._on_velocity),
            (Float64, topics.camera_pan_state, self._on_pan),
        ):
            node.create_subscription(kind, topic.name, callback, topic.qos)
        latest = tree_qos(DurabilityPolicy.VOLATILE)
        node.create_subscription(String, f"/{asset}/executive/tree", self._on_tree, latest)

    @property
    def ready(self) -> bool:
        """Whether the rover was seen, and its tree too."""
        return bool(self.driven and self.true and self.busiest)

    def simulated_s(self, utc_s: float) -> float:
        """Return what the rover's clock showed; between two sightings it goes evenly."""
        true = self.true
        after = min(bisect(true, utc_s, key=lambda seen: seen.utc_s), len(true) - 1)
        last, following = true[max(0, after - 1)], true[after]
        if following.utc_s <= last.utc_s:
            return following.stamp_s
        part = min(1.0, (utc_s - last.utc_s) / (following.utc_s - last.utc_s))
        return last.stamp_s + part * (following.stamp_s - last.stamp_s)

    def rovers(self) -> int:
        """Return how many publish the rover's odometry."""
        return self._node.count_publishers(self._odometry)

    def _see(self, sightings: list[PoseSample], message: Odometry) -> None:
        seen = odometry_fact(message)
        sightings.append(PoseSample(time.time(), seen.stamp_s, seen.pose, self._pan_rad))

    def _on_pan(self, message: Float64) -> None:
        self._pan_rad = message.data

    def _on_velocity(self, message: Twist) -> None:
        if self.moved_after_s is None and (message.linear.x or message.angular.z):
            self.moved_after_s = since_start_s()

    def _on_tree(self, message: String) -> None:
        snapshot = from_json(message.data)
        if self.busiest is None or _running(snapshot) >= _running(self.busiest):
            self.busiest = snapshot


@contextmanager
def recorder(asset: str, domain: int, parameters: Path) -> Iterator[RoverRecorder]:
    """Yield a recorder that listens on a thread of its own."""
    with (
        ros_node("demo", asset, parameters=parameters, domain_id=domain) as node,
        single_threaded(node) as executor,
    ):
        heard = RoverRecorder(node, asset)
        closing = threading.Event()

        def listen() -> None:
            while not closing.is_set():
                executor.spin_once(_SPIN_S)

        thread = threading.Thread(target=listen, name="recorder")
        thread.start()
        try:
            yield heard
        finally:
            closing.set()
            thread.join()


def _running(snapshot: TreeSnapshot) -> int:
    return sum(node.status is NodeStatus.RUNNING for node in snapshot.nodes)
