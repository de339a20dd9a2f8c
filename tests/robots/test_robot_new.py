"""`rover robot new`: both files of an asset, which the executive reads and drives by."""

import os
import re
import shutil
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CompressedImage, Imu, JointState

from adapters.cli.robot import robot
from adapters.ros import (
    Topics,
    declare_rate,
    declare_sensor_topics,
    declare_topics,
    ros_node,
    wheels_of,
)
from executive.commands.catalogue import MoveForward
from executive.settings import Settings, load_settings, ros_parameter_file
from tests.robots.check_process import COMMAND
from tests.robots.interfaces import INTERFACES
from tests.suite import CHECKOUT
from tests.support.ground import carry_out, until_located
from tests.support.patience import shipped_config, shipped_names
from tests.support.processes import LISTENS, Running

pytestmark = [pytest.mark.ros, pytest.mark.slow]

ROBOTS = CHECKOUT / "config" / "robots"
SHIPPED = shipped_names(ROBOTS)
FOUND = (("clearpath_j100", "/j100_0001"), ("turtlebot4", "/"), ("leo", "/"))
"""Robots that are looked for, and their namespaces: of each way in which they differ."""
PLAYED = FOUND if os.environ.get("ROBOTS") == "all" else FOUND[:1]
SPEED = ("--speed", "3", "--rest-speed", "0.7")
"""Of their time: a busy machine is late by less of it. Driven, it waits for each velocity."""


@pytest.fixture(autouse=True)
def config(ros_domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give a configuration of one's own, with the shipped robots, and a ROS domain."""
    assert ros_domain
    folder = tmp_path / "config"
    shutil.copytree(shipped_config(tmp_path / "shipped", ROBOTS), folder / "robots")
    monkeypatch.setenv("ROVER_CONFIG", str(folder))
    monkeypatch.setenv("PYTHONPATH", str(CHECKOUT))
    return folder


def new(*arguments: str) -> Result:
    return CliRunner().invoke(robot, ["new", *arguments], catch_exceptions=False)


def loaded(name: str) -> tuple[Settings, Topics]:
    """Read both files as the executive does."""
    settings = load_settings(name)
    with ros_node("reader", name, parameters=ros_parameter_file(name)) as node:
        topics = declare_topics(node)
        sensors = declare_sensor_topics(node, settings.sensors)
        assert sensors.topics.keys() == settings.sensors.present
        assert declare_rate(node, "tree_hz", "tree") > 0
    return settings, topics


@contextmanager
def standing(name: str, folder: Path) -> Iterator[Running]:
    process = Running(
        folder / f"{name}.log",
        *(sys.executable, "-m", "tests.robots.standin", name, *SPEED),
        cwd=CHECKOUT,
    )
    try:
        process.output("is there")
        yield process
    finally:
        process.clean_up()


@pytest.mark.parametrize("like", SHIPPED)
def test_files_after_a_shipped_robot_are_read(like: str) -> None:
    done = new("scout", "--like", like)
    assert done.exit_code == 0, done.output
    settings, topics = loaded("scout")
    shipped = load_settings(f"robots/{like}")
    text = (CHECKOUT / f"config/robots/{like}.ros.yaml").read_text()
    assert (settings.asset, settings.domain) == ("scout", ("meteron", "scout"))
    assert (settings.drive, settings.sensors) == (shipped.drive, shipped.sensors)
    assert f"cmd_vel: {{topic: {topics.cmd_vel.name}," in text
    assert not re.search(rf"(?m)^(asset|domain):.*{like}", done.output)


def test_files_after_a_shipped_robot_are_moved_to_its_namespace() -> None:
    assert new("scout", "--like", "clearpath", "--namespace", "a200_0815").exit_code == 0
    _, topics = loaded("scout")
    assert topics.odometry.name == "/a200_0815/platform/odom/filtered"
    assert topics.cmd_vel.name == "/a200_0815/cmd_vel"


def test_minimal_files_have_nothing_of_another_robot(config: Path) -> None:
    done = new("scout", "--minimal")
    assert done.exit_code == 0, done.output
    settings, topics = loaded("scout")
    assert (settings.asset, settings.description) == ("scout", "scout")
    assert (topics.odometry.name, topics.cmd_vel.name) == ("/odom", "/cmd_vel")
    assert not settings.sensors.present
    assert not any((topics.battery, topics.camera, settings.mass_kg, settings.mux))
    made = config / "scout.yaml", config / "scout.ros.yaml"
    text = "".join(path.read_text() for path in made)
    assert not re.search("jackal|minimal|clearpath", text, re.IGNORECASE)
    number = text.splitlines().index("  travel_speed_mps: 0.2") + 1
    assert f"{number:4}  travel_speed_mps: 0.2\n" in done.output


def test_files_in_an_installed_package_have_a_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "share" / "rover_executive" / "config"
    folder.mkdir(parents=True)
    monkeypatch.setenv("ROVER_CONFIG", str(folder))
    assert f"copy all of {folder} to a folder of yours" in new("scout", "--minimal").output
    refused = new("bender", "--like", "leo")
    assert f"{folder}/robots has no robots: set ROVER_CONFIG" in refused.output


@pytest.mark.parametrize("end", [".yaml", ".ros.yaml"])
def test_no_file_is_overwritten(end: str, config: Path) -> None:
    there = config / f"scout{end}"
    there.write_text("mine")
    done = new("scout", "--minimal")
    assert done.exit_code == 2
    assert f"{there} exists" in done.output
    assert [path.name for path in config.glob("*.yaml")] == [f"scout{end}"]
    assert there.read_text() == "mine"


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("scout", "--like", "vector"), 2, "'vector' is none of ackermann, clearpath_j100, "),
        (("scout", "--like", "husarion"), 2, "'husarion' may be panther or rosbot_xl"),
        (("scout", "--like", "leo", "--minimal"), 2, "exclude each other"),
        (("../scout", "--minimal"), 2, "letters, digits and single _"),
        (("scout", "--namespace", "a b"), 2, "no ROS namespace"),
        (
            ("scout", "--seconds", "1"),
            1,
            "no robot in namespace /: no node publishes nav_msgs/Odometry and no node subscribes",
        ),
    ],
)
def test_an_error_is_one_line(
    arguments: tuple[str, ...], code: int, said: str, config: Path
) -> None:
    done = new(*arguments)
    assert done.exit_code == code
    assert said in done.output.splitlines()[-1]
    assert not list(config.glob("*.yaml"))


@pytest.mark.parametrize(("name", "namespace"), PLAYED, ids=lambda each: each.strip("/"))
def test_a_robot_that_is_found_is_driven_without_an_edited_line(
    name: str, namespace: str, tmp_path: Path
) -> None:
    with ExitStack() as running:
        running.enter_context(standing(name, tmp_path))
        done = new("scout")
        assert done.exit_code == 0, done.output
        assert f"Found in namespace {namespace}:" in done.output
        settings, topics = loaded("scout")
        interface = INTERFACES[name]
        assert topics.battery is not None, done.output
        best_effort = topics.odometry.qos.reliability is ReliabilityPolicy.BEST_EFFORT
        assert best_effort == interface.odometry.best_effort
        assert settings.camera.formats == ("JPG",)
        assert (settings.sensors.imu is not None) == (name != "leo"), "it has no orientation"
        process = Running(
            tmp_path / "executive.log",
            *(sys.executable, "-m", "adapters.onboard.process", "--asset", "scout"),
            *("--port", "0", "--data", str(tmp_path / "data")),
            cwd=CHECKOUT,
        )
        running.callback(process.clean_up)
        uri = process.output(LISTENS)
        until_located(uri)
        (outcome,) = carry_out(uri, MoveForward(1.0))
        assert outcome.executed, outcome.reports[-1].text
        assert process.end() == 0


def test_of_two_robots_one_is_chosen(tmp_path: Path) -> None:
    with standing("panther", tmp_path), standing("clearpath_j100", tmp_path):
        any_robot = Running(tmp_path / "any.log", COMMAND, "new", "rover", "--seconds", "7")
        try:
            assert new("scout", "--namespace", "panther", "--seconds", "7").exit_code == 0
            assert any_robot.ended() == 1
        finally:
            any_robot.clean_up()
    assert "several namespaces take velocities, /j100_0001, /panther:" in any_robot.text
    _, topics = loaded("scout")
    assert topics.odometry.name == "/panther/odometry/filtered"
    stop = topics.emergency_stop
    assert stop is not None
    assert stop.qos.durability is DurabilityPolicy.TRANSIENT_LOCAL


def test_of_several_topics_the_choice_is_told() -> None:
    best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)  # type: ignore[no-untyped-call]
    with ros_node("robot", "") as node, ros_node("joystick", "") as other:
        for topic in ("odom", "odometry/filtered", "gps/odometry"):
            node.create_publisher(Odometry, topic, 1)
        node.create_publisher(Odometry, "odometry/filtered", best_effort)
        node.create_publisher(Imu, "imu", 1)
        for topic in ("depth/image/compressed", "image/compressed"):
            node.create_publisher(CompressedImage, topic, 1)
        for topic in ("cmd_vel_smoothed", "cmd_vel"):
            node.create_subscription(TwistStamped, topic, lambda _: None, 1)
        other.create_publisher(Twist, "cmd_vel", 1)  # drives nothing: the base takes another type
        done = new("scout", "--seconds", "4")
    assert done.exit_code == 0, done.output
    for pattern in (
        r"odometry +/odometry/filtered .*; not chosen: /odom, /gps/odometry\n",
        r"cmd_vel +/cmd_vel .*; not chosen: /cmd_vel_smoothed\n",
        r"camera +/image/compressed .*; not chosen: /depth/image/compressed\n",
        r"imu +/imu .*; not used: no message arrived\n",
    ):
        assert re.search(pattern, done.output), done.output
    settings, topics = loaded("scout")
    assert topics.odometry.name == "/odometry/filtered"
    assert topics.odometry.qos.reliability is ReliabilityPolicy.BEST_EFFORT
    assert topics.cmd_vel.type is TwistStamped
    assert topics.camera is None
    assert not settings.sensors.present


@pytest.mark.parametrize("name", [name for name, each in INTERFACES.items() if each.joints])
def test_wheels_are_found_by_their_names(name: str) -> None:
    joints = INTERFACES[name].joints
    assert joints is not None
    names = [*joints.right[::-1], "camera_pan_joint", *joints.left[::-1]]
    wheels = wheels_of(JointState(name=names))
    assert (wheels.left, wheels.right) == (joints.left, joints.right)
