"""What a file says can be changed from outside, and is checked as strictly as the file."""

import json
from collections.abc import Iterator
from dataclasses import replace
from math import radians
from pathlib import Path
from typing import Any

import pytest

from executive.commands import MoveForward, RotateBy
from executive.settings import (
    SecondOdometrySettings,
    Sensor,
    SettingsError,
    load_settings,
    settings_reader,
)
from sim.rover.faults import LeftWheelsStuck, LowFriction, OdometryFrozen
from sim.scenario.changes import Override, completions
from sim.scenario.model import Clear, Crash, Inject, RunMode, Scenario, Send
from sim.scenario.reading import load_scenario

FILE = """
title: T
duration: 9
world: rough
timeline:
  - {at: 1, command: {moveForward: {distance: 1}}, label: a}
  - {at: 1, command: {moveForward: {distance: 1}}, label: a.b}
  - {at: 2, command: {rotateBy: {angle: 10deg}}}
  - {at: 3, command: stop}
expect:
  - {command: a, ends: EXECUTED}
"""


def load(folder: Path, *changes: str, mode: RunMode = RunMode.LOCK_STEP) -> Scenario:
    path = folder / "file.yaml"
    path.write_text(FILE)
    return load_scenario(str(path), mode, [Override.parse(text) for text in changes])


def test_each_kind_of_key_is_changed(tmp_path: Path) -> None:
    plain = load(tmp_path)
    scenario = load(
        tmp_path,
        "seed=7",
        "duration=20",
        "world.friction=0.45",
        "world.rocks.1.x=3",
        "world.ground.amplitude=0",
        "settings.drive.travel_speed=0.7",
        "odometry.gyro_bias=1deg",
        "command.a.distance=2",
        "command.a.b.distance=3",
        "command.rotateBy.angle=-20deg",
    )
    assert (scenario.seed, scenario.duration_s) == (7, 20.0)
    assert scenario.world.friction == 0.45
    assert scenario.world.rocks[1].x_m == 3.0
    assert scenario.world.rocks[0] == plain.world.rocks[0]
    assert scenario.world.scatter == plain.world.scatter
    assert scenario.world.ground.amplitude_m == 0.0
    assert scenario.settings.drive.travel_speed_mps == 0.7
    assert scenario.odometry.gyro_bias_radps == pytest.approx(0.0174533)
    commands = {each.name: each.command for each in scenario.timeline if isinstance(each, Send)}
    assert (commands["a"], commands["a.b"]) == (MoveForward(2.0), MoveForward(3.0))
    assert commands["rotateBy"] == RotateBy(-radians(20))


def test_the_asset_and_the_whole_world_are_changed(tmp_path: Path) -> None:
    scenario = load(tmp_path, "asset=mocup", "world=flat", "world.slope=3deg", "world.slope=4deg")
    assert scenario.settings.asset == "mocup"
    assert scenario.world.slope_rad == pytest.approx(0.0698132)
    assert not scenario.world.rocks


def test_sensors_are_given_to_an_asset_and_taken_away(tmp_path: Path) -> None:
    second = "settings.sensors.second_odometry"
    scenario = load(tmp_path, f"{second}.rate_hz=2", "settings.sensors.laser={rate_hz: 10}")
    assert scenario.settings.sensors.second_odometry == SecondOdometrySettings(2.0)
    assert scenario.settings.sensors.present >= {Sensor.SECOND_ODOMETRY, Sensor.LASER}
    taken = load(tmp_path, f"{second}.rate_hz=2", f"{second}=null", "settings.mass=19.5")
    assert Sensor.SECOND_ODOMETRY not in taken.settings.sensors.present
    assert taken.settings.mass_kg == 19.5


def test_mocup_is_simulated_without_sensors(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="sensors: mocup is simulated without sensors"):
        load(tmp_path, "asset=mocup", "settings.sensors.imu.rate_hz=9")


def test_faults_are_added_with_their_time(tmp_path: Path) -> None:
    scenario = load(
        tmp_path,
        "inject=none",
        "inject={odometry_frozen, at: 2.5}",
        "inject={after: a STARTED + 1, near: {x: 1, y: 0, within: 0.5}, left_wheels_stuck: {}}",
        "inject={low_friction: {factor: 0.5}, at: 3, for: 0.5}",
    )
    frozen, stuck, low_friction = (each for each in scenario.timeline if isinstance(each, Inject))
    assert (frozen.inject, frozen.at_s) == (OdometryFrozen(), 2.5)
    assert (stuck.inject, stuck.time_text) == (
        LeftWheelsStuck(),
        "after a STARTED + 1 s, within 0.5 m of x 1 y 0",
    )
    assert (low_friction.inject, low_friction.at_s) == (LowFriction(0.5), 3.0)
    (end,) = (each for each in scenario.timeline if isinstance(each, Clear))
    assert (end.clear, end.at_s) == (LowFriction, 3.5)


def test_a_crash_is_added_with_its_time(tmp_path: Path) -> None:
    scenario = load(
        tmp_path, "crash=none", "crash={at: 2.5, for: 1}", "crash={after: a STARTED, for: 0}"
    )
    first, second = (each for each in scenario.timeline if isinstance(each, Crash))
    assert (first.at_s, first.crash_s) == (2.5, 1.0)
    assert (str(second.after), second.crash_s) == ("a STARTED", 0.0)


def test_a_change_of_one_setting_changes_no_other(tmp_path: Path) -> None:
    jackal = load_settings("jackal")
    slower = replace(jackal, drive=replace(jackal.drive, travel_speed_mps=0.7))
    assert load(tmp_path, "settings.drive.travel_speed=0.7").settings == slower


def test_no_change_changes_nothing(tmp_path: Path) -> None:
    assert load(tmp_path, "inject=none", "crash=none", "seed=0", "world=rough") == load(tmp_path)


def leaves(plain: Any, path: str) -> Iterator[tuple[str, Any]]:
    if isinstance(plain, dict):
        for key, value in plain.items():
            yield from leaves(value, f"{path}.{key}")
    else:
        yield path, plain


def test_each_completed_key_can_be_set_to_its_own_value(tmp_path: Path) -> None:
    plain = load(tmp_path)
    reader = settings_reader({})
    values = {
        path: value
        for root in ("world", "settings", "odometry")
        for path, value in leaves(reader.plain(getattr(plain, root)), root)
    }
    completed = [text[:-1] for text in completions("") if text.endswith("=")]
    keys = [key for key in completed if "." in key]
    assert set(keys) == set(values)
    assert load(tmp_path, *(f"{key}={json.dumps(values[key])}" for key in keys)) == plain


@pytest.mark.parametrize(
    ("change", "blamed"),
    [
        ("sed=3", "no key 'sed' can be changed (did you mean seed?)"),
        ("seed.x=3", "no key 'seed.x' can be changed"),
        ("title=Other", "no key 'title' can be changed"),
        ("seed=-1", "seed: -1 is below 0"),
        ("seed=[", "the value: is not YAML"),
        ("duration=2.5", "timeline[3]: is later than the end"),
        ("asset=pluto", "there is no asset 'pluto'"),
        ("world=pluto", "there is no world 'pluto'"),
        ("world.fricton=1", "world: unknown key 'fricton'"),
        ("world.friction=9", "world.friction: 9 is not in"),
        ("world.friction.of=1", "the value 0.6 has no key 'of'"),
        ("world.rocks.7.x=1", "'7' is no index in a list of 3"),
        ("settings.drive.wings=2", "settings.drive: unknown key 'wings'"),
        ("settings.sensors.imu.rate_hz=0", "settings.sensors.imu: rate_hz must be above 0"),
        ("settings.sensors.joints.track=0", "settings.sensors.joints: track_m must be above 0"),
        ("settings.sensors.laser={}", "settings.sensors.laser: key 'rate_hz' is missing"),
        ("settings.sensors.sonar=null", "known are imu, joints, second_odometry, laser"),
        ("odometry.gyro_noise=-1", "odometry: gyro_noise_radps -1 is below 0"),
        ("command.c.distance=1", "no command for 'c.distance'"),
        ("command.a.angle=1", "timeline[0].command.moveForward: unknown key 'angle'"),
        ("command.a.distance=far", "distance: 'far' is no quantity in m"),
        ("command.stop.now=1", "timeline[3].command.stop: unknown key 'now'"),
        ("crash=3", "expected a time and its length, as {at: 3, for: 1}"),
        ("crash={at: 3}", "expected a time and its length"),
        ("crash={for: 1}", "at, after or near is needed"),
        ("crash={at: 3, for: -1}", "crash: -1 is below 0"),
        ("crash.at=3", "no key 'crash.at' can be changed"),
        ("inject=odometry_frozen", "expected a fault and its time"),
        ("inject={odometry_frozen, left_wheels_stuck, at: 1}", "expected a fault and its time"),
        ("inject={odometry_frozen}", "at, after or near is needed"),
        ("inject={gremlins, at: 1}", "gremlins"),
        ("inject={odometry_frozen, at: 99}", "is later than the end"),
        ("inject={odometry_frozen, at: 1, for: 98}", "is later than the end"),
        ("inject={odometry_frozen, at: 1, for: -1}", "for is -1"),
        ("inject={odometry_frozen, after: a STARTED + 1, for: 1}", "at and for must be numbers"),
        ("inject={tip, at: 1, near: {x: 1, y: 0, within: 1}, for: 1}", "for does not go with near"),
    ],
)
def test_the_change_is_named_that_does_not_fit(tmp_path: Path, change: str, blamed: str) -> None:
    with pytest.raises(SettingsError) as caught:
        load(tmp_path, "duration=9.5", change, "world.charge=0.5")
    assert str(caught.value).startswith(f"{tmp_path / 'file.yaml'}: changed by {change}: ")
    assert blamed in str(caught.value)


def test_odometry_is_not_changed_where_it_has_no_effect(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="odometry: works in lock step only"):
        load(tmp_path, "odometry.gyro_noise=1", mode=RunMode.DIRECT)
    with pytest.raises(SettingsError, match="odometry: that of mocup is its brick's own"):
        load(tmp_path, "odometry.gyro_noise=1", "asset=mocup")


@pytest.mark.parametrize("text", ["seed", "=3", "seed=", ""])
def test_a_change_needs_key_and_value(text: str) -> None:
    with pytest.raises(ValueError, match="is not KEY=VALUE"):
        Override.parse(text)
