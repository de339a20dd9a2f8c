"""A robot that is known by tf2 alone: its odometry, and a map that jumps under it."""

import time
from math import cos, hypot, sin
from pathlib import Path

import pytest

from executive.commands.catalogue import FollowPath, MoveTo, Waypoint
from executive.settings import TargetFrame, config_folder
from tests.robots.interfaces import INTERFACES
from tests.robots.test_robots import (
    LIMIT_S,
    SLOW_REST,
    SPEED,
    call,
    executive,
    failures,
    module,
    where,
)
from tests.support.ground import carry_out, until_located
from tests.support.interface_packages import interface_package, python_path

pytestmark = [pytest.mark.busy, pytest.mark.ros, pytest.mark.slow]

NAME = "localized"
TOPICS = """
/**:
  ros__parameters:
    use_sim_time: false
    start_type_description_service: false
    odometry: {topic: /tf, type: tf2_msgs/msg/TFMessage, depth: 100}
    frames: {map: map}
    battery: {topic: /battery_state, depth: 1}
    cmd_vel: {topic: /cmd_vel, depth: 1}
    camera_hz: 5.0
    tree_hz: 5.0
"""


def asset(folder: Path) -> Path:
    """Return the asset of a TurtleBot 4 without its sensors, and the topics beside it."""
    settings = (config_folder() / "robots" / "turtlebot4.yaml").read_text()
    settings = settings[: settings.index("sensors:")].replace("turtlebot4", NAME)
    (folder / f"{NAME}.ros.yaml").write_text(TOPICS)
    path = folder / f"{NAME}.yaml"
    path.write_text(settings)
    return path


def test_targets_in_the_map_are_reached_by_transforms_alone(
    ros_domain: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert ros_domain > 0
    monkeypatch.setenv("PYTHONPATH", python_path(interface_package("tf2_msgs")))
    found = INTERFACES[NAME].localization
    assert found is not None
    x_m, y_m, turned_rad = found.first
    to_m = (x_m + 1.5 * cos(turned_rad), y_m + 1.5 * sin(turned_rad))
    in_map = TargetFrame.MAP
    standin = ("tests.robots.standin", NAME, "--speed", str(SPEED), *SLOW_REST)
    with module(tmp_path / "robot.log", *standin) as process:
        process.output("is there")
        with executive(tmp_path, NAME, asset(tmp_path)) as (onboard, uri):
            until_located(uri)
            onward = Waypoint(to_m[0], to_m[1] + 0.4)
            outcomes = carry_out(
                uri,
                MoveTo(Waypoint(*to_m, turned_rad), frame=in_map),
                FollowPath((Waypoint(*to_m), onward), frame=in_map),
            )
            assert failures(outcomes) == [], onboard.text
            call(NAME, f"/{found.lose}")
            deadline_s, refused = time.monotonic() + LIMIT_S, ""
            while "no transform from map to odom for" not in refused:
                assert time.monotonic() < deadline_s, refused
                (outcome,) = carry_out(uri, MoveTo(onward, frame=in_map))
                refused = str(outcome.refusal)
            assert onboard.end() == 0
        process.end()
        x_m, y_m, _ = where(process.text)
    map_x_m, map_y_m, map_rad = found.then
    at_m = (
        map_x_m + x_m * cos(map_rad) - y_m * sin(map_rad),
        map_y_m + x_m * sin(map_rad) + y_m * cos(map_rad),
    )
    assert hypot(at_m[0] - onward.x_m, at_m[1] - onward.y_m) < 0.05
