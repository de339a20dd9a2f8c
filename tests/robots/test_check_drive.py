"""`rover robot check --drive` with robots in other processes: its motion, its figures, its ends."""

import signal
import time
from collections.abc import Callable
from math import pi
from pathlib import Path
from typing import Any

import pytest
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor

from adapters.ros import ros_node, single_threaded
from tests.robots.check_process import checked, checking, edited, standin
from tests.robots.test_robots import LIMIT_S, where
from tests.suite import CHECKOUT

pytestmark = [pytest.mark.ros, pytest.mark.slow]


@pytest.fixture(autouse=True)
def _environment(ros_domain: int, monkeypatch: pytest.MonkeyPatch) -> None:
    assert ros_domain > 0
    monkeypatch.setenv("PYTHONPATH", str(CHECKOUT))


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
