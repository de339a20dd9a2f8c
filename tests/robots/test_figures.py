"""Figures of a robot's sensors, by made drives and by a real Husky."""

from csv import DictReader
from dataclasses import replace
from math import cos, pi, sin
from random import Random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adapters.ros.check.figures import Arrived, figures, timing
from executive.settings import JointsSettings
from executive.values.facts import Imu, Joints, Odometry
from executive.values.geometry import Pose, Rotation, Velocity, inclination
from tests.suite import CHECKOUT
from tests.support.odometry_drive import Driver, motion

DRIVEN = motion()
WHEELS = JointsSettings(50.0, 0.1, 0.5)
GRAVITY_MPS2 = 9.81
LEVEL = (1, 0, 0), (0, 1, 0), (0, 0, 1)
UPSIDE_DOWN = (1, 0, 0), (0, -1, 0), (0, 0, -1)
BACKWARD = (-1, 0, 0), (0, -1, 0), (0, 0, 1)
ON_ITS_SIDE = (0, 0, 1), (-1, 0, 0), (0, -1, 0)
few = settings(max_examples=12)  # each is a drive


def odometry(driver: Driver) -> list[Arrived[Odometry]]:
    return [Arrived(*each) for each in driver.publish(DRIVEN)]


def husky() -> list[Arrived[Odometry]]:
    with (CHECKOUT / "tests/safety/data/husky_odometry.csv").open() as file:
        rows = [{key: float(text) for key, text in row.items()} for row in DictReader(file)]
    return [
        Arrived(
            row["arrival_s"],
            Odometry(
                row["stamp_s"],
                Pose(row["x_m"], row["y_m"], heading_rad=row["heading_rad"]),
                Velocity(row["travel_mps"], row["rotate_radps"]),
            ),
        )
        for row in rows
    ]


def imu(
    axes: tuple[tuple[float, ...], ...], slope: float = 1.0, bias: float = 0.01
) -> list[Arrived[Imu]]:
    """Return the IMU of the drive; `axes` are the directions of base_link's in its own."""
    made = []
    for before, each in zip(DRIVEN[::2], DRIVEN[2::2], strict=False):
        rate = each.velocity.rotate_radps / slope + bias
        rates = (axes[2][index] * rate for index in range(3))
        gained = each.velocity.travel_mps - before.velocity.travel_mps
        felt = gained / (each.time_s - before.time_s)
        forces = (axes[2][at] * GRAVITY_MPS2 + axes[0][at] * felt for at in range(3))
        made.append(Arrived(each.time_s + 0.02, Imu(each.time_s, 0.0, 0.0, *rates, *forces)))
    return made


def joints(turn: float = 1.0, travel: float = 1.0) -> list[Arrived[Joints]]:
    made = []
    for each in DRIVEN[::4]:
        ahead = travel * each.velocity.travel_mps
        across = turn * each.velocity.rotate_radps * WHEELS.track_m / 2
        left, right = ((ahead + side) / WHEELS.wheel_radius_m for side in (-across, across))
        made.append(Arrived(each.time_s, Joints(each.time_s, (left, left), (right, right))))
    return made


@few
@given(rate_hz=st.sampled_from([10.0, 20.0, 50.0]), steps=st.integers(5, 15))
def test_a_twist_that_is_a_mean_is_found_with_its_time(rate_hz: float, steps: int) -> None:
    twist = figures(odometry(Driver(rate_hz, mean_of=steps)), None).twist
    assert twist is not None
    assert not twist.behind
    assert twist.mean_s == pytest.approx(steps / rate_hz, rel=0.02)


@pytest.mark.parametrize("rest_s", [0.0, 60.0])
def test_rests_do_not_hide_that_a_slow_twist_is_a_mean(rest_s: float) -> None:
    slow = [(rest_s, 0.0, 0.0), (2.5, 0.2, 0.0), (2.5, 0.0, 0.0), (3.0, 0.0, 0.5), (2.5, 0.0, 0.0)]
    driven = [Arrived(*each) for each in Driver(mean_of=10).publish(motion(slow))]
    twist = figures(driven, None).twist
    assert twist is not None
    assert twist.mean_s == pytest.approx(0.2, abs=0.01)


@few
@given(rate_hz=st.sampled_from([20.0, 50.0]), periods=st.integers(2, 8))
def test_a_late_twist_is_found_with_its_delay(rate_hz: float, periods: int) -> None:
    twist = figures(odometry(Driver(rate_hz, behind_s=periods / rate_hz)), None).twist
    assert twist is not None
    assert twist.mean_s == pytest.approx(periods / rate_hz, abs=1.1 / rate_hz)


@few
@given(noise_m=st.floats(0.0, 0.005), rate_hz=st.sampled_from([8.0, 10.0, 20.0, 40.0, 50.0]))
def test_a_momentary_twist_is_momentary_whatever_the_noise(noise_m: float, rate_hz: float) -> None:
    jitter_ratio = 0.1 if rate_hz <= 10.0 else 0.0  # steps of 5 ms are too coarse for others
    found = figures(odometry(Driver(rate_hz, jitter_ratio=jitter_ratio, noise_m=noise_m)), None)
    assert found.noise_m == pytest.approx(noise_m, rel=0.5, abs=1e-6)
    assert found.twist is None or found.twist.mean_s == 0.0


def test_at_steady_speed_the_twist_is_not_determined() -> None:
    steady = [
        Arrived(at, Odometry(at, Pose(0.5 * at), Velocity(0.5, 0.0)))
        for at in (index * 0.02 for index in range(500))
    ]
    assert figures(steady, None).twist is None


def test_the_twist_of_a_real_husky_is_the_mean_of_its_last_second() -> None:
    drive = husky()
    found, times = figures(drive, None), timing([(at, each.stamp_s) for at, each in drive])
    assert found.twist is not None
    assert times is not None
    assert found.twist.mean_s == pytest.approx(1.0, abs=0.02)
    assert found.twist.error_mps < 0.005 < 0.1 < found.twist.momentary_mps
    assert times.rate_hz == pytest.approx(10.0, abs=0.1)
    assert times.gap_s == pytest.approx(0.208, abs=0.001)
    assert abs(times.age_s) < 0.01
    assert times.jitter_s < 0.01


@few
@given(offset_s=st.floats(-1e6, 1e6), jitter_s=st.floats(0.0, 0.1))
def test_offset_and_jitter_of_stamps_are_found(offset_s: float, jitter_s: float) -> None:
    random = Random(2)
    stamps = [0.02 * index for index in range(500)]
    times = timing([(each + offset_s + random.uniform(0.0, jitter_s), each) for each in stamps])
    assert times is not None
    assert times.age_s == pytest.approx(offset_s + jitter_s / 2, abs=0.2 * jitter_s + 1e-6)
    assert times.jitter_s == pytest.approx(jitter_s, rel=0.1, abs=1e-6)
    assert times.rate_hz == pytest.approx(50.0, rel=0.02)


@pytest.mark.parametrize(
    ("axes", "lean_rad"),
    [(LEVEL, 0.0), (BACKWARD, 0.0), (UPSIDE_DOWN, pi), (ON_ITS_SIDE, pi / 2)],
)
def test_the_mounting_of_the_imu_is_found_and_its_turn_about_the_vertical(
    axes: tuple[tuple[float, ...], ...], lean_rad: float
) -> None:
    found = figures(odometry(Driver()) + imu(axes, slope=1.25), None)
    assert found.mounting is not None
    assert found.mounting.lean_rad == pytest.approx(lean_rad, abs=0.01)
    assert found.mounting.oriented
    assert found.mounting.off_rad == pytest.approx(lean_rad, abs=0.01)
    assert found.mounting.yaw_rad is not None
    rotation = Rotation(*inclination(found.mounting.up), found.mounting.yaw_rad)
    for name, axis in zip(LEVEL, axes, strict=True):
        assert rotation.apply((axis[0], axis[1], axis[2])) == pytest.approx(name, abs=0.03)
    assert found.mounting.bias_radps == pytest.approx(0.01, abs=0.002)
    assert found.gyro_turn == pytest.approx(1.25, rel=0.02)


def test_an_orientation_that_is_not_measured_is_not_given() -> None:
    unknown = [
        Arrived(at, replace(each, roll_rad=float("nan"), pitch_rad=float("nan")))
        for at, each in imu(LEVEL)
    ]
    mounting = figures(unknown, None).mounting
    assert mounting is not None
    assert not mounting.oriented


@few
@given(turn=st.floats(0.7, 1.6), travel=st.floats(0.8, 1.2))
def test_wheels_are_compared_with_gyro_and_odometry(turn: float, travel: float) -> None:
    facts: list[Arrived[Any]] = [*odometry(Driver()), *imu(LEVEL), *joints(turn, travel)]
    found = figures(facts, WHEELS)
    assert found.wheels_turn == pytest.approx(turn, rel=0.02)
    assert found.wheels_travel == pytest.approx(travel, rel=0.02)
    assert found.gyro_turn == pytest.approx(1.0, rel=0.02)


@pytest.mark.parametrize("count", [0, 1, 3])
def test_few_facts_determine_nothing(count: int) -> None:
    facts: list[Arrived[Any]] = [
        *odometry(Driver())[:count],
        *imu(LEVEL)[:count],
        *joints()[:count],
    ]
    found = figures(facts, WHEELS)
    assert (found.twist, found.noise_m, found.mounting) == (None, None, None)
    assert (found.gyro_turn, found.wheels_turn, found.wheels_travel) == (None, None, None)
    assert timing([(0.0, 0.0)] * count) is None


def test_a_frozen_stamp_is_no_time() -> None:
    facts = [Arrived(at, replace(each, stamp_s=0.0)) for at, each in odometry(Driver())]
    assert figures(facts, None).noise_m is not None


def test_travel_is_along_the_heading() -> None:
    heading_rad = 2.0
    turned = [
        Arrived(
            at,
            replace(
                each,
                pose=Pose(
                    each.pose.x_m * cos(heading_rad) - each.pose.y_m * sin(heading_rad),
                    each.pose.x_m * sin(heading_rad) + each.pose.y_m * cos(heading_rad),
                    heading_rad=each.pose.heading_rad + heading_rad,
                ),
            ),
        )
        for at, each in odometry(Driver())
    ]
    assert figures(turned + joints(), WHEELS).wheels_travel == pytest.approx(1.0, rel=0.02)
