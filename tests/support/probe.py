"""A ROS node in the test that sees what a rover does and what it is told."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import dist
from pathlib import Path

from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from adapters.ros import Topic, Topics, declare_topics, ros_node, single_threaded
from executive.settings import config_folder

LIMIT_S = 60.0
ASSET = "jackal"


class Probe:
    """Hears the true pose and the velocities; spins only while it waits for something."""

    def __init__(self, node: Node, executor: SingleThreadedExecutor) -> None:
        self.node = node
        self.topics: Topics = declare_topics(node)
        self._executor = executor
        self.truth: list[Odometry] = []
        self.velocities: list[TwistStamped] = []
        self.receive(self.topics.ground_truth, self.truth.append)
        self.receive(self.topics.cmd_vel, self.velocities.append)

    def receive(self, topic: Topic | None, callback: Callable[..., None]) -> None:
        assert topic is not None
        self.node.create_subscription(topic.type, topic.name, callback, topic.qos)

    def until(self, done: Callable[[], bool], what: str) -> None:
        """Serve the node until something holds."""
        deadline_s = time.monotonic() + LIMIT_S
        while not done():
            assert time.monotonic() < deadline_s, f"waited in vain: {what}"
            self._executor.spin_once(timeout_sec=0.1)

    def fresh_truth(self) -> Odometry:
        """Wait for a true pose that is newer than what had queued."""
        self.truth.clear()
        assert self.topics.ground_truth is not None
        depth = self.topics.ground_truth.qos.depth
        self.until(lambda: len(self.truth) > depth, "true poses")
        return self.truth[-1]

    def driven(self) -> None:
        """Wait for velocities that are newer than what had queued: who sends them is heard."""
        self.velocities.clear()
        queued = self.topics.cmd_vel.qos.depth
        self.until(lambda: len(self.velocities) > queued, "velocities")

    def moving(self) -> None:
        self.until(lambda: abs(self.fresh_truth().twist.twist.linear.x) > 0.1, "it moves")

    def advanced(self, distance_m: float) -> None:
        """Wait until it is that far from where it is now."""

        def position_m() -> tuple[float, float]:
            position = self.fresh_truth().pose.pose.position
            return position.x, position.y

        begun = position_m()
        self.until(lambda: dist(begun, position_m()) > distance_m, "it advances")

    def standing(self) -> None:
        self.until(lambda: abs(self.fresh_truth().twist.twist.linear.x) < 0.01, "it stands")


@contextmanager
def probing(parameters: Path | None = None) -> Iterator[Probe]:
    """Give a probe in the namespace of the rover."""
    parameters = parameters or config_folder() / f"{ASSET}.ros.yaml"
    with ros_node("probe", ASSET, parameters=parameters) as node, single_threaded(node) as executor:
        yield Probe(node, executor)
