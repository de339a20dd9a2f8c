"""The parts of the ROS adapter that need no ROS network."""

import os
from dataclasses import astuple, replace
from io import StringIO
from math import inf, isnan, nan, pi

import pytest
from click.testing import CliRunner
from geometry_msgs.msg import Quaternion
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import Odometry as OdometryMessage
from rclpy.clock import Clock
from rclpy.time import Time
from rich.console import Console
from sensor_msgs.msg import BatteryState, CompressedImage

from adapters.onboard.process import main as executive
from adapters.ros import MessageError, conversions, odometry_message, ros_node
from adapters.ros.conversions import Precision, quaternion
from adapters.ros.diagnostics import TickMonitor
from adapters.ros.node import RosClock
from adapters.ros.tree_topic import from_json, to_json
from executive.settings import config_folder, load_settings
from executive.values.facts import Odometry
from executive.values.geometry import Pose, Velocity
from trees.rover import preview
from trees.screen import collapse, render
from trees.snapshot import NodeKind, NodeStatus, TreeNodeSnapshot, TreeSnapshot


class SetClock(Clock):
    """A node's clock that shows what it is set to."""

    shown_ns = 0

    def now(self) -> Time:
        return Time(nanoseconds=self.shown_ns)


def node(path: str, status: NodeStatus) -> TreeNodeSnapshot:
    depth = path.count("/")
    return TreeNodeSnapshot(path, path.split("/")[-1], depth, NodeKind.LEAF, status, "")


def test_time_never_steps_back_where_a_simulation_starts_anew() -> None:
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
    told = replace(snapshot, faults=("WARNING slides: it slides",), unmonitored="slip (no camera)")
    assert from_json(to_json(told)) == told


def test_the_head_says_faults_and_what_is_not_monitored() -> None:
    nodes = preview(load_settings("jackal"))
    snapshot = TreeSnapshot(
        *(7, 0.0, "IDLE", "standing: no motion goal", nodes),
        faults=("WARNING odometry_silent: the newest odometry is 1.00 s old",),
        unmonitored="slip (no second odometry)",
    )
    console = Console(record=True, file=StringIO(), width=100)
    console.print(render("jackal", snapshot))
    assert console.export_text().splitlines()[1:5] == [
        "standing: no motion goal",
        "WARNING odometry_silent: the newest odometry is 1.00 s old",
        "not monitored: slip (no second odometry)",
        "",
    ]


@pytest.mark.parametrize("text", ["", "{}", "[1, 2]", '{"tick": "x"}'])
def test_a_text_that_is_no_snapshot_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="no snapshot"):
        from_json(text)


def test_folding_hides_what_came_to_nothing() -> None:
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
    beat = never_late.take()
    assert (beat.ticks, beat.overruns) == (3, 0)
    assert beat.period_s is not None
    assert beat.max_period_s >= beat.period_s
    assert always_long.take().overruns == 3
    empty = always_long.take()
    assert (empty.ticks, empty.period_s, empty.overruns) == (0, None, 3)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--port", "70000"], "70000 is not in the range"),
        (["--ros-params", "none.yaml"], "File 'none.yaml' does not exist"),
        (["--asset", "none"], "there is no asset 'none'"),
    ],
)
def test_a_command_line_that_cannot_be_gets_one_error(arguments: list[str], says: str) -> None:
    done = CliRunner().invoke(executive, arguments)
    assert done.exit_code == 2
    assert says in done.output


PROFILE = "FASTRTPS_DEFAULT_PROFILES_FILE"


@pytest.fixture
def no_choice(monkeypatch: pytest.MonkeyPatch, ros_domain: int) -> None:
    """Take away what the user, or the fixture before this one, chose."""
    assert ros_domain > 0
    for name in (PROFILE, "FASTDDS_BUILTIN_TRANSPORTS", "ROS_DISCOVERY_SERVER", "ROS_DISTRO"):
        monkeypatch.delenv(name, raising=False)


@pytest.mark.ros
@pytest.mark.usefixtures("no_choice")
def test_without_a_choice_a_node_stays_on_loopback() -> None:
    with ros_node("node", "jackal"):
        assert os.environ[PROFILE] == str(config_folder() / "fastdds.xml")


@pytest.mark.ros
@pytest.mark.usefixtures("no_choice")
@pytest.mark.parametrize("choice", ["FASTDDS_BUILTIN_TRANSPORTS", "ROS_DISTRO"])
def test_a_choice_is_respected(choice: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(choice, "UDPv4")
    with ros_node("node", "jackal"):
        assert PROFILE not in os.environ


UPRIGHT = pi / 2 - 0.01
turns = st.floats(-pi, pi)
tilts = st.floats(-UPRIGHT, UPRIGHT)
lengths = st.floats(-1e4, 1e4)
JPEG = b"\xff\xd8\xff\xe0 and so on"


def half(kept: Precision) -> float:
    """Return half of the last digit that is kept, and what numbers in binary add."""
    return 0.51 * 10.0**-kept


@given(heading_rad=turns, roll_rad=tilts, pitch_rad=tilts)
def test_angles_come_back_from_the_rotation_made_of_them(
    heading_rad: float, roll_rad: float, pitch_rad: float
) -> None:
    pose = Pose(heading_rad=heading_rad, roll_rad=roll_rad, pitch_rad=pitch_rad)
    roll, pitch, heading = conversions.angles(quaternion(pose))
    kept = half(Precision.HEADING)
    assert (roll, pitch) == pytest.approx((roll_rad, pitch_rad), abs=kept)
    assert (heading - heading_rad + pi) % (2 * pi) - pi == pytest.approx(0.0, abs=kept)


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
    told = conversions.angles(Quaternion(x=x, y=y, z=z, w=w))
    assert told == pytest.approx(expected, abs=half(Precision.HEADING))


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
def test_what_is_no_rotation_is_refused(rotation: Quaternion) -> None:
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
def test_odometry_comes_through(sent: Odometry) -> None:
    received = conversions.odometry_fact(odometry_message(sent))
    for told, measured in zip(
        (received.stamp_s, *astuple(received.velocity), *xyz(received.pose)),
        (sent.stamp_s, *astuple(sent.velocity), *xyz(sent.pose)),
        strict=True,
    ):
        assert told == pytest.approx(measured, abs=half(Precision.LENGTH))
    sd = (received.position_sd_m, received.heading_sd_rad)
    assert sd == pytest.approx((sent.position_sd_m, sent.heading_sd_rad), abs=1e-6)


@pytest.mark.parametrize("variance", [nan, inf, -1.0, 0.0])
def test_a_covariance_that_says_nothing_does_not_cost_the_odometry(variance: float) -> None:
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
    *way, last = path.split(".")
    part = message
    for name in way:
        part = getattr(part, name)
    setattr(part, last, value)
    with pytest.raises(MessageError):
        conversions.odometry_fact(message)


def test_a_battery_that_is_not_measured_is_refused() -> None:
    reader = conversions.BatteryReader(pytest.fail)
    assert reader.fact(BatteryState(voltage=25.5)).voltage_v == 25.5
    assert isnan(reader.fact(BatteryState(voltage=nan)).voltage_v)


def test_a_frame_is_told_by_its_octets() -> None:
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
