"""What the executive's process costs: octets of a stop to zero velocity, CPU and memory."""

import random
import re
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from math import cos, sin
from pathlib import Path

import psutil
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data

from adapters.ros import ros_node, single_threaded
from executive.commands.catalogue import DriveFor, Resume, Stop
from executive.settings import config_folder, load_settings
from tests.benchmarks.large_tree import TREE_NODES
from tests.benchmarks.octets import Octets
from tests.support.figures import Figure, Goal, cpu_s, quantile
from tests.support.victims import workplace

ODOMETRY_S = 0.02


class Substitute:
    """Moves exactly as told on `/jackal/executive/cmd_vel`, and listens to `/echo/cmd_vel` too.

    Attributes:
        moving: set while the last velocity on `/jackal/executive/cmd_vel` was not zero.
    """

    def __init__(self, node: Node) -> None:
        self.moving = threading.Event()
        self._zero_at_s = {"jackal": 0.0, "echo": 0.0}
        self._zero = {"jackal": threading.Event(), "echo": threading.Event()}
        self._twist = Twist()
        self._x_m = self._y_m = self._heading_rad = 0.0
        self._clock = node.get_clock()
        self._odometry = node.create_publisher(
            Odometry, "platform/odom/filtered", qos_profile_sensor_data
        )
        node.create_subscription(TwistStamped, "executive/cmd_vel", self._drive, 1)
        node.create_subscription(Twist, "/echo/cmd_vel", self._echo, 1)
        node.create_timer(ODOMETRY_S, self._publish)

    def expect_zero(self, name: str) -> None:
        self._zero[name].clear()

    def zero_arrived(self, name: str, timeout_s: float) -> bool:
        return self._zero[name].wait(timeout_s)

    def wait_zero(self, name: str, timeout_s: float) -> float:
        """Wait for a zero velocity, and return when it came, by `time.perf_counter`.

        Raises:
            TimeoutError: none came.
        """
        if not self.zero_arrived(name, timeout_s):
            raise TimeoutError(f"no zero velocity from {name} within {timeout_s} s")
        return self._zero_at_s[name]

    def _drive(self, message: TwistStamped) -> None:
        now_s = time.perf_counter()
        self._twist = twist = message.twist
        if twist.linear.x == 0.0 and twist.angular.z == 0.0:
            if not self._zero["jackal"].is_set():
                self._zero_at_s["jackal"] = now_s
                self._zero["jackal"].set()
            self.moving.clear()
        else:
            self.moving.set()

    def _echo(self, _: Twist) -> None:
        self._zero_at_s["echo"] = time.perf_counter()
        self._zero["echo"].set()

    def _publish(self) -> None:
        travel, rotate = self._twist.linear.x, self._twist.angular.z
        self._heading_rad += rotate * ODOMETRY_S
        self._x_m += travel * ODOMETRY_S * cos(self._heading_rad)
        self._y_m += travel * ODOMETRY_S * sin(self._heading_rad)
        message = Odometry()
        message.header.stamp = self._clock.now().to_msg()
        message.header.frame_id, message.child_frame_id = "odom", "base_link"
        message.pose.pose.position.x, message.pose.pose.position.y = self._x_m, self._y_m
        message.pose.pose.orientation.z = sin(self._heading_rad / 2)
        message.pose.pose.orientation.w = cos(self._heading_rad / 2)
        message.twist.twist = self._twist
        self._odometry.publish(message)


@contextmanager
def substitute(domain: int) -> Iterator[Substitute]:
    """Yield a stand-in that moves in a ROS domain until the `with` ends."""
    ended = threading.Event()
    with (
        ros_node("stand_in", "jackal", domain_id=domain) as node,
        single_threaded(node) as executor,
    ):
        rover = Substitute(node)

        def spin() -> None:
            while not ended.is_set():
                executor.spin_once(timeout_sec=0.1)

        thread = threading.Thread(target=spin)
        thread.start()
        try:
            yield rover
        finally:
            ended.set()
            thread.join()


WARM_UP = 10
ANSWER_S = 30.0
START_S = 60.0
MS = 1000.0


def measure_stops(samples: int) -> list[Figure]:
    """Return the figures of stops and echoes taken in turn, in one run."""
    with workplace() as workspace:
        executive = workspace.start("executive", "tests.benchmarks.large_tree", workspace.folder)
        echo = workspace.start("echo", "tests.benchmarks.bare_ros", "echo")
        with substitute(workspace.domain) as rover:
            stops_ms, echoes_ms = _in_turn(
                Octets(executive.port()), Octets(echo.port()), rover, samples
            )
    beside = f"{samples} stops while moving, tree of {TREE_NODES} nodes"
    above = "bare MAL-in, ROS-out echo, in turn"
    figures = []
    for name, ratio, goal in (("median", 0.5, 1.0), ("p99", 0.99, 5.0)):
        stop_ms, echo_ms = quantile(stops_ms, ratio), quantile(echoes_ms, ratio)
        figures += [
            Figure(f"stop to zero, {name}", stop_ms, "ms", beside),
            Figure(f"echo, {name}", echo_ms, "ms", above),
            Figure(f"stop above echo, {name}", stop_ms - echo_ms, "ms", above, Goal(goal)),
        ]
    return figures


def _in_turn(
    commands: Octets, echoes: Octets, rover: Substitute, samples: int
) -> tuple[list[float], list[float]]:
    with commands, echoes:
        _wait_until_driven(commands, rover)
        _wait_until_echoed(echoes, rover)
        chance, stops_ms, echoes_ms = random.Random(1), [], []
        for sample in range(WARM_UP + samples):
            stop_s = _stop(commands, rover, chance)
            echo_s = _echo(echoes, rover)
            if sample >= WARM_UP:
                stops_ms.append(MS * stop_s)
                echoes_ms.append(MS * echo_s)
    return stops_ms, echoes_ms


def _wait_until_driven(commands: Octets, rover: Substitute) -> None:
    """Drive for the first time: until odometry and velocities find their way, that is refused."""
    deadline_s = time.monotonic() + ANSWER_S
    while not rover.moving.wait(0.2):
        if time.monotonic() > deadline_s:
            raise TimeoutError("the executive does not drive")
        commands.request(DriveFor(0.5, 0.0, 60.0))


def _wait_until_echoed(echoes: Octets, rover: Substitute) -> None:
    """Have an echo heard for the first time: until its topic is found, it is lost."""
    deadline_s = time.monotonic() + ANSWER_S
    rover.expect_zero("echo")
    while not rover.zero_arrived("echo", 0.2):
        if time.monotonic() > deadline_s:
            raise TimeoutError("the echo is not heard")
        echoes.send(echoes.command(Stop()))


def _stop(commands: Octets, rover: Substitute, chance: random.Random) -> float:
    message = commands.command(Stop())
    time.sleep(chance.uniform(0.0, 0.06))
    rover.expect_zero("jackal")
    began_s = time.perf_counter()
    commands.send(message)
    delay_s = rover.wait_zero("jackal", ANSWER_S) - began_s
    commands.reply()
    commands.request(Resume())
    commands.request(DriveFor(0.5, 0.0, 60.0))
    if not rover.moving.wait(ANSWER_S):
        raise TimeoutError("the executive does not drive after a stop")
    return delay_s


def _echo(echoes: Octets, rover: Substitute) -> float:
    message = echoes.command(Stop())
    rover.expect_zero("echo")
    began_s = time.perf_counter()
    echoes.send(message)
    return rover.wait_zero("echo", ANSWER_S) - began_s


SETTLE_S = 3.0
MB = 1e6


def measure_footprint(duration_s: float = 20.0) -> list[Figure]:
    """Return CPU and memory of both, driving, with all sensors, and the size of the recording."""
    with workplace() as workspace:
        asset = _all_sensors(workspace.folder)
        workspace.start(
            "simulation", "sim.ros.process", "--asset", asset, "--world", "flat", "--camera", "off"
        )
        executive = workspace.start(
            "executive", "adapters.onboard.process",
            "--asset", asset, "--port", 0, "--data", workspace.folder / "data",
        )  # fmt: skip
        bare = workspace.start("bare", "tests.benchmarks.bare_ros", "node")
        with (
            ros_node("witness", "jackal", domain_id=workspace.domain) as node,
            single_threaded(node) as executor,
            Octets(executive.port()) as commands,
        ):
            sent: list[TwistStamped] = []
            node.create_subscription(TwistStamped, "executive/cmd_vel", sent.append, 1)

            def drives() -> bool:
                sent.clear()
                executor.spin_once(timeout_sec=0.2)
                return any(each.twist.linear.x for each in sent)

            deadline_s = time.monotonic() + START_S
            while not drives() and time.monotonic() < deadline_s:
                commands.request(DriveFor(0.5, 0.1, 60.0))
            time.sleep(SETTLE_S)
            measured = [psutil.Process(each.child.pid) for each in (executive, bare)]
            before = [cpu_s(process) for process in measured]
            recorded = _recorded_octets(workspace.folder)
            time.sleep(duration_s)
            recorded = _recorded_octets(workspace.folder) - recorded
            ours, theirs = (
                100 * (cpu_s(process) - began) / duration_s
                for process, began in zip(measured, before, strict=True)
            )
            resident_mb = [process.memory_info().rss / MB for process in measured]
            drives()  # what waited since before
            if not drives():
                raise TimeoutError("the executive does not drive")
    beside = "bare rclpy node, same topics, same run"
    return [
        Figure("executive, CPU", ours, "%", beside),
        Figure("bare node, CPU", theirs, "%", "of one core"),
        Figure("executive above bare node, CPU", ours - theirs, "%", beside, Goal(10.0)),
        Figure("executive, resident memory", resident_mb[0], "MB", beside, Goal(105.0)),
        Figure("bare node, resident memory", resident_mb[1], "MB", beside),
        Figure("recording", recorded / MB * 3600 / duration_s, "MB/h", "driving", Goal(40.0)),
    ]


def _recorded_octets(folder: Path) -> int:
    return sum(path.stat().st_size for path in (folder / "data" / "recordings").iterdir())


def _all_sensors(folder: Path) -> Path:
    """Write the Jackal with all the sensors that an executive can take, and return the file."""
    path = folder / "jackal.yaml"
    shipped = (config_folder() / "jackal.yaml").read_text()
    path.write_text(re.sub(r"(?m)^#(?=  (second_odometry|laser):)", "", shipped))
    settings = load_settings(str(path))
    assert settings.sensors.laser is not None
    assert settings.sensors.second_odometry is not None
    return path
