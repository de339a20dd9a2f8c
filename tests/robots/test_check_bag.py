"""`rover robot check --bag`: the recorded Husky as bags of each format, through the monitors."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from adapters.cli.robot import robot
from executive.settings import load_settings
from executive.values.facts import Odometry
from tests.robots.bags import write_bag
from tests.robots.test_figures import husky
from tests.suite import CHECKOUT

pytestmark = pytest.mark.ros

WRONG_S = 20.0
Change = Callable[[float, Odometry], Odometry]


@pytest.fixture(autouse=True)
def _domain(ros_domain: int) -> None:
    assert ros_domain > 0


def bag(folder: Path, kind: str, change: Change = lambda _, fact: fact) -> Path:
    """Write the recorded odometry as a bag."""
    recorded = [(at_s, change(at_s, fact)) for at_s, fact in husky()]
    return write_bag(folder, kind, {"/husky/odom": recorded})


def asset(folder: Path, twist: str = "twist_mean_s: 1.0") -> str:
    """Return the file of a rover like the Husky, with its odometry alone."""
    text = (CHECKOUT / "config/robots/clearpath_j100.yaml").read_text(encoding="utf-8")
    text = text.partition("# The track")[0].replace("clearpath_j100", "husky")
    (folder / "husky.yaml").write_text(f"{text}odometry: {{{twist}}}\n", encoding="utf-8")
    source = CHECKOUT / "config/robots/clearpath_j100.ros.yaml"
    (folder / "husky.ros.yaml").write_bytes(source.read_bytes())
    return str(folder / "husky.yaml")


def checked(*arguments: object) -> tuple[int, Any]:
    done = CliRunner().invoke(robot, ["check", *map(str, arguments), "--json"])
    return done.exit_code, json.loads(done.stdout) if done.stdout else done.stderr


@pytest.mark.parametrize("kind", ["mcap", "db3", "bag"])
def test_the_recorded_husky_has_no_fault_with_its_twist_declared(kind: str, tmp_path: Path) -> None:
    status, found = checked(asset(tmp_path), "--bag", bag(tmp_path, kind))
    assert found["faults"] == []
    assert found["figures"]["twist"]["mean_s"] == pytest.approx(1.0, abs=0.02)
    assert found["topics"][0]["topic"] == "/husky/odom"
    assert abs(found["topics"][0]["timing"]["age_s"]) < 0.01
    assert status == 0


def test_what_stops_a_twist_that_is_taken_as_momentary_is_said_with_its_line(
    tmp_path: Path,
) -> None:
    status, found = checked(asset(tmp_path, "twist_mean_s: 0"), "--bag", bag(tmp_path, "mcap"))
    assert status == 1
    assert any("_off_twist: stop, first at" in each for each in found["faults"]), found["faults"]
    assert "twist_mean_s: 1.0" in found["changes"]["husky.yaml"]


def jump(at_s: float, fact: Odometry) -> Odometry:
    return fact if at_s < WRONG_S else replace(fact, pose=replace(fact.pose, x_m=fact.pose.x_m + 2))


def test_a_fault_in_the_bag_is_reported_with_its_time_and_reaction(tmp_path: Path) -> None:
    status, found = checked(asset(tmp_path), "--bag", bag(tmp_path, "mcap", jump))
    assert status == 1
    assert found["figures"]["twist"]["mean_s"] == pytest.approx(1.0, abs=0.02)
    assert any("odometry_jumped: safe, first at 20." in each for each in found["faults"]), found[
        "faults"
    ]


def test_a_file_that_is_no_bag_and_a_bag_without_odometry_are_errors(tmp_path: Path) -> None:
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(b"nothing")
    assert checked(asset(tmp_path), "--bag", broken)[0] == 2
    empty = tmp_path / "empty"
    with Writer(empty, version=9, storage_plugin=StoragePlugin.MCAP) as opened:
        opened.add_connection(
            "/cmd", "geometry_msgs/msg/TwistStamped", typestore=get_typestore(Stores.ROS2_JAZZY)
        )
    status, text = checked(asset(tmp_path), "--bag", empty)
    assert status == 2
    assert "no topic of type nav_msgs/msg/Odometry" in text


def test_the_changes_are_written_into_the_file_of_the_asset(tmp_path: Path) -> None:
    own, drive = asset(tmp_path, "twist_mean_s: 0"), bag(tmp_path, "mcap")
    arguments = ["check", own, "--bag", str(drive), "--write"]
    texts = [CliRunner().invoke(robot, arguments).stdout for _ in range(2)]
    assert f"{own}: odometry.rate_hz 10, odometry.twist_mean_s 0 → 1\n" in texts[0]
    assert load_settings(own).odometry.twist_mean_s == pytest.approx(1.0, abs=0.02)
    assert texts[1].endswith("everything fits\nnothing to change: no file is written\n")
    Path(own).write_text(Path(own).read_text().replace("_s: 1,", "_s: 0,"))
    Path(own).chmod(0o444)
    done = CliRunner().invoke(robot, arguments)
    assert done.exit_code == 2
    assert f"{own} cannot be written: it is read-only; nothing is written" in done.stderr
    assert Path(own).read_text().endswith("twist_mean_s: 0, rate_hz: 10}\n")


def test_a_bag_is_not_driven(tmp_path: Path) -> None:
    assert checked("jackal", "--bag", tmp_path, "--drive")[0] == 2
