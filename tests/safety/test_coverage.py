from dataclasses import replace

from executive.safety import unmonitored
from executive.settings import Sensors, load_settings


def test_what_a_sensor_is_lacking_for_is_said_with_its_reason() -> None:
    said = unmonitored(load_settings("jackal"))
    assert "not monitored is slip: no second odometry" in said
    assert not any("IMU" in text for text in said)
    bare = unmonitored(replace(load_settings("jackal"), sensors=Sensors()))
    assert "not monitored is a wrong gyro, and wheels that spin: no IMU" in bare


def test_what_an_asset_ignores_is_said_too() -> None:
    assert "not monitored is tilted: ignored" in unmonitored(load_settings("mocup"))


def test_a_rover_that_others_may_move_too_is_not_watched_for_moving() -> None:
    assert any("while it should stand" in text for text in unmonitored(load_settings("mocup")))
