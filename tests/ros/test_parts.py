"""The parts of the ROS adapter that need no ROS network."""

import os
import re
from dataclasses import astuple, replace
from io import BytesIO, StringIO
from math import inf, isnan, nan, pi

import pytest
from click.testing import CliRunner
from geometry_msgs.msg import Quaternion
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import Odometry as OdometryMessage
from PIL import Image as Pillow
from rclpy.clock import Clock
from rclpy.time import Time
from rich.console import Console
from sensor_msgs.msg import BatteryState, CompressedImage, Image, JointState
from std_msgs.msg import Float32, Float64
from trajectory_msgs.msg import JointTrajectory

from adapters.onboard.process import main as executive
from adapters.onboard.service import warn_of_missing_odometry
from adapters.ros import MessageError, conversions, odometry_message, ros_node
from adapters.ros.conversions import Precision, quaternion
from adapters.ros.diagnostics import TickMonitor
from adapters.ros.node import RosClock
from adapters.ros.tree_topic import from_json, to_json
from executive.settings import config_folder, load_settings
from executive.values.facts import Odometry
from executive.values.geometry import Pose, Velocity
from executive.values.reports import Severity
from trees.rover import preview
from trees.screen import collapse, render
from trees.snapshot import (
    FaultSnapshot,
    NodeKind,
    NodeStatus,
    TreeNodeSnapshot,
    TreeSnapshot,
)


class SetClock(Clock):
    """A node's clock that shows what it is set to."""

    shown_ns = 0

    def now(self) -> Time:
        return Time(nanoseconds=self.shown_ns)


def node(path: str, status: NodeStatus) -> TreeNodeSnapshot:
    depth = path.count("/")
    return TreeNodeSnapshot(path, path.split("/")[-1], depth, NodeKind.LEAF, status, "")


def test_time_never_steps_back_when_a_simulation_restarts() -> None:
    shown = SetClock()
    clock = RosClock(shown)
    times = []
    for shown_s in (1.0, 2.0, 0.0, 0.5, 3.0, 0.0):
        shown.shown_ns = int(shown_s * 1e9)
        times.append(clock.now_s())
    assert times == pytest.approx([1.0, 2.0, 2.0, 2.5, 5.0, 5.0])


def test_a_snapshot_survives_the_wire() -> None:
    nodes = preview(load_settings("jackal"))
    snapshot = TreeSnapshot(7, 1_800_000_000.25, "IDLE", "standing: „no“ goal", nodes)
    assert from_json(to_json(snapshot)) == snapshot
    reported = replace(
        snapshot,
        faults=(FaultSnapshot("slide_at_rest", Severity.WARNING, "it slides"),),
        unmonitored="slip (no camera)",
    )
    assert from_json(to_json(reported)) == reported


def test_the_header_lists_faults_and_unmonitored_quantities() -> None:
    nodes = preview(load_settings("jackal"))
    snapshot = TreeSnapshot(
        *(7, 0.0, "IDLE", "standing: no motion goal", nodes),
        faults=(FaultSnapshot("odometry_silent", Severity.WARNING, "the newest odometry is old"),),
        unmonitored="slip (no second odometry)",
    )
    console = Console(record=True, file=StringIO(), width=100)
    console.print(render("jackal", snapshot))
    assert console.export_text().splitlines()[1:5] == [
        "standing: no motion goal",
        "WARNING odometry_silent: the newest odometry is old",
        "not monitored: slip (no second odometry)",
        "",
    ]


@pytest.mark.parametrize("text", ["", "{}", "[1, 2]", '{"tick": "x"}'])
def test_a_text_that_is_no_snapshot_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="no snapshot"):
        from_json(text)


def test_folding_hides_inactive_branches() -> None:
    nodes = [
        node("a", NodeStatus.RUNNING),
        node("a/b", NodeStatus.FAILURE),
        node("a/b/c", NodeStatus.FAILURE),
        node("a/b/c/d", NodeStatus.IDLE),
        node("a/e", NodeStatus.RUNNING),
        node("a/e/f", NodeStatus.SUCCESS),
        node("a/g", NodeStatus.IDLE),
        node("a/g/h", NodeStatus.IDLE),
    ]
    assert [n.path for n in collapse(nodes)] == ["a", "a/b", "a/e", "a/e/f", "a/g"]


def test_the_tick_monitor_counts_late_and_long_ticks() -> None:
    never_late = TickMonitor(period_s=1e6)
    always_long = TickMonitor(period_s=0.0)
    for monitor in (never_late, always_long):
        for _ in range(3):
            with monitor.tick():
                pass
    beat = never_late.pop_statistics()
    assert (beat.ticks, beat.overruns) == (3, 0)
    assert beat.period_s is not None
    assert beat.max_period_s >= beat.period_s
    assert always_long.pop_statistics().overruns == 3
    empty = always_long.pop_statistics()
    assert (empty.ticks, empty.period_s, empty.overruns) == (0, None, 3)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--port", "70000"], "70000 is not in the range"),
        (["--ros-params", "none.yaml"], "File 'none.yaml' does not exist"),
        (["--asset", "none"], "there is no asset 'none'"),
    ],
)
def test_a_command_line_that_cannot_be_gets_one_error(arguments: list[str], text: str) -> None:
    done = CliRunner().invoke(executive, arguments)
    assert done.exit_code == 2
    assert text in done.output


PROFILES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")


@pytest.fixture
def no_choice(monkeypatch: pytest.MonkeyPatch, ros_domain: int) -> None:
    """Take away what the user, or the fixture before this one, chose."""
    assert ros_domain > 0
    for name in (*PROFILES, "FASTDDS_BUILTIN_TRANSPORTS", "ROS_DISCOVERY_SERVER", "ROS_DISTRO"):
        monkeypatch.delenv(name, raising=False)


@pytest.mark.ros
@pytest.mark.usefixtures("no_choice")
def test_without_a_choice_a_node_stays_on_loopback() -> None:
    with ros_node("node", "jackal"):
        assert {os.environ[each] for each in PROFILES} == {str(config_folder() / "fastdds.xml")}


@pytest.mark.ros
@pytest.mark.usefixtures("no_choice")
@pytest.mark.parametrize("choice", ["FASTDDS_BUILTIN_TRANSPORTS", "ROS_DISTRO", PROFILES[1]])
def test_a_choice_is_respected(choice: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(choice, "UDPv4")
    with ros_node("node", "jackal"):
        assert not ({*PROFILES} - {choice}) & {*os.environ}


UPRIGHT = pi / 2 - 0.01
turns = st.floats(-pi, pi)
tilts = st.floats(-UPRIGHT, UPRIGHT)
lengths = st.floats(-1e4, 1e4)
JPEG = b"\xff\xd8\xff\xe0 and so on"


def half(stored: Precision) -> float:
    """Return half of the last digit that is kept, and what numbers in binary add."""
    return 0.51 * 10.0**-stored


@given(heading_rad=turns, roll_rad=tilts, pitch_rad=tilts)
def test_angles_survive_the_conversion_to_a_rotation(
    heading_rad: float, roll_rad: float, pitch_rad: float
) -> None:
    pose = Pose(heading_rad=heading_rad, roll_rad=roll_rad, pitch_rad=pitch_rad)
    roll, pitch, heading = conversions.angles(quaternion(pose))
    stored = half(Precision.HEADING)
    assert (roll, pitch) == pytest.approx((roll_rad, pitch_rad), abs=stored)
    assert (heading - heading_rad + pi) % (2 * pi) - pi == pytest.approx(0.0, abs=stored)


@pytest.mark.parametrize(
    ("x", "y", "z", "w", "expected"),
    [
        (0.0, 0.0, 0.0, 1.0, (0.0, 0.0, 0.0)),
        (0.0, 0.0, 1.0, 0.0, (0.0, 0.0, pi)),
        (0.0, 0.0, 0.5**0.5, 0.5**0.5, (0.0, 0.0, pi / 2)),
        (0.5**0.5, 0.0, 0.0, 0.5**0.5, (pi / 2, 0.0, 0.0)),
        (0.0, 0.5**0.5, 0.0, 0.5**0.5, (0.0, pi / 2, 0.0)),
        (0.0, 0.0, -(0.5**0.5) * 1.002, -(0.5**0.5) * 1.002, (0.0, 0.0, pi / 2)),
    ],
)
def test_angles_of_known_rotations(
    x: float, y: float, z: float, w: float, expected: tuple[float, float, float]
) -> None:
    reported = conversions.angles(Quaternion(x=x, y=y, z=z, w=w))
    assert reported == pytest.approx(expected, abs=half(Precision.HEADING))


@pytest.mark.parametrize(
    "rotation",
    [
        Quaternion(w=0.0),
        Quaternion(w=1.1),
        Quaternion(w=nan),
        Quaternion(x=nan),
        Quaternion(z=inf),
        Quaternion(w=1e200, x=1e200),
    ],
)
def test_an_invalid_rotation_is_refused(rotation: Quaternion) -> None:
    with pytest.raises(MessageError, match="not a rotation"):
        conversions.angles(rotation)


ODOMETRY = st.builds(
    Odometry,
    st.integers(0, (2**31 - 1) * 10**9).map(lambda stamp_ns: stamp_ns * 1e-9),
    st.builds(Pose, lengths, lengths, lengths, turns),
    st.builds(Velocity, st.floats(-5, 5), st.floats(-5, 5)),
    st.floats(0, 1e3),
    st.floats(0, pi),
)


def xyz(pose: Pose) -> tuple[float, float, float]:
    return pose.x_m, pose.y_m, pose.z_m


@given(ODOMETRY)
def test_odometry_is_converted(sent: Odometry) -> None:
    received = conversions.odometry_fact(odometry_message(sent))
    for reported, measured in zip(
        (received.stamp_s, *astuple(received.velocity), *xyz(received.pose)),
        (sent.stamp_s, *astuple(sent.velocity), *xyz(sent.pose)),
        strict=True,
    ):
        assert reported == pytest.approx(measured, abs=half(Precision.LENGTH))
    sd = (received.position_sd_m, received.heading_sd_rad)
    assert sd == pytest.approx((sent.position_sd_m, sent.heading_sd_rad), abs=1e-6)


@pytest.mark.parametrize("variance", [nan, inf, -1.0, 0.0])
def test_an_empty_covariance_does_not_invalidate_the_odometry(variance: float) -> None:
    message = odometry_message(Odometry(1.0, Pose(), Velocity()))
    message.pose.covariance = [variance] * 36
    assert conversions.odometry_fact(message).position_sd_m == 0.0


@pytest.mark.parametrize("value", [nan, inf, -inf])
@pytest.mark.parametrize(
    "path",
    [
        "pose.pose.position.x",
        "pose.pose.position.y",
        "pose.pose.position.z",
        "pose.pose.orientation.x",
        "pose.pose.orientation.w",
        "twist.twist.linear.x",
        "twist.twist.angular.z",
    ],
)
def test_odometry_with_a_figure_that_is_none_is_refused(path: str, value: float) -> None:
    message = OdometryMessage()
    *route, last = path.split(".")
    part = message
    for name in route:
        part = getattr(part, name)
    setattr(part, last, value)
    with pytest.raises(MessageError):
        conversions.odometry_fact(message)


def test_a_battery_that_is_not_measured_is_refused() -> None:
    reader = conversions.BatteryReader(pytest.fail)
    assert reader.fact(BatteryState(voltage=25.5)).voltage_v == 25.5
    assert isnan(reader.fact(BatteryState(voltage=nan)).voltage_v)


def test_a_frame_is_recognised_by_its_octets() -> None:
    message = CompressedImage(format="rgb8; jpeg compressed bgr8", data=list(JPEG))
    message.header.stamp.sec = 7
    frame = conversions.frame_fact(message)
    assert (frame.format, frame.data, frame.stamp_s) == ("JPG", JPEG, 7.0)
    png = conversions.frame_fact(CompressedImage(data=list(b"\x89PNG\r\n\x1a\n...")))
    assert png.format == "PNG"


@pytest.mark.parametrize("data", [b"", b"\xff\xd8", b"GIF89a"])
def test_octets_of_no_picture_are_refused(data: bytes) -> None:
    with pytest.raises(MessageError, match="neither JPEG nor PNG"):
        conversions.frame_fact(CompressedImage(format="jpeg", data=list(data)))


@pytest.mark.parametrize(
    ("encoding", "pixel", "rgb"),
    [
        ("rgb8", (200, 40, 10), (200, 40, 10)),
        ("bgr8", (10, 40, 200), (200, 40, 10)),
        ("mono8", (90,), 90),
    ],
)
def test_a_raw_image_becomes_a_jpeg_of_its_colours(
    encoding: str, pixel: tuple[int, ...], rgb: tuple[int, ...] | int
) -> None:
    padding = b"\0" * 5
    row = bytes(pixel) * 16 + padding
    image = Image(encoding=encoding, width=16, height=8, step=len(row), data=row * 8)
    frame = conversions.frame_fact(image)
    assert frame.format == "JPG"
    picture = Pillow.open(BytesIO(frame.data))
    assert picture.size == (16, 8)
    assert picture.getpixel((7, 3)) == pytest.approx(rgb, abs=6)


@pytest.mark.parametrize(
    ("image", "text"),
    [
        (
            Image(encoding="bayer_rggb8", width=2, height=2, step=2, data=b"1234"),
            "'bayer_rggb8': rgb8,",
        ),
        (
            Image(encoding="rgb8", width=2, height=2, step=6, data=b"1234"),
            "2 x 2 rgb8, step 6, 4 octets",
        ),
        (Image(encoding="rgb8", width=2, height=2, step=1, data=b"1234"), "2 x 2 rgb8, step 1"),
        (Image(encoding="mono8", data=b""), "0 x 0 mono8"),
    ],
)
def test_a_raw_image_that_cannot_be_read_is_refused(image: Image, text: str) -> None:
    with pytest.raises(MessageError, match=re.escape(text)):
        conversions.frame_fact(image)


def test_a_battery_may_be_its_voltage_alone() -> None:
    fact = conversions.BatteryReader(pytest.fail).fact(Float32(data=15.5))
    assert (fact.voltage_v, fact.charge_ratio) == (15.5, None)


def test_an_angle_may_be_one_of_many_joints() -> None:
    message = JointState(name=["wheel", "pan"], position=[9.0, 0.5])
    assert conversions.joint_angle(message, "pan") == 0.5
    assert conversions.joint_angle(message, "tilt") is None
    assert conversions.joint_angle(Float64(data=0.25), "") == 0.25
    for wrong in (JointState(name=["pan"]), JointState(name=["pan"], position=[nan])):
        with pytest.raises(MessageError, match="joint pan"):
            conversions.joint_angle(wrong, "pan")


def test_an_angle_is_commanded_in_the_type_of_its_topic() -> None:
    trajectory = conversions.joint_command(JointTrajectory, "pan", 0.5, 0.4, -0.2)
    assert trajectory.joint_names == ["pan"]
    (point,) = trajectory.points
    assert list(point.positions) == [0.5]
    assert point.time_from_start.nanosec == 500_000_000
    state = conversions.joint_command(JointState, "pan", 0.5, 0.4, -0.2)
    assert (state.name, list(state.position), list(state.velocity)) == (["pan"], [0.5], [0.4])
    assert conversions.joint_command(Float64, "", 0.5, 0.4, 0.1) == Float64(data=0.5)


@pytest.mark.ros
def test_odometry_that_is_missing_is_logged_with_its_topic(
    ros_domain: int, caplog: pytest.LogCaptureFixture
) -> None:
    assert ros_domain
    with ros_node("executive", "scout") as node:
        node.create_subscription(OdometryMessage, "odom", lambda _: None, 1)
        warn_of_missing_odometry(node)
    assert "no odometry yet: /scout/odom has 0 publishers" in caplog.text
