"""`rover robot check` on stand-ins in other processes: what it finds, and how it drives."""

import json
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import pi
from pathlib import Path
from typing import Any

import pytest
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor

from adapters.ros import ros_node, single_threaded
from tests.robots.test_robots import LIMIT_S, module, where
from tests.suite import CHECKOUT
from tests.support.processes import Running

pytestmark = [pytest.mark.ros, pytest.mark.slow]

COMMAND = "adapters.cli.robot:robot"


@pytest.fixture(autouse=True)
def _environment(ros_domain: int, monkeypatch: pytest.MonkeyPatch) -> None:
    assert ros_domain > 0
    monkeypatch.setenv("PYTHONPATH", str(CHECKOUT))


@contextmanager
def standin(folder: Path, name: str) -> Iterator[Running]:
    with module(folder / "robot.log", "tests.robots.standin", name) as process:
        process.output("is there")
        yield process


@contextmanager
def checking(folder: Path, asset: str, *options: str) -> Iterator[Running]:
    # A lost announcement of a publisher is repeated after 3 s, and again after 3 s.
    arguments = ("check", asset, "--seconds", "8", *options)
    process = Running(folder / "check.log", COMMAND, *arguments)
    try:
        yield process
    finally:
        process.clean_up()


def checked(folder: Path, asset: str, *options: str) -> dict[str, Any]:
    with checking(folder, asset, "--json", *options) as process:
        process.ended()
        lines = process.text.splitlines()
    assert lines[-1].startswith("{"), process.text
    found: dict[str, Any] = json.loads(lines[-1])
    return found


def edited(folder: Path, robot: str, *changes: tuple[str, str]) -> str:
    """Return an asset file of a robot, with other lines in its ROS parameters."""
    source = CHECKOUT / "config" / "robots"
    text = (source / f"{robot}.ros.yaml").read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / f"{robot}.ros.yaml").write_text(text, encoding="utf-8")
    asset = folder / f"{robot}.yaml"
    asset.write_bytes((source / asset.name).read_bytes())
    return str(asset)


def test_each_topic_that_does_not_fit_is_named_with_its_line(tmp_path: Path) -> None:
    asset = edited(
        tmp_path,
        "turtlebot4",
        ("/odom, reliability: best_effort", "/odom, reliability: reliable"),
        ("{topic: /cmd_vel,", "{topic: /cmd_vel, type: geometry_msgs/msg/TwistStamped,"),
        ("topic: /imu,", "topic: /imu/data,"),
    )
    with standin(tmp_path, "turtlebot4") as robot:
        found = checked(tmp_path, asset, "--write")
        robot.end()
        assert where(robot.text) == (0.0, 0.0, 0.0), "it moves with --drive only"
    problems = {each["key"]: "".join(each["problems"]) for each in found["topics"]}
    assert "publisher is best_effort, the asset reliable" in problems["odometry"]
    assert problems["cmd_vel"] == "subscribed to as Twist, the asset has TwistStamped"
    assert problems["imu"] == "no publisher of /imu/data; /imu (Imu) would fit"
    assert problems["camera"] == ""
    assert not found["fits"]
    lines = found["changes"]["turtlebot4.ros.yaml"]
    for line in (
        "odometry: {topic: /odom, reliability: best_effort, depth: 50}",
        "cmd_vel: {topic: /cmd_vel, type: geometry_msgs/msg/Twist, reliability: reliable, depth",
        "imu: {topic: /imu, reliability: best_effort, depth: 100}",
    ):
        assert line in lines
        assert line in (tmp_path / "turtlebot4.ros.yaml").read_text(encoding="utf-8")
    assert str(tmp_path / "turtlebot4.ros.yaml") in found["written"]


def test_a_robot_that_is_absent_is_reported(tmp_path: Path) -> None:
    with checking(tmp_path, "robots/turtlebot4") as check:
        assert check.ended() == 1
        assert "odometry: no publisher of /odom" in check.text
        assert "no node has any of these topics" in check.text
        assert "the speed hardly changed" not in check.text
        assert "topic: ''" not in check.text, "a robot that is absent has no topic less"


def test_the_files_of_another_robot_are_reported_with_its_topics(tmp_path: Path) -> None:
    with standin(tmp_path, "tracked"):
        found = checked(tmp_path, "robots/turtlebot4")
    assert "odometry: {topic: /diff_cont/odom," in found["changes"]["turtlebot4.ros.yaml"]


def test_a_car_turns_along_an_arc(tmp_path: Path) -> None:
    with standin(tmp_path, "ackermann") as robot:
        found = checked(tmp_path, "robots/ackermann", "--drive", "--yes")
        robot.end()
        _, y_m, heading_rad = where(robot.text)
    assert heading_rad == pytest.approx(pi / 2, abs=0.1)
    assert y_m == pytest.approx(0.65, abs=0.15), "its radius"
    assert found["figures"]["twist"]["mean_s"] == pytest.approx(0.2, abs=0.04)


def test_a_drive_finds_the_figures_of_the_robot(tmp_path: Path) -> None:
    asset = edited(tmp_path, "clearpath_j100", ("odom/filtered", "odom"))
    with standin(tmp_path, "j100_wheels") as robot:
        found = checked(tmp_path, asset, "--namespace", "j100_0001", "--drive", "--yes")
        robot.end()
        x_m, y_m, heading_rad = where(robot.text)
    assert (x_m, y_m) == pytest.approx((0.5, 0.0), abs=0.05)
    assert heading_rad == pytest.approx(pi / 2, abs=0.1)
    figures = found["figures"]
    assert figures["twist"]["mean_s"] == pytest.approx(0.2, abs=0.04)
    assert figures["gyro_turn"] == pytest.approx(1.11, abs=0.02)
    assert figures["mounting"]["up"] == pytest.approx([0.0, 0.0, 1.0], abs=0.02)
    assert "track_m: 0.6" in found["changes"]["clearpath_j100.yaml"]
    assert "twist_mean_s: 0." in found["changes"]["clearpath_j100.yaml"]
    velocity = next(each for each in found["topics"] if each["key"] == "cmd_vel")
    assert velocity["peers"] == ["/j100_0001/j100_wheels as TwistStamped"]
    assert velocity["problems"] == []


def until(executor: SingleThreadedExecutor, done: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + LIMIT_S
    while not done():
        assert time.monotonic() < deadline_s
        executor.spin_once(timeout_sec=0.1)


DRIVE = ("--namespace", "j100_0001", "--drive", "--yes")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_stops_the_drive(number: signal.Signals, tmp_path: Path) -> None:
    speeds: list[float] = []

    def on_velocity(message: Any) -> None:
        speeds.append(message.twist.linear.x)

    with (
        standin(tmp_path, "clearpath_j100"),
        ros_node("observer", "j100_0001") as node,
        single_threaded(node) as executor,
        checking(tmp_path, "robots/clearpath_j100", *DRIVE) as check,
    ):
        node.create_subscription(TwistStamped, "cmd_vel", on_velocity, 10)
        check.output("WILL MOVE")
        until(executor, lambda: any(speeds))
        check.send(number)
        until(executor, lambda: not speeds[-1])
        assert check.ended() != 0
    assert len(speeds) < 20, "the drive takes longer"


def test_a_drive_without_odometry_is_ended(tmp_path: Path) -> None:
    with standin(tmp_path, "clearpath_j100") as robot:
        with checking(tmp_path, "robots/clearpath_j100", *DRIVE) as check:
            check.output("WILL MOVE")
            robot.send(signal.SIGSTOP)
            assert check.ended() == 1
            assert "the rover was stopped: no odometry for 0.5 s" in check.text
        robot.send(signal.SIGCONT)
        robot.end()
        assert where(robot.text)[0] < 0.4


def test_a_robot_that_does_not_fit_is_not_driven(tmp_path: Path) -> None:
    changes = ("topic: /cmd_vel,", "topic: /velocity,"), ("wheel_FL_joint", "front_left")
    asset = edited(tmp_path, "leo", *changes)
    with standin(tmp_path, "leo") as robot:
        with checking(tmp_path, asset, "--drive", "--yes") as check:
            assert check.ended() == 1
            assert (
                "it is not driven: cmd_vel: no subscriber of /velocity; /cmd_vel (Twist)"
                in check.text
            )
        with checking(tmp_path, asset) as check:
            assert check.ended() == 1
            assert "joint states lack front_left; they name wheel_FL_joint" in check.text
        robot.end()
        assert where(robot.text) == (0.0, 0.0, 0.0)


def test_a_robot_whose_emergency_stop_is_active_is_not_driven(tmp_path: Path) -> None:
    with standin(tmp_path, "panther"):
        options = ("--namespace", "panther", "--drive", "--yes")
        with checking(tmp_path, "robots/panther", *options) as check:
            assert check.ended() == 1
            assert "it is not driven: emergency_stop: it is active: release it" in check.text


def test_frozen_odometry_ends_the_drive(tmp_path: Path) -> None:
    asset = edited(tmp_path, "rosbot_xl", ("rosbot_base_controller/odom", "frozen"))
    with (
        standin(tmp_path, "rosbot_xl") as robot,
        ros_node("frozen", "") as node,
        single_threaded(node) as executor,
        checking(tmp_path, asset, "--drive", "--yes") as check,
    ):
        publisher = node.create_publisher(Odometry, "/frozen", 10)
        message = Odometry()
        message.pose.pose.orientation.w = 1.0

        def publish() -> None:
            message.header.stamp = node.get_clock().now().to_msg()
            publisher.publish(message)

        node.create_timer(0.05, publish)
        until(executor, lambda: "by its odometry" in check.text)
        assert check.ended() == 1
        assert "drive, m: 0.5" in check.text
        robot.end()
        assert where(robot.text)[0] < 0.7
