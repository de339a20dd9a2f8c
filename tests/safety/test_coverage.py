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


def test_what_a_sensor_is_lacking_for_is_said_with_its_reason() -> None:
    said = list(map(str, unmonitored(load_settings("jackal"))))
    assert "not monitored: slip: no second odometry" in said
    assert not any("IMU" in text for text in said)
    bare = unmonitored(replace(load_settings("jackal"), sensors=Sensors()))
    assert "not monitored: wheel spin: no IMU" in map(str, bare)


def test_every_fault_that_needs_a_sensor_is_named_where_there_is_none() -> None:
    bare = unmonitored(replace(load_settings("jackal"), sensors=Sensors()))
    named = {fault for each in bare for fault in each.faults}
    need = {name for name, look in MONITORS.items() if look.__module__.endswith(OF_SENSORS)}
    assert named == {each for each in need if not each.endswith("_silent")} - {"zone_ahead"}
    assert named < set(DECLARED)


def test_what_an_asset_ignores_or_another_link_may_command_is_said_too() -> None:
    said = list(map(str, unmonitored(load_settings("mocup"))))
    assert "not monitored: tilt_limit: its reaction is ignore" in said
    assert any(text.startswith("not monitored: uncommanded motion") for text in said)


def test_the_log_says_at_start_what_is_not_monitored_in_a_line_for_each_cause(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    settings = replace(load_settings("jackal"), sensors=Sensors())
    with caplog.at_level(logging.INFO, "executive"):
        Bench(tmp_path, settings)
    said = [each for each in caplog.messages if "not monitored" in each]
    assert [each.split(" (")[0] for each in said] == [
        "not monitored: wheel motion: no wheel sensors",
        "not monitored: wheel spin: no IMU",
        "not monitored: slip: no second odometry",
        "not monitored: the path ahead: no laser",
    ]
    assert "turn_slip" in said[2]
