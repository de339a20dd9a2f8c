"""`rover-sim` as a ROS process: what it publishes, what it obeys, how it ends."""

import re
import signal
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from itertools import pairwise
from math import atan2, inf, nan, radians
from pathlib import Path
from typing import Any

import pytest
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Float64, String

from adapters.ros import (
    CAMERA_OPTICAL,
    ROBOT_DESCRIPTION,
    Topic,
    conversions,
    declare_sensor_topics,
    latched_qos,
)
from adapters.ros.conversions import joint_command
from adapters.ros.sensors import (
    imu_fact,
    joints_fact,
    laser_fact,
    second_odometry_fact,
)
from executive.settings import (
    ImuSettings,
    JointsSettings,
    LaserSettings,
    SecondOdometrySettings,
    Sensor,
    Sensors,
    config_folder,
)
from sim.ros.cargo import cargo_publisher
from tests.support.probe import Probe, probing
from tests.support.processes import running, simulation

pytestmark = pytest.mark.ros


def test_a_valid_mass_on_the_topic_is_aboard(ros_domain: int, tmp_path: Path) -> None:
    parameters = config_folder() / "jackal.ros.yaml"
    with (
        simulation(tmp_path, "--camera", "off") as process,
        cargo_publisher("jackal", ros_domain, parameters) as load,
    ):
        load(20.0)
        process.output(r"cargo aboard: 20 kg")
        if find_spec("tf2_msgs") is None:
            process.output("no /tf and /tf_static: this ROS has no tf2_msgs")
        load(-1.0)
        process.output(r"a cargo of -1 kg is not in 0 \.\. 50 kg")
        assert process.end() == 0


def test_the_simulation_speaks_in_the_types_of_its_topics(ros_domain: int, tmp_path: Path) -> None:
    assert ros_domain > 0
    text = (config_folder() / "jackal.ros.yaml").read_text()
    for key, kind in (
        ("battery", "type: std_msgs/msg/Float32"),
        ("camera_pan_state", "type: sensor_msgs/msg/JointState, joint: pan"),
        ("camera_pan", "type: trajectory_msgs/msg/JointTrajectory, joint: pan"),
    ):
        text, found = re.subn(rf"(\n    {key}: \{{)", rf"\1{kind}, ", text)
        assert found == 1
    parameters = tmp_path / "jackal.ros.yaml"
    parameters.write_text(text)
    with (
        simulation(tmp_path, "--camera", "off", "--ros-params", str(parameters)) as process,
        probing(parameters) as probe,
    ):
        first(probe, probe.topics.battery, lambda m: 20.0 < m.data < 30.0)
        topic = probe.topics.camera_pan
        assert topic is not None
        publisher = probe.node.create_publisher(topic.type, topic.name, topic.qos)
        probe.until(lambda: publisher.get_subscription_count() > 0, "it is subscribed")
        publisher.publish(joint_command(topic.type, "pan", 0.4, 1.0, 0.4))
        state = probe.topics.camera_pan_state
        first(probe, state, lambda m: m.name == ["pan"] and abs(m.position[0] - 0.4) < 0.02)
        assert process.end() == 0


@pytest.fixture(scope="module")
def probe(module_ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Probe]:
    """Give a probe beside a simulation that runs at twice real time."""
    assert module_ros_domain > 0
    folder = tmp_path_factory.mktemp("sim")
    asset = folder / "jackal.yaml"
    more = "\\1  second_odometry: {rate_hz: 2}\n  laser: {rate_hz: 10}\n"
    usual = (config_folder() / "jackal.yaml").read_text()
    asset.write_text(re.sub(r"(\nsensors:\n)", more, usual))
    with (
        simulation(folder, "--asset", str(asset), "--speed", "2", "--camera", "rays"),
        probing() as probe,
    ):
        yield probe


def first(probe: Probe, topic: Topic | None, fits: Callable[..., bool]) -> object:
    """Wait for the first message that fits."""
    assert topic is not None
    received: list[object] = []
    subscription = probe.node.create_subscription(
        topic.type, topic.name, received.append, topic.qos
    )
    probe.until(lambda: any(fits(message) for message in received), f"{topic.name} as it should be")
    probe.node.destroy_subscription(subscription)
    return received[-1]


def test_sensors_are_published(probe: Probe) -> None:
    topics = probe.topics

    def is_odometry(message: Odometry) -> bool:
        fact = conversions.odometry_fact(message)
        return message.header.frame_id == "odom" and fact.pose.finite

    first(probe, topics.odometry, is_odometry)
    first(
        probe,
        topics.battery,
        lambda m: 20.0 < m.voltage < 30.0,
    )
    first(probe, topics.camera_pan_state, lambda m: abs(m.data) < 0.1)
    first(probe, topics.camera_tilt_state, lambda m: abs(m.data) < 0.1)


def test_tools_receive_the_shape_of_the_rover_and_the_projection_of_its_camera(
    probe: Probe,
) -> None:
    stored = Topic(ROBOT_DESCRIPTION, String, latched_qos())
    first(probe, stored, lambda m: '<robot name="jackal">' in m.data)
    raw = probe.topics.camera_raw
    assert raw is not None
    info = Topic("camera/camera_info", CameraInfo, raw.qos)

    def of_a_pinhole(message: CameraInfo) -> bool:
        half_rad = atan2(message.height / 2, message.k[4])
        return message.header.frame_id == CAMERA_OPTICAL and half_rad == pytest.approx(
            radians(55 / 2)
        )

    first(probe, info, of_a_pinhole)


@pytest.mark.skipif(find_spec("tf2_msgs") is None, reason="this ROS has no tf2_msgs")
def test_frames_are_published(probe: Probe) -> None:
    from tf2_msgs.msg import TFMessage

    def has(child: str) -> Callable[[Any], bool]:
        return lambda m: any(each.child_frame_id == child for each in m.transforms)

    moving, still = QoSProfile(depth=100), latched_qos()  # type: ignore[no-untyped-call]
    first(probe, Topic("/tf", TFMessage, moving), has("base_link"))
    first(probe, Topic("/tf", TFMessage, moving), has("camera_link"))
    first(probe, Topic("/tf_static", TFMessage, still), has("camera_optical"))


def test_the_configured_topics_are_published(probe: Probe) -> None:
    sensors = Sensors(
        ImuSettings(100), JointsSettings(50, 1, 1), SecondOdometrySettings(2), LaserSettings(10)
    )
    reported = declare_sensor_topics(probe.node, sensors)

    def receive(sensor: Sensor, fits: Callable[[Any], bool]) -> None:
        first(probe, reported.topics[sensor], fits)

    receive(Sensor.IMU, lambda m: abs(imu_fact(m).acceleration_z_mps2 - 9.81) < 1.0)
    receive(Sensor.JOINTS, lambda m: joints_fact(m, reported.joints) is not None)
    receive(Sensor.SECOND_ODOMETRY, lambda m: second_odometry_fact(m).position_sd_m > 0.005)
    receive(Sensor.LASER, lambda m: set(laser_fact(m).ranges_m) == {inf})


def test_time_is_published_and_runs_at_the_requested_rate(probe: Probe) -> None:
    received: list[float] = []

    def retain(message: Clock) -> None:
        received.append(conversions.stamp_s(message.clock))

    probe.node.create_subscription(Clock, "/clock", retain, 10)
    probe.until(lambda: len(received) > 20, "the clock")
    steps = [after - before for before, after in pairwise(received)]
    assert min(steps) == pytest.approx(0.02)
    assert probe.fresh_truth().header.stamp.sec >= int(received[0])


@pytest.mark.usefixtures("ros_domain")
def test_time_that_a_halted_machine_cost_is_caught_up(tmp_path: Path) -> None:
    behind_s: list[float] = []

    def retain(message: Clock) -> None:
        behind_s.append(time.monotonic() - conversions.stamp_s(message.clock))

    with simulation(tmp_path, "--camera", "off") as process, probing() as probe:
        probe.node.create_subscription(Clock, "/clock", retain, 10)
        probe.until(lambda: len(behind_s) > 20, "the clock")
        usual_s = min(behind_s)
        process.send(signal.SIGSTOP)
        time.sleep(1.5)
        process.send(signal.SIGCONT)
        behind_s.clear()
        probe.until(lambda: min(behind_s, default=inf) - usual_s < 0.2, "the time as before")


def test_pictures_arrive_raw_and_compressed(probe: Probe) -> None:
    def is_picture(message: Image) -> bool:
        size = (message.height, message.width, message.step, len(message.data))
        return size == (480, 640, 640 * 3, 480 * 640 * 3) and message.encoding == "rgb8"

    first(probe, probe.topics.camera_raw, is_picture)
    first(
        probe,
        probe.topics.camera,
        lambda message: conversions.frame_fact(message).format == "JPG",
    )


def test_the_camera_turns_to_its_command_and_nan_is_ignored(probe: Probe) -> None:
    topics = probe.topics

    def log(topic: Topic | None, value: float) -> None:
        assert topic is not None
        publisher = probe.node.create_publisher(Float64, topic.name, topic.qos)
        probe.until(lambda: publisher.get_subscription_count() > 0, "it is heard")
        publisher.publish(Float64(data=value))

    log(topics.camera_speed, 2.0)
    log(topics.camera_pan, 0.5)
    log(topics.camera_tilt, -0.3)
    first(probe, topics.camera_pan_state, lambda m: abs(m.data - 0.5) < 0.02)
    first(probe, topics.camera_tilt_state, lambda m: abs(m.data + 0.3) < 0.02)
    log(topics.camera_pan, nan)
    log(topics.camera_tilt, 0.0)
    first(probe, topics.camera_tilt_state, lambda m: abs(m.data) < 0.02)
    first(probe, topics.camera_pan_state, lambda m: abs(m.data - 0.5) < 0.02)


def test_velocity_is_obeyed_until_it_times_out_and_nan_is_not(probe: Probe) -> None:
    topic = probe.topics.cmd_vel
    publisher = probe.node.create_publisher(TwistStamped, topic.name, topic.qos)
    probe.until(lambda: publisher.get_subscription_count() > 1, "the simulation hears")
    message = TwistStamped()
    message.twist.linear.x = 0.4

    def moves() -> bool:
        publisher.publish(message)
        return bool(abs(probe.fresh_truth().twist.twist.linear.x - 0.4) < 0.1)

    probe.until(moves, "it moves")
    probe.standing()
    message.twist.linear.x = nan
    publisher.publish(message)
    assert conversions.odometry_fact(probe.fresh_truth()).velocity.finite


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.usefixtures("ros_domain")
def test_a_signal_ends_it_with_status_0(tmp_path: Path, number: signal.Signals) -> None:
    with simulation(tmp_path) as process:
        assert process.end(number) == 0
        assert "Traceback" not in process.text


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("--world", "nowhere"), "there is no world 'nowhere'"),
        (("--asset", "nobody"), "there is no asset 'nobody'"),
        (("--ros-args", "-p", "odometry.depth:=0"), "at least 1"),
    ],
)
@pytest.mark.usefixtures("ros_domain")
def test_an_unusable_request_is_refused_with_status_2(
    tmp_path: Path, arguments: tuple[str, ...], text: str
) -> None:
    with running(tmp_path / "log", "rover-sim", *arguments) as process:
        assert process.ended() == 2
        assert text in process.text
        assert "Traceback" not in process.text
