"""The sensors beside the odometry measure what is true, with the errors that they are given."""

from math import hypot, inf, isnan, pi, radians, sin
from typing import TypeVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from executive.settings import (
    ImuSettings,
    JointsSettings,
    LaserSettings,
    SecondOdometrySettings,
    Sensors,
)
from executive.values.facts import Fact, Imu, Joints, LaserScan, Odometry, SecondOdometry
from executive.values.geometry import STANDING, Velocity, wrap_rad
from sim.rover import World, faults
from sim.rover.faults import Side, SimulatedFault
from sim.rover.features import GroundPoint, Wall
from sim.rover.jackal import SimulatedJackal
from tests.sim.driving import hold

IMU = Sensors(imu=ImuSettings(100))
JOINTS = Sensors(joints=JointsSettings(50, 0.098, 0.563))
SECOND = Sensors(second_odometry=SecondOdometrySettings(2))
LASER = Sensors(laser=LaserSettings(10))
ALL = Sensors(IMU.imu, JOINTS.joints, SECOND.second_odometry, LASER.laser)
AHEAD = Velocity(0.5, 0.0)
TURN = Velocity(0.0, 1.0)
Reading = TypeVar("Reading")


def of(kind: type[Reading], facts: list[Fact]) -> list[Reading]:
    return [fact for fact in facts if isinstance(fact, kind)]


def test_an_imu_at_rest_feels_gravity_and_errors_that_differ_from_run_to_run() -> None:
    leaning = World(slope_rad=radians(10))
    means = []
    for seed in range(20):
        facts = of(Imu, hold(SimulatedJackal(leaning, seed, sensors=IMU), STANDING, 1.0))
        assert len(facts) == 100
        assert facts[1].stamp_s - facts[0].stamp_s == pytest.approx(0.01)
        rows = np.array(
            [
                (
                    *(each.gyro_x_radps, each.gyro_y_radps, each.gyro_z_radps),
                    *(each.acceleration_x_mps2, each.acceleration_y_mps2, each.acceleration_z_mps2),
                    *(each.roll_rad, each.pitch_rad),
                )
                for each in facts
            ]
        )
        assert rows.std(0) == pytest.approx([0.004] * 3 + [0.03] * 3 + [0.002] * 2, rel=0.4)
        means.append(rows.mean(0))
    pitch_rad = -radians(10)
    true = [0, 0, 0, 9.81 * sin(-pitch_rad), 0, 9.81 * np.cos(pitch_rad), 0, pitch_rad]
    bias = np.array([0.003] * 3 + [0.05] * 3 + [0.005] * 2)
    off = (np.array(means) - true) / bias
    assert np.abs(off.mean(0)).max() < 0.8
    assert off.std(0).min() > 0.5
    assert off.std(0).max() < 1.5


def test_the_imu_feels_the_start_of_a_drive_and_the_turn_on_a_slope() -> None:
    rover = SimulatedJackal(World(slope_rad=radians(8)), seed=3, sensors=IMU)
    before = rover.true_velocity.travel_mps
    facts = of(Imu, hold(rover, AHEAD, 1.0))
    felt_mps = sum(0.01 * (f.acceleration_x_mps2 + 9.81 * sin(f.pitch_rad)) for f in facts)
    assert felt_mps == pytest.approx(rover.true_velocity.travel_mps - before, abs=0.12)
    heading_rad = rover.true_pose.heading_rad
    facts = of(Imu, hold(rover, TURN, 1.5))
    turned_rad = sum(
        0.01
        * (f.gyro_y_radps * np.sin(f.roll_rad) + f.gyro_z_radps * np.cos(f.roll_rad))
        / np.cos(f.pitch_rad)
        for f in facts
    )
    true_rad = wrap_rad(rover.true_pose.heading_rad - heading_rad)
    assert turned_rad == pytest.approx(true_rad, abs=0.02)
    assert true_rad > 1.0


def test_the_imu_feels_a_push_that_leaves_the_rover_standing() -> None:
    rover = SimulatedJackal(World(), sensors=IMU)
    hold(rover, STANDING, 0.5)
    rover.inject(faults.Pushed(0.3))
    facts = of(Imu, hold(rover, STANDING, 0.2))
    aside_mps2 = [fact.acceleration_y_mps2 for fact in facts]
    felt = [value for value in aside_mps2 if abs(value) > 1.0]
    assert felt == [max(aside_mps2), min(aside_mps2)]
    assert felt[0] == -felt[1] > 100.0


def test_joints_report_the_mean_speed_of_each_wheel_and_its_holding_torque() -> None:
    rover = SimulatedJackal(World(slope_rad=radians(15)), sensors=JOINTS)
    hold(rover, AHEAD, 1.0)
    facts = of(Joints, hold(rover, AHEAD, 2.0))
    assert len(facts) == 100
    left = np.array([fact.left_radps for fact in facts])
    right = np.array([fact.right_radps for fact in facts])
    assert left.shape == right.shape == (100, 2)
    assert (0.098 * left.mean(0), 0.098 * right.mean(0)) == pytest.approx(np.full((2, 2), 0.5), 0.1)
    torque_nm = sum(np.mean(fact.left_nm) + np.mean(fact.right_nm) for fact in facts) / 100 * 2
    uphill_nm = 18.7 * 9.81 * sin(radians(15)) * 0.098
    assert torque_nm == pytest.approx(uphill_nm, rel=0.2)
    turning = of(Joints, hold(rover, TURN, 1.0))[-1]
    assert max(turning.left_radps) < 0 < min(turning.right_radps)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**9), rate_hz=st.floats(0.5, 20))
def test_visual_odometry_is_late_in_order_and_off_by_its_scale(seed: int, rate_hz: float) -> None:
    second = Sensors(second_odometry=SecondOdometrySettings(rate_hz))
    rover = SimulatedJackal(World(), seed, sensors=second)
    stamps_s: list[float] = []
    poses = {}
    for _ in range(120):
        poses[round(rover.time_s, 3)] = rover.true_pose
        rover.drive(Velocity(1.0, 0.0))
        rover.advance(0.05)
        poses[round(rover.time_s, 3)] = rover.true_pose
        for fact in of(SecondOdometry, rover.facts()):
            assert rover.time_s - fact.stamp_s + 1e-9 >= 0.3
            assert rover.time_s - fact.stamp_s < 0.5 + 0.05 + 1e-9
            stamps_s.append(fact.stamp_s)
            true = poses.get(round(fact.stamp_s, 3))
            if true is not None and true.x_m > 2:
                off = fact.pose.x_m / true.x_m - 1
                assert 0.01 - 0.015 < abs(off) < 0.02 + 0.015
                assert abs(fact.pose.x_m - true.x_m) < 3 * fact.position_sd_m
    assert stamps_s == sorted(set(stamps_s))


def test_visual_odometry_has_its_own_frame_gaps_and_misses_turns() -> None:
    received = turned = 0
    silences_s: list[float] = []
    for seed in range(3):
        rover = SimulatedJackal(World(), seed, sensors=SECOND)
        stamps_s = [fact.stamp_s for fact in of(SecondOdometry, hold(rover, STANDING, 125.0))]
        silences_s += np.diff(stamps_s).tolist()
        received += len(stamps_s)
        facts = of(SecondOdometry, hold(rover, Velocity(0.0, 1.5), 15.0))
        turned += len(facts)
        assert hypot(facts[0].pose.x_m, facts[0].pose.y_m) < 0.1
    assert 0.88 < received / (3 * 250) < 0.99
    assert 0.5 < turned / (3 * 30) < 0.85
    assert sum(silence_s >= 1.5 for silence_s in silences_s) >= 3
    assert max(silences_s) < 6.0


def test_visual_odometry_is_blind_in_the_dark_and_follows_a_push() -> None:
    assert not of(SecondOdometry, hold(SimulatedJackal(World(dark=True), sensors=SECOND), AHEAD, 5))
    rover = SimulatedJackal(World(), seed=2, sensors=SECOND)
    before = of(SecondOdometry, hold(rover, STANDING, 2.0))[-1].pose
    rover.inject(faults.Pushed(0.5))
    after = of(SecondOdometry, hold(rover, STANDING, 2.0))[-1].pose
    assert after.y_m - before.y_m == pytest.approx(0.5, abs=0.05)
    assert after.heading_rad == pytest.approx(before.heading_rad, abs=0.02)


WALLED = World(
    walls=(
        Wall(x_m=3.0, y_m=-2.0, to=GroundPoint(3.0, 2.0), thickness_m=0.2),
        Wall(x_m=-1.0, y_m=-2.0, to=GroundPoint(1.0, -2.0), height_m=0.15),
    )
)


def test_the_laser_sees_walls_above_its_plane_and_not_the_rover() -> None:
    rover = SimulatedJackal(WALLED, sensors=LASER)
    (first, *_) = scans = of(LaserScan, hold(rover, STANDING, 2.0))
    assert len(scans) == 19  # the last is on its way
    assert len(first.ranges_m) == 360
    assert first.angle_min_rad == -pi
    at = {degrees: [scan.ranges_m[degrees + 180] for scan in scans] for degrees in (0, 20, 90, -90)}
    assert np.mean(at[0]) == pytest.approx(2.9, abs=0.02)
    assert np.std(at[0]) == pytest.approx(0.01, rel=0.5)
    assert np.mean(at[20]) == pytest.approx(2.9 / np.cos(radians(20)), abs=0.03)
    assert set(at[90]) == set(at[-90]) == {inf}
    assert min(min(scan.ranges_m) for scan in scans) > 2.8
    hold(rover, AHEAD, 2.0)
    nearer = of(LaserScan, hold(rover, STANDING, 1.0))[-1].ranges_m[180]
    assert nearer == pytest.approx(2.9 - rover.true_pose.x_m, abs=0.04)


def test_no_sensor_changes_physics_odometry_or_another_sensor() -> None:
    def facts(sensors: Sensors) -> list[Fact]:
        return hold(SimulatedJackal(WALLED, 5, sensors=sensors), Velocity(0.4, 0.5), 3.0)

    everything = facts(ALL)
    assert everything == facts(ALL)
    assert of(Odometry, everything) == of(Odometry, facts(Sensors()))
    for kind, alone in (
        (Imu, IMU),
        (Joints, JOINTS),
        (SecondOdometry, SECOND),
        (LaserScan, LASER),
    ):
        assert of(kind, everything) == of(kind, facts(alone)) != []


@pytest.mark.parametrize(
    ("fault", "kind"),
    [
        (faults.ImuDead(), Imu),
        (faults.JointsDead(), Joints),
        (faults.SecondOdometryLost(), SecondOdometry),
        (faults.LaserDead(), LaserScan),
    ],
)
def test_a_dead_sensor_is_silent_until_it_is_cleared(
    fault: SimulatedFault, kind: type[Fact]
) -> None:
    rover = SimulatedJackal(World(), sensors=ALL)
    rover.inject(fault)
    hold(rover, AHEAD, 0.5)
    facts = hold(rover, AHEAD, 2.0)
    assert {type(fact) for fact in facts} >= {Imu, Joints, SecondOdometry, LaserScan} - {kind}
    assert not of(kind, facts)
    rover.clear(type(fault))
    assert of(kind, hold(rover, AHEAD, 2.0))


@pytest.mark.parametrize(
    ("fault", "ahead", "behind"),
    [
        (faults.LaserBlind(), 1.0, 1.0),
        (faults.LaserBlind(sector_rad=pi / 2), 1.0, 0.0),
        (faults.LaserBlind(share=0.5, sector_rad=pi / 2), 0.5, 0.0),
    ],
)
def test_a_blind_laser_measures_nothing_in_a_share_of_a_sector(
    fault: SimulatedFault, ahead: float, behind: float
) -> None:
    rover = SimulatedJackal(World(), sensors=LASER)
    hold(rover, STANDING, 0.5)
    rover.inject(fault)
    scan = of(LaserScan, hold(rover, STANDING, 1.0))[-1]
    lost = [isnan(each) for each in scan.ranges_m]
    assert sum(lost[150:210]) / 60 == pytest.approx(ahead, abs=0.02)
    assert sum(lost[:30]) / 30 == behind
    rover.clear(type(fault))
    assert not any(map(isnan, of(LaserScan, hold(rover, STANDING, 1.0))[-1].ranges_m))


def test_frozen_visual_odometry_has_new_stamps() -> None:
    rover = SimulatedJackal(World(), seed=1, sensors=SECOND)
    hold(rover, AHEAD, 2.0)
    rover.inject(faults.SecondOdometryFrozen())
    facts = of(SecondOdometry, hold(rover, AHEAD, 4.0))[1:]
    assert len({fact.pose for fact in facts}) == 1
    assert len({fact.stamp_s for fact in facts}) == len(facts) > 3


def test_visual_odometry_jumps_once_for_each_jump_and_drifts_while_it_does() -> None:
    rover = SimulatedJackal(World(), seed=1, sensors=SECOND)

    def seen_m(duration_s: float) -> float:
        return of(SecondOdometry, hold(rover, STANDING, duration_s))[-1].pose.y_m

    before_m = seen_m(2.0)
    rover.inject(faults.SecondOdometryJump(0.5))
    assert seen_m(3.0) == pytest.approx(before_m + 0.5, abs=0.03)
    rover.inject(faults.SecondOdometryJump(0.5))
    assert seen_m(3.0) == pytest.approx(before_m + 1.0, abs=0.03)
    rover.inject(faults.SecondOdometryDrift(-0.1))
    hold(rover, STANDING, 5.0)
    rover.clear(faults.SecondOdometryDrift)
    rover.clear(faults.SecondOdometryJump)
    assert seen_m(3.0) == pytest.approx(before_m + 0.5, abs=0.03)


@pytest.mark.parametrize(
    ("fault", "gain", "bias_radps"),
    [
        (faults.GyroBias(0.5, shared=True), 1.0, 0.5),
        (faults.GyroGain(2.0, shared=True), 2.0, 0.0),
        (faults.GyroDead(shared=True), 0.0, 0.0),
        (faults.GyroBias(0.5), 1.0, 0.0),
        (faults.GyroGain(2.0), 1.0, 0.0),
        (faults.GyroDead(), 1.0, 0.0),
    ],
)
def test_a_fault_of_the_gyro_reaches_the_imu_where_it_is_shared(
    fault: SimulatedFault, gain: float, bias_radps: float
) -> None:
    rover = SimulatedJackal(World(), sensors=IMU)
    rover.inject(fault)
    hold(rover, TURN, 1.0)
    heading_rad = rover.true_pose.heading_rad
    rates = [each.gyro_z_radps for each in of(Imu, hold(rover, TURN, 1.0))]
    true_radps = wrap_rad(rover.true_pose.heading_rad - heading_rad)
    assert np.mean(rates) == pytest.approx(gain * true_radps + bias_radps, abs=0.02)


@pytest.mark.parametrize("shared", [True, False])
def test_a_fault_of_the_encoders_reaches_the_joints_where_it_is_shared(shared: bool) -> None:
    rover = SimulatedJackal(World(), sensors=JOINTS)
    hold(rover, AHEAD, 1.0)
    rover.inject(faults.EncoderScale(-1.0, shared=shared))
    rover.inject(faults.EncoderDead(Side.LEFT, shared=shared))
    last = of(Joints, hold(rover, AHEAD, 1.0))[-1]
    right, left = np.mean(last.right_radps) * 0.098, np.mean(last.left_radps) * 0.098
    assert (left, right) == pytest.approx((0.0, -0.5) if shared else (0.5, 0.5), abs=0.05)


def test_a_missing_part_cannot_fail() -> None:
    with pytest.raises(ValueError, match=r"imu_dead needs .*settings\.sensors\.imu"):
        SimulatedJackal(World(), sensors=LASER).inject(faults.ImuDead())
