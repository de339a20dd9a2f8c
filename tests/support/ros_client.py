"""A ROS client of an executive, and a rover without physics for it, in one process on ROS."""

import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from math import cos, pi, sin
from pathlib import Path
from queue import SimpleQueue
from threading import Thread
from typing import Any, Final
from uuid import uuid4

from geometry_msgs.msg import PoseStamped, Twist
from nav_msgs.msg import Odometry as OdometryMessage
from rclpy.action.client import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import String
from unique_identifier_msgs.msg import UUID

from adapters.ros import latched_qos, odometry_message, ros_node
from executive.settings import config_folder
from executive.values.facts import Odometry
from executive.values.geometry import Velocity, wrap_rad
from tests.support.kinematic import KinematicRover

NAME: Final = "clients"
LIMIT_S: Final = 30.0
STEP_S: Final = 0.02
SILENT_S: Final = 0.3
AGAIN_S: Final = 3.0
TOPICS: Final = """
/**:
  ros__parameters:
    use_sim_time: false
    start_type_description_service: false
    odometry: {topic: odom, reliability: reliable, depth: 10}
    cmd_vel: {topic: cmd_vel, type: geometry_msgs/msg/Twist, reliability: reliable, depth: 1}
    camera_hz: 5.0
    tree_hz: 5.0
"""
FAST: Final = {
    "travel_speed_mps: 0.3": "travel_speed_mps: 1.0",
    "travel_acceleration_mps2: 0.5": "travel_acceleration_mps2: 2.0",
    "turtlebot4": NAME,
    "[JPG]": "[]",
}


def asset(folder: Path, commands: str, more: str = "") -> Path:
    """Write an asset that accepts commands of ROS clients, and its topics; return its file."""
    text = (config_folder() / "robots" / "turtlebot4.yaml").read_text()
    text = text[: text.index("sensors:")]
    for old, new in FAST.items():
        text = text.replace(old, new)
    (folder / f"{NAME}.ros.yaml").write_text(TOPICS)
    path = folder / f"{NAME}.yaml"
    path.write_text(f"{text}\nros: {{commands: {commands}}}\n{more}")
    return path


def call(node: Node, work: Callable[[], Any]) -> Any:
    """Call an action client of a node in the thread that spins it, and return the result.

    rclpy of Jazzy registers a request after it was sent: an answer that another thread takes before
    that is dropped.
    """
    done: SimpleQueue[Any] = SimpleQueue()
    assert node.executor is not None
    node.executor.create_task(lambda: done.put(work()))
    return done.get(timeout=LIMIT_S)


class RosClient:
    """Publishes odometry as it is driven, and is a client of topics and actions.

    Attributes:
        reports: reports by JSON, in order.
        driven_m: length of its track.
        turned_rad: sum of its turns.
        late_s: maximum time between two of its steps.
    """

    def __init__(self, node: Node, drives: bool) -> None:
        self.node, self.rover = node, KinematicRover(spin_centre_m=0.0)
        self.reports: list[dict[str, Any]] = []
        self.driven_m = self.turned_rad = self.late_s = 0.0
        self._commanded_s = self._stepped_s = 0.0
        self._odometry = node.create_publisher(OdometryMessage, "odom", 10)
        node.create_subscription(Twist, "cmd_vel", self._on_velocity, 1)
        node.create_subscription(String, "executive/report", self._on_report, latched_qos(100))
        if drives:
            node.create_timer(STEP_S, self._step)
        qos = QoSProfile(depth=10)  # type: ignore[no-untyped-call]
        self.commands = node.create_publisher(String, "executive/command", qos)
        self.poses = node.create_publisher(PoseStamped, "executive/goal_pose", qos)
        self._clients: dict[str, Any] = {}
        self._former: list[dict[str, Any]] = []

    def _on_velocity(self, twist: Twist) -> None:
        self._commanded_s = time.monotonic()
        self.rover.drive(Velocity(twist.linear.x, twist.angular.z))

    def _on_report(self, message: String) -> None:
        self.reports.append(json.loads(message.data))

    def _step(self) -> None:
        now_s = time.monotonic()
        if now_s - self._commanded_s > SILENT_S:
            self.rover.emergency_stop()
        step_s = min(now_s - self._stepped_s, 0.2)
        self.late_s = max(self.late_s, step_s)
        self._stepped_s = now_s
        velocity = self.rover.velocity
        self.driven_m += abs(velocity.travel_mps) * step_s
        self.turned_rad += abs(velocity.rotate_radps) * step_s
        self.rover.advance(step_s)
        self._odometry.publish(odometry_message(Odometry(time.time(), self.rover.pose, velocity)))

    def call(self, work: Callable[[], Any]) -> Any:
        """Call an action client; see `call`."""
        return call(self.node, work)

    def until(self, done: Callable[[], Any], what: str, limit_s: float = LIMIT_S) -> Any:
        """Wait until a function returns something true, and return that."""
        deadline_s = time.monotonic() + limit_s
        while not (found := done()):
            assert time.monotonic() < deadline_s, f"waited in vain: {what}\n{self.reports[-5:]}"
            time.sleep(0.005)
        return found

    def forget(self) -> None:
        """Forget all goals, as a new client: rclpy accepts no UUID a second time."""
        self._former.append(self._clients)
        self._clients = {}

    def action(self, name: str) -> Any:
        """Return the client of an action, ready to send goals."""
        if name not in self._clients:
            kinds = import_module("nav2_msgs.action")
            kind = getattr(kinds, {"backup": "BackUp"}.get(name, name.title().replace("_", "")))
            make: Any = ActionClient
            self._clients[name] = make(self.node, kind, f"executive/{name}")
        client = self._clients[name]
        self.until(client.server_is_ready, f"server of {name}")
        return client

    def send(self, name: str, goal: Any, number: bytes = b"", feedback: Any = None) -> Any:
        """Send a goal, again if a request is lost, and return its handle once it is answered.

        DDS loses requests in the seconds after the start of a server.
        """
        uuid, client = UUID(uuid=list(number or uuid4().bytes)), self.action(name)
        futures: list[Any] = []
        deadline_s = time.monotonic() + LIMIT_S
        while not any(each.done() for each in futures):
            assert time.monotonic() < deadline_s, f"no answer of {name}"
            send = partial(client.send_goal_async, goal, feedback_callback=feedback, goal_uuid=uuid)
            futures.append(self.call(send))
            again_s = time.monotonic() + AGAIN_S
            while time.monotonic() < again_s and not any(each.done() for each in futures):
                time.sleep(0.002)
        return next(each.result() for each in futures if each.done())

    def result(self, handle: Any) -> Any:
        """Return status and result of an accepted goal."""
        future = self.call(handle.get_result_async)
        self.until(future.done, "result")
        return future.result()

    def run(self, name: str, goal: Any) -> Any:
        """Send a goal that is accepted, and return status and result."""
        handle = self.send(name, goal)
        assert handle.accepted, self.reports[-3:]
        return self.result(handle)

    def goal(self, name: str, **fields: Any) -> Any:
        """Return a goal of an action."""
        kind = self.action(name)._action_type.Goal
        poses: Any = getattr(kind(), "poses", None)
        if hasattr(poses, "goals"):  # from Kilted on
            fields["poses"] = type(poses)(goals=fields["poses"])
        return kind(**fields)

    def publish_text(self, text: str) -> None:
        """Publish the text of a command."""
        self.until(self.commands.get_subscription_count, "the executive")
        self.commands.publish(String(data=text))

    def ended(self, number: int) -> dict[str, Any]:
        """Return the terminal report of a command."""
        ends = {"EXECUTED", "REJECTED", "FAILED", "CANCELLED", "EXPIRED"}

        def found() -> dict[str, Any] | None:
            mine = (each for each in self.reports if each["id"] == number)
            return next((each for each in mine if each["stage"] in ends), None)

        end: dict[str, Any] = self.until(found, f"end of {number}")
        return end


def pose_of(x_m: float, y_m: float, heading_rad: float = 0.0, frame: str = "odom") -> PoseStamped:
    """Return a pose as a client sends it."""
    pose = PoseStamped()
    pose.header.frame_id = frame
    pose.pose.position.x, pose.pose.position.y = x_m, y_m
    half_rad = wrap_rad(heading_rad) / 2 if abs(heading_rad) <= pi else 0.0
    pose.pose.orientation.z, pose.pose.orientation.w = sin(half_rad), cos(half_rad)
    return pose


@contextmanager
def ros_client(*, drives: bool = True) -> Iterator[RosClient]:
    """Yield a client that a thread of its own spins; `drives` if it is the rover, too."""
    with ros_node("client" if drives else "flood", NAME) as node:
        executor, closing = SingleThreadedExecutor(context=node.context), False
        client = RosClient(node, drives)
        executor.add_node(node)

        def spin() -> None:
            while not closing:
                executor.spin_once(timeout_sec=0.1)

        thread = Thread(target=spin, name="client")
        thread.start()
        try:
            yield client
        finally:
            closing = True
            thread.join()
            executor.shutdown()
