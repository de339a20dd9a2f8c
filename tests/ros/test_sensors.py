"""Messages of the sensors beside the odometry: what comes through, and what cannot be."""

from collections.abc import Callable
from dataclasses import astuple
from math import inf, isnan, nan, pi
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensor_msgs.msg import Imu as ImuMessage
from sensor_msgs.msg import JointState
from sensor_msgs.msg import LaserScan as LaserScanMessage

from adapters.ros import (
    MessageError,
    WheelJoints,
)
from adapters.ros.conversions import IgnoredMessageError
from adapters.ros.sensors import (
    imu_fact,
    imu_message,
    joints_fact,
    joints_message,
    laser_fact,
    laser_message,
    second_odometry_fact,
    second_odometry_message,
)
from executive.values.facts import Imu, Joints, LaserScan, SecondOdometry
from executive.values.geometry import Pose, Rotation

WHEELS = WheelJoints(("fl", "rl"), ("fr", "rr"))
stamps = st.integers(0, 10**6).map(lambda stamp_ms: stamp_ms / 1000)
figures = st.floats(-1e3, 1e3)
tilts = st.floats(-1.5, 1.5)
pairs = st.tuples(figures, figures)


@given(st.builds(Imu, stamps, tilts, tilts, *[figures] * 5, st.floats(1, 1e3)))
def test_inertial_measurements_are_converted(sent: Imu) -> None:
    received = imu_fact(imu_message(sent))
    stored = (4, 4, 4, 4, 4, 4, 3, 3, 3)
    for reported, felt, digits in zip(astuple(received), astuple(sent), stored, strict=True):
        assert reported == pytest.approx(felt, abs=0.51 * 10**-digits)


@given(
    st.builds(Imu, stamps, tilts, tilts, *[figures] * 5, st.floats(1, 1e3)),
    st.builds(Rotation, *[st.floats(-pi, pi)] * 3),
)
def test_what_an_imu_feels_comes_through_however_it_is_mounted(
    sent: Imu, mounting: Rotation
) -> None:
    received = imu_fact(imu_message(sent, mounting), mounting)
    kept = (4, 2, 2, 3, 3, 3, 2, 2, 2)
    for told, felt, digits in zip(astuple(received), astuple(sent), kept, strict=True):
        assert told == pytest.approx(felt, abs=0.51 * 10**-digits)


def test_an_imu_on_its_side_measures_as_one_that_is_level() -> None:
    """As on a Husky: its y axis points up, and its z axis back."""
    mounting = Rotation(roll_rad=pi / 2, yaw_rad=-pi / 2)
    message = imu_message(Imu(1.0, pi / 2, 0.0, -0.2, 0.3, 0.1, 0.5, 9.81, -1.0))
    assert imu_fact(message, mounting) == Imu(1.0, 0.0, 0.0, -0.1, 0.2, 0.3, 1.0, -0.5, 9.81)
    message.orientation_covariance[0] = message.linear_acceleration_covariance[0] = -1.0
    received = imu_fact(message, mounting)
    assert received.gyro_z_radps == 0.3
    assert isnan(received.roll_rad)
    assert isnan(received.acceleration_x_mps2)


@given(st.builds(Joints, stamps, pairs, pairs, pairs, pairs))
def test_wheel_measurements_are_converted(sent: Joints) -> None:
    received = joints_fact(joints_message(sent, WHEELS), WHEELS)
    assert received is not None
    stored = (4, 3, 3, 2, 2)
    for reported, felt, digits in zip(astuple(received), astuple(sent), stored, strict=True):
        assert reported == pytest.approx(felt, abs=0.51 * 10**-digits)


@given(
    st.builds(
        SecondOdometry,
        stamps,
        st.builds(Pose, figures, figures, figures, st.floats(-3.1, 3.1), tilts, tilts),
        st.floats(0, 100),
        st.floats(0, pi),
    )
)
def test_a_second_odometry_is_converted_with_its_uncertainty(sent: SecondOdometry) -> None:
    received = second_odometry_fact(second_odometry_message(sent, "visual_odom"))
    position, reported = sent.pose.point, received.pose.point
    assert (reported.x_m, reported.y_m) == pytest.approx((position.x_m, position.y_m), abs=0.51e-4)
    assert received.pose.heading_rad == pytest.approx(sent.pose.heading_rad, abs=0.51e-5)
    message = (received.position_sd_m, received.heading_sd_rad)
    assert message == pytest.approx((sent.position_sd_m, sent.heading_sd_rad), abs=1e-6)


def test_a_scan_is_converted() -> None:
    sent = LaserScan(1.5, -pi, pi / 2, 0.125, 16.0, (1.0, inf, 0.125, 16.0))
    received = laser_fact(laser_message(sent))
    assert received.ranges_m == sent.ranges_m
    assert received.angle_increment_rad == pytest.approx(pi / 2)
    assert (received.range_min_m, received.range_max_m) == (0.125, 16.0)


def test_ranges_that_are_none_are_as_rep_117_has_them() -> None:
    message = LaserScanMessage(
        angle_increment=0.5,
        range_min=0.25,
        range_max=8.0,
        ranges=[-inf, inf, nan, 0.125, 9.0, 2.0, 0.0],
    )
    assert repr(laser_fact(message).ranges_m) == repr((-inf, inf, nan, nan, inf, 2.0, nan))


def test_zero_is_free_if_the_driver_declares_it_and_another_ray_has_a_range() -> None:
    def ranges_m(*sent: float, range_min: float = 0.1) -> tuple[float, ...]:
        message = LaserScanMessage(
            angle_increment=0.5, range_min=range_min, range_max=8.0, ranges=sent
        )
        return laser_fact(message, zero_is_free=True).ranges_m

    assert ranges_m(0.0, 2.0) == (inf, 2.0)
    assert all(map(isnan, ranges_m(0.0, 0.0)))
    assert all(map(isnan, ranges_m(0.0, 0.0, range_min=0.0)))


def test_an_infinite_maximum_range_is_no_bound() -> None:
    message = LaserScanMessage(angle_increment=0.5, range_max=inf, ranges=[30.0, inf, nan, 0.0])
    assert repr(laser_fact(message).ranges_m) == repr((30.0, inf, nan, nan))


def test_joints_are_found_by_name_among_others_and_may_have_no_torques() -> None:
    message = JointState(
        name=["pan", "rr", "fr", "rl", "fl"], velocity=[9.0, 4.0, 3.0, 2.0, 1.0], effort=[nan] * 5
    )
    fact = joints_fact(message, WHEELS)
    assert fact == Joints(0.0, (1.0, 2.0), (3.0, 4.0))
    with pytest.raises(IgnoredMessageError, match="lack fl, rl, fr, rr; they name pan, tilt"):
        joints_fact(JointState(name=["pan", "tilt"], velocity=[1.0, nan]), WHEELS)


def imu(change: Callable[[ImuMessage], Any]) -> ImuMessage:
    message = imu_message(Imu(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 9.81))
    change(message)
    return message


@pytest.mark.parametrize("covariance", [-1.0, 0.0])
def test_an_imu_without_orientation_has_no_lean(covariance: float) -> None:
    message = imu(lambda m: setattr(m.orientation, "w", 1.0 if covariance else 0.0))
    message.orientation_covariance[0] = covariance
    received = imu_fact(message)
    assert isnan(received.roll_rad)
    assert isnan(received.pitch_rad)
    assert received.acceleration_z_mps2 == 9.81
    assert imu_message(received).orientation_covariance[0] == -1.0


def unmeasured(part: str) -> ImuMessage:
    return imu(lambda message: setattr(message, f"{part}_covariance", [-1.0] + [0.0] * 8))


def test_an_imu_that_is_exactly_level_without_covariance_measures_no_orientation() -> None:
    received = imu_fact(imu(lambda m: setattr(m, "orientation_covariance", [0.0] * 9)))
    assert isnan(received.roll_rad)
    assert isnan(received.pitch_rad)
    assert imu_fact(imu(lambda _: None)).roll_rad == 0.0

    def leaning(message: ImuMessage) -> None:
        message.orientation_covariance = [0.0] * 9
        message.orientation.x, message.orientation.w = 0.0998334, 0.9950042

    assert imu_fact(imu(leaning)).roll_rad == pytest.approx(0.2, abs=1e-3)


def test_an_imu_without_accelerations_has_its_rates() -> None:
    message = unmeasured("linear_acceleration")
    message.angular_velocity.z = 0.5
    received = imu_fact(message)
    assert received.gyro_z_radps == 0.5
    assert isnan(received.acceleration_x_mps2)
    assert imu_message(received).linear_acceleration_covariance[0] == -1.0


@pytest.mark.parametrize(
    ("message", "text"),
    [
        (unmeasured("angular_velocity"), "rates as not measured"),
        (imu(lambda m: setattr(m.angular_velocity, "y", nan)), "nan"),
        (imu(lambda m: setattr(m.linear_acceleration, "z", inf)), "inf"),
        (imu(lambda m: setattr(m.linear_acceleration, "z", 0.0)), "all zero"),
        (imu(lambda m: setattr(m.orientation, "w", 2.0)), "not a rotation"),
    ],
)
def test_an_imu_that_does_not_measure_is_refused(message: ImuMessage, text: str) -> None:
    with pytest.raises(MessageError, match=text):
        imu_fact(message)


@pytest.mark.parametrize(
    ("message", "text"),
    [
        (JointState(name=["fl", "fr", "rr"], velocity=[1.0] * 3), "lack rl; they name fl, fr, rr"),
        (JointState(name=["fl", "rl", "fr", "rr"], velocity=[1.0] * 3), "4 joints have 3 speeds"),
        (JointState(name=["fl", "rl", "fr", "rr"], velocity=[1.0, nan, 1.0, 1.0]), "nan"),
    ],
)
def test_joint_states_that_cannot_be_are_refused(message: JointState, text: str) -> None:
    with pytest.raises(MessageError, match=text):
        joints_fact(message, WHEELS)


@pytest.mark.parametrize(
    "given",
    [
        {"ranges": []},
        {"ranges": [1.0] * 20_001},
        {"angle_increment": 0.0},
        {"angle_increment": nan},
        {"range_max": nan},
        {"range_min": 9.0},
    ],
)
def test_scans_that_cannot_be_are_refused(given: dict[str, Any]) -> None:
    usual = {"angle_increment": 0.1, "range_min": 0.1, "range_max": 8.0, "ranges": [1.0] * 3}
    with pytest.raises(MessageError, match="scan"):
        laser_fact(LaserScanMessage(**{**usual, **given}))
