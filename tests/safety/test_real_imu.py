"""A real Husky with its IMU, mounted on its side, and the heading by its gyro."""

from collections.abc import Callable
from csv import DictReader
from dataclasses import replace
from math import pi, radians
from pathlib import Path

import pytest

from executive.settings import ImuSettings, OdometrySettings, Sensors, Settings, TurnSource
from executive.values.facts import Fact, Imu, Odometry
from executive.values.geometry import Rotation, Velocity, inclination, up_of
from tests.safety.test_real_odometry import commanded, recorded
from tests.support.odometry_drive import asset, watched

MOUNTING = Rotation(roll_rad=pi / 2, yaw_rad=-pi / 2)
UNTIL_S = 30.0
FROM_S = 16.0


def husky(turn: TurnSource = TurnSource.GYRO) -> Settings:
    settings = replace(asset(), sensors=Sensors(imu=ImuSettings(30.0, MOUNTING)))
    return replace(settings, odometry=OdometrySettings(10.0, 1.0, turn))


def inertial(mounting: Rotation = MOUNTING) -> list[tuple[float, Imu]]:
    """Return the measurements as a mounting turns them into base_link."""
    with (Path(__file__).parent / "data" / "husky_imu.csv").open() as file:
        rows = [[float(value) for value in row.values()] for row in DictReader(file)]
    made = []
    for at_s, stamp_s, roll_rad, pitch_rad, *vectors in rows:
        lean = inclination(mounting.apply(up_of(roll_rad, pitch_rad)))
        x, y, z, *force = vectors
        rates, forces = mounting.apply((x, y, z)), mounting.apply((force[0], force[1], force[2]))
        made.append((at_s, Imu(stamp_s, *lean, *rates, *forces)))
    return made


def faults(
    settings: Settings,
    odometry: list[tuple[float, Odometry]],
    imu: list[tuple[float, Imu]],
) -> list[tuple[float, str]]:
    """Return the faults after the first second, in which the monitors begin."""
    facts: list[tuple[float, Fact]] = [*odometry, *imu]
    facts = sorted((each for each in facts if each[0] < UNTIL_S), key=lambda each: each[0])
    commands: list[Velocity] = commanded(recorded())[: round(UNTIL_S / 0.05)]
    return [each for each in watched(settings, facts, commands) if each[0] >= 1.0]


@pytest.mark.at_length
def test_a_real_rover_with_its_imu_drives_once_its_mounting_is_declared() -> None:
    assert faults(husky(), recorded(), inertial()) == []


@pytest.mark.at_length
def test_taken_for_level_its_imu_makes_it_safe() -> None:
    found = faults(husky(), recorded(), inertial(Rotation()))
    assert "tilt_limit_imu" in {name for _, name in found}


@pytest.mark.alike
@pytest.mark.parametrize(
    ("wrong", "within_s"),
    [
        (lambda imu: replace(imu, gyro_z_radps=imu.gyro_z_radps - 0.2), 3.0),
        (lambda imu: replace(imu, gyro_z_radps=imu.gyro_z_radps + 0.2), 2.5),
        (lambda imu: replace(imu, pitch_rad=imu.pitch_rad + radians(40)), 0.2),
    ],
)
def test_what_goes_wrong_in_its_imu_is_detected(
    wrong: Callable[[Imu], Imu], within_s: float
) -> None:
    imu = [(at_s, each if at_s < FROM_S else wrong(each)) for at_s, each in inertial()]
    at_s, _ = faults(husky(), recorded(), imu)[0]
    assert FROM_S < at_s <= FROM_S + within_s
