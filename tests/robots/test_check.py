"""`rover robot check` with robots in other processes: the problems that it reports."""

from pathlib import Path

import pytest

from tests.robots.check_process import checked, checking, edited, standin
from tests.robots.test_robots import where
from tests.suite import CHECKOUT

pytestmark = [pytest.mark.ros, pytest.mark.slow]


@pytest.fixture(autouse=True)
def _environment(ros_domain: int, monkeypatch: pytest.MonkeyPatch) -> None:
    assert ros_domain > 0
    monkeypatch.setenv("PYTHONPATH", str(CHECKOUT))


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


def test_a_robot_that_does_not_fit_is_not_driven(tmp_path: Path) -> None:
    changes = ("topic: /cmd_vel,", "topic: /velocity,"), ("wheel_FL_joint", "front_left")
    asset = edited(tmp_path, "leo", *changes)
    with standin(tmp_path, "leo") as robot:
        with (
            checking(tmp_path, asset, "--drive", "--yes") as drive,
            checking(tmp_path, asset) as check,
        ):
            assert drive.ended() == 1
            reason = "it is not driven: cmd_vel: no subscriber of /velocity; /cmd_vel (Twist)"
            assert reason in drive.text
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
