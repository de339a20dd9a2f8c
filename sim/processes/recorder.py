"""`RoverRecorder` collects a rover's poses and its tree's activity from ROS topics, in memory."""

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

from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy
from std_msgs.msg import Float64, String

from adapters.ros import declare_topics, odometry_fact, ros_node, single_threaded, twist_of
from adapters.ros.tree_topic import from_json, tree_qos
from executive.values.geometry import Pose
from trees import NodeStatus, TreeSnapshot

_STARTTIME: Final = 19
"""Index of field 22 of proc(5)'s stat, counted after the program name."""


def since_start_s() -> float:
    """Return the time since the kernel created this process, s, to 10 ms."""
    fields = Path("/proc/self/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    started_s = int(fields[_STARTTIME]) / os.sysconf("SC_CLK_TCK")
    return time.clock_gettime(time.CLOCK_BOOTTIME) - started_s


def format_elapsed(seconds: float) -> str:
    """Return a time since the start as text, as the launcher may have installed first."""
    installed = " (installation included)" if os.environ.get("ROVER_INSTALLED") else ""
    return f"{seconds:.1f} s{installed}"


_SPIN_S: Final = 0.1


@dataclass(frozen=True, slots=True)
class PoseSample:
    """Pose of the rover, and pan angle of its camera.

    Attributes:
        utc_s: time of reception, s UTC.
        stamp_s: time on the rover's clock; simulated, if that clock is.
    """

    utc_s: float
    stamp_s: float
    pose: Pose
    pan_rad: float


class RoverRecorder:
    """Collects received messages. Written by the thread that spins the node, read by any.

    Attributes:
        driven: poses of base_link by odometry.
        true: true poses of base_link.
        busiest: the last snapshot of the tree among those with the maximum of running nodes.
        moved_after_s: time of the first velocity command, since this process's start.
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
        for topic, callback in (
            (topics.odometry, partial(self._add_pose, self.driven)),
            (topics.ground_truth, partial(self._add_pose, self.true)),
            (topics.cmd_vel, self._on_velocity),
            (topics.camera_pan_state, self._on_pan),
        ):
            if topic is not None:
                node.create_subscription(topic.type, topic.name, callback, topic.qos)
        latest = tree_qos(DurabilityPolicy.VOLATILE)
        node.create_subscription(String, f"/{asset}/executive/tree", self._on_tree, latest)

    @property
    def ready(self) -> bool:
        """Whether poses and a tree of the rover were received."""
        return bool(self.driven and self.true and self.busiest)

    def simulated_s(self, utc_s: float) -> float:
        """Return the rover's clock at a time, interpolated between two samples."""
        true = self.true
        after = min(bisect(true, utc_s, key=lambda seen: seen.utc_s), len(true) - 1)
        last, following = true[max(0, after - 1)], true[after]
        if following.utc_s <= last.utc_s:
            return following.stamp_s
        part = min(1.0, (utc_s - last.utc_s) / (following.utc_s - last.utc_s))
        return last.stamp_s + part * (following.stamp_s - last.stamp_s)

    def rovers(self) -> int:
        """Return the number of publishers of the rover's odometry."""
        return self._node.count_publishers(self._odometry)

    def _add_pose(self, sightings: list[PoseSample], message: Odometry) -> None:
        seen = odometry_fact(message)
        sightings.append(PoseSample(time.time(), seen.stamp_s, seen.pose, self._pan_rad))

    def _on_pan(self, message: Float64) -> None:
        self._pan_rad = message.data

    def _on_velocity(self, message: Twist | TwistStamped) -> None:
        twist = twist_of(message)
        if self.moved_after_s is None and (twist.linear.x or twist.angular.z):
            self.moved_after_s = since_start_s()

    def _on_tree(self, message: String) -> None:
        snapshot = from_json(message.data)
        if self.busiest is None or _running(snapshot) >= _running(self.busiest):
            self.busiest = snapshot


@contextmanager
def recorder(asset: str, domain: int, parameters: Path) -> Iterator[RoverRecorder]:
    """Yield a recorder that runs on a thread of its own."""
    with (
        ros_node("demo", asset, parameters=parameters, domain_id=domain) as node,
        single_threaded(node) as executor,
    ):
        recorded = RoverRecorder(node, asset)
        closing = threading.Event()

        def listen() -> None:
            while not closing.is_set():
                executor.spin_once(_SPIN_S)

        thread = threading.Thread(target=listen, name="recorder")
        thread.start()
        try:
            yield recorded
        finally:
            closing.set()
            thread.join()


def _running(snapshot: TreeSnapshot) -> int:
    return sum(node.status is NodeStatus.RUNNING for node in snapshot.nodes)
