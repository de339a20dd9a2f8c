import logging
from dataclasses import replace
from pathlib import Path

import pytest

from executive.faults import DECLARED
from executive.safety import MONITORS, unmonitored
from executive.settings import Sensors, load_settings
from tests.support.kinematic import Bench

OF_SENSORS = (
    "wheel_monitors",
    "inertial_monitors",
    "second_odometry_monitors",
    "surroundings_monitors",
)
NOT_OF_SENSORS = {"zone_ahead", "joints_silent", "imu_silent", "second_odometry_silent"}


def test_what_a_sensor_is_lacking_for_is_said_with_its_reason() -> None:
    said = list(map(str, unmonitored(load_settings("jackal"))))
    assert "slip is not monitored: no second odometry" in said
    assert not any("IMU" in text for text in said)
    bare = unmonitored(replace(load_settings("jackal"), sensors=Sensors()))
    assert "wheel spin is not monitored: no IMU" in map(str, bare)


def test_every_fault_that_needs_a_sensor_is_named_where_there_is_none() -> None:
    bare = unmonitored(replace(load_settings("jackal"), sensors=Sensors()))
    named = {fault for each in bare for fault in each.faults}
    need = {name for name, look in MONITORS.items() if look.__module__.endswith(OF_SENSORS)}
    assert named == need - NOT_OF_SENSORS - {"laser_silent"}
    assert named < set(DECLARED)


def test_what_an_asset_ignores_or_another_link_may_command_is_said_too() -> None:
    said = list(map(str, unmonitored(load_settings("mocup"))))
    assert "tilted is not monitored: its reaction is ignore" in said
    assert any(text.startswith("uncommanded motion is not monitored") for text in said)


def test_the_log_says_at_start_what_is_not_monitored_in_a_line_for_each_cause(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    settings = replace(load_settings("jackal"), sensors=Sensors())
    with caplog.at_level(logging.INFO, "executive"):
        Bench(tmp_path, settings)
    said = [each for each in caplog.messages if "is not monitored" in each]
    assert [each.split(" (")[0] for each in said] == [
        "wheel motion is not monitored: no wheel sensors",
        "wheel spin is not monitored: no IMU",
        "slip is not monitored: no second odometry",
        "the path ahead is not monitored: no laser",
    ]
    assert "turn_slips" in said[2]
