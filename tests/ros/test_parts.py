"""The parts of the ROS adapter that need no ROS network."""

import os

import pytest
from click.testing import CliRunner
from rclpy.clock import Clock
from rclpy.time import Time

from adapters.onboard.process import main as executive
from adapters.ros import ros_node
from adapters.ros.diagnostics import TickMonitor
from adapters.ros.node import RosClock
from adapters.ros.tree_topic import from_json, to_json
from adapters.ros.tree_view import folded
from executive.settings import config_folder, load_settings
from trees.rover import preview
from trees.snapshot import Node, NodeKind, NodeStatus, Snapshot


class SetClock(Clock):
    """A node's clock that shows what it is set to."""

    shown_ns = 0

    def now(self) -> Time:
        return Time(nanoseconds=self.shown_ns)


def node(path: str, status: NodeStatus) -> Node:
    depth = path.count("/")
    return Node(path, path.split("/")[-1], depth, NodeKind.LEAF, status, "")


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
    snapshot = Snapshot(7, 1_800_000_000.25, "IDLE", "stands: „no“ goal", nodes)
    assert from_json(to_json(snapshot)) == snapshot


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
    assert [n.path for n in folded(nodes)] == ["a", "a/b", "a/e", "a/e/f", "a/g"]


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
    assert beat.longest_period_s >= beat.period_s
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
