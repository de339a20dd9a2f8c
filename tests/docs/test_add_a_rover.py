"""The rovers of the page: their files, a real executive on them, a stand-in on ROS that moves."""

import subprocess
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import pytest
from nav_msgs.msg import Odometry as OdometryMessage
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray, String

from adapters.mrs.ground import CommandOutcome
from adapters.ros import (
    Topics,
    declare_topic,
    declare_topics,
    odometry_message,
    ros_node,
    single_threaded,
)
from executive.commands.catalogue import MoveForward, RotateBy
from executive.settings import config_folder
from executive.values.facts import MotionEnded, Odometry
from executive.values.geometry import Velocity
from executive.values.ports import DelegatedMotion, DriveBy, TurnBy
from executive.values.reports import Identity
from tests.docs.pages import CHECKOUT, blocks, lines
from tests.support.ground import carry_out, until_located
from tests.support.kinematic import KinematicRover
from tests.support.patience import shipped_config
from tests.support.processes import executive
from tests.support.self_moving import SelfMovingRover

PAGE = CHECKOUT / "docs" / "add-a-rover.md"
STEP_S = 0.02

pytestmark = [pytest.mark.ros, pytest.mark.slow]


class Substitute:
    """Says where the rover is, and lets it move for as long as it is served."""

    def __init__(self, node: Node, executor: SingleThreadedExecutor, rover: KinematicRover) -> None:
        self.rover = rover
        self.node = node
        self.topics: Topics = declare_topics(node)
        self._executor = executor
        odometry = self.topics.odometry
        self._odometry = node.create_publisher(OdometryMessage, odometry.name, odometry.qos)
        self._time_s = self._now_s
        node.create_timer(STEP_S, self.step)

    def step(self) -> None:
        """Go on to this time in steps of one length, however late the timer comes."""
        while self._time_s + STEP_S <= self._now_s:
            self._time_s += STEP_S
            self.rover.advance(STEP_S)
            reported = Odometry(self._time_s, self.rover.pose, self.rover.velocity)
            self._odometry.publish(odometry_message(reported))

    @property
    def _now_s(self) -> float:
        return float(self.node.get_clock().now().nanoseconds * 1e-9)

    def serve(self, done: "Future[list[CommandOutcome]]") -> list[CommandOutcome]:
        while not done.done():
            self._executor.spin_once(timeout_sec=STEP_S)
        return done.result()


class TakesWheelSpeeds(Substitute):
    """Moves by the speeds of its wheels, of radius 0.1 m and 0.4 m apart."""

    def __init__(self, node: Node, executor: SingleThreadedExecutor) -> None:
        super().__init__(node, executor, KinematicRover())
        wheels = declare_topic(node, "wheel_speeds", "left and right, rad/s", Float64MultiArray)
        node.create_subscription(wheels.type, wheels.name, self._take, wheels.qos)

    def _take(self, message: Float64MultiArray) -> None:
        left_mps, right_mps = (0.1 * each for each in message.data)
        self.rover.drive(Velocity((left_mps + right_mps) / 2, (right_mps - left_mps) / 0.4))


class TakesLines(Substitute):
    """Carries out whole motions, told by lines."""

    rover: SelfMovingRover

    def __init__(self, node: Node, executor: SingleThreadedExecutor) -> None:
        super().__init__(node, executor, SelfMovingRover())
        command = declare_topic(node, "motion_command", "motions", String)
        reply = declare_topic(node, "motion_reply", "how they ended", String)
        self._replies = node.create_publisher(String, reply.name, reply.qos)
        node.create_subscription(String, command.name, self._take, command.qos)

    def _take(self, line: String) -> None:
        match line.data.split():
            case ["halt"]:
                self.rover.halt()
            case [number, "turn", angle_rad, speed_radps]:
                self._begin(number, TurnBy(float(angle_rad), float(speed_radps)))
            case [number, "advance", distance_m, speed_mps]:
                self._begin(number, DriveBy(float(distance_m), float(speed_mps)))
            case _:
                raise AssertionError(f"no motion: {line.data}")

    def _begin(self, number: str, what: TurnBy | DriveBy) -> None:
        self.rover.execute_motion(DelegatedMotion(int(number), what, Identity("", 0)))

    def step(self) -> None:
        super().step()
        reported, self.rover.facts = self.rover.facts, []
        for fact in reported:
            assert isinstance(fact, MotionEnded)
            how = "done" if fact.executed else f"failed: {fact.text}"
            self._replies.publish(String(data=f"{fact.number} {how}"))


def follow(page: Path, asset: str, folder: Path) -> list[str]:
    """Do what the page says to have an asset; return the command line that starts it."""
    shipped_config(folder, config_folder())
    (folder / "rovers").mkdir()
    (code,) = (block for block in blocks(page, "python") if f"class {asset.title()}(" in block)
    (folder / "rovers" / f"{asset}.py").write_text(code)
    for line in lines(page):
        if f"config/{asset}" in line.text:
            subprocess.run(line.text, shell=True, cwd=folder, check=True)
    if asset == "beetle":
        (topics,) = blocks(page, "yaml")
        with (folder / "config" / "beetle.ros.yaml").open("a") as parameters:
            parameters.write(topics)
    (start,) = (text for text in blocks(page, "console") if asset in text)
    return start.split()


@contextmanager
def begun(
    asset: str, kind: type[TakesWheelSpeeds | TakesLines], folder: Path
) -> Iterator[Substitute]:
    parameters = folder / "config" / f"{asset}.ros.yaml"
    with ros_node("base", asset, parameters=parameters) as node, single_threaded(node) as executor:
        yield kind(node, executor)


def move(uri: str) -> list[CommandOutcome]:
    until_located(uri)
    return carry_out(uri, MoveForward(0.1), RotateBy(0.3))


@pytest.mark.parametrize(("asset", "kind"), [("scarab", TakesWheelSpeeds), ("beetle", TakesLines)])
def test_a_rover_of_the_page_is_commanded_and_moves(
    asset: str,
    kind: type[TakesWheelSpeeds | TakesLines],
    ros_domain: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert ros_domain
    path, command, *options = follow(PAGE, asset, tmp_path)
    assert command == ".venv/bin/rover-executive"
    monkeypatch.setenv("ROVER_CONFIG", str(tmp_path / "config"))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / path.removeprefix("PYTHONPATH=")))
    with (
        begun(asset, kind, tmp_path) as substitute,
        executive(tmp_path, *options) as (process, uri),
        ThreadPoolExecutor(1) as another,
    ):
        job = another.submit(move, uri)
        outcomes = substitute.serve(job)
        assert [outcome.executed for outcome in outcomes] == [True, True], process.text
        assert substitute.rover.pose.x_m == pytest.approx(0.1, abs=0.04)
        assert substitute.rover.pose.heading_rad == pytest.approx(0.3, abs=0.05)
        assert process.end() == 0
