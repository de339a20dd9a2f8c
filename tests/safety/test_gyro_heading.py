"""The heading by the gyro, for skid steering: what it corrects, and what it still detects."""

from dataclasses import replace
from math import pi, radians
from pathlib import Path

import pytest

from executive.commands import MoveForward, RotateBy
from executive.safety import FaultMonitor, unmonitored
from executive.settings import OdometrySettings, Sensors, Settings, TurnSource, load_settings
from executive.values.clock import ManualClock
from executive.values.facts import Imu, Odometry
from executive.values.geometry import STANDING, Pose, Velocity, wrap_rad
from executive.values.reports import Stage
from tests.support.kinematic import Bench
from tests.support.sensed_drive import SensedDrive, SensedRover

RATIO = 1.3
BY_GYRO = OdometrySettings(50.0, 0.0, TurnSource.GYRO, RATIO)
DRIVE = ((Velocity(0.6, 0.4), 6.0), (Velocity(0.0, -0.8), 4.0), (Velocity(0.7), 4.0))


def skid(odometry: OdometrySettings = BY_GYRO, *, joints: bool = False) -> Settings:
    """Return a Jackal with an IMU, whose odometry turns more than the rover."""
    jackal = load_settings("jackal")
    sensors = jackal.sensors if joints else Sensors(imu=jackal.sensors.imu)
    return replace(jackal, odometry=odometry, sensors=sensors)


def driven(settings: Settings, gyro_bias_radps: float = 0.0) -> SensedDrive:
    drive = SensedDrive(settings, odometry_turn=RATIO, gyro_bias_radps=gyro_bias_radps)
    drive.run(STANDING, 3.0)
    for velocity, duration_s in DRIVE:
        drive.run(velocity, duration_s)
    return drive


def pose(drive: SensedDrive) -> Pose:
    newest = drive.safety.history.odometry
    assert newest is not None
    return drive.safety.history.corrected(newest).pose


@pytest.mark.at_length
def test_an_odometry_that_turns_too_far_stops_the_rover_without_the_key() -> None:
    assert "odometry_off_gyro" in driven(skid(OdometrySettings(50.0, 0.0))).names


@pytest.mark.at_length
@pytest.mark.parametrize("joints", [False, True])
@pytest.mark.parametrize("bias_radps", [0.0, -0.008])
def test_with_the_gyro_the_pose_is_right_and_nothing_is_a_fault(
    bias_radps: float, joints: bool
) -> None:
    drive = driven(skid(joints=joints), gyro_bias_radps=bias_radps)
    assert drive.names == []
    reported = pose(drive)
    assert reported.point.distance_m(drive.true.point) < 0.05
    assert abs(wrap_rad(reported.heading_rad - drive.true.heading_rad)) < radians(1)
    assert reported.point.distance_m(drive.believed.point) > 0.5  # the odometry's own


@pytest.mark.at_length
def test_at_rest_the_gyro_s_bias_does_not_turn_the_rover() -> None:
    drive = SensedDrive(skid(), gyro_bias_radps=0.008)
    drive.run(STANDING, 60.0)
    assert abs(pose(drive).heading_rad) < radians(0.5)
    assert drive.names == []


@pytest.mark.at_length
@pytest.mark.parametrize(
    ("wrong", "velocity", "within_s"),
    [
        ({"gyro_bias_radps": 0.2}, Velocity(0.6), 2.5),
        ({"gyro": 0.0}, Velocity(0.4, 0.6), 1.5),
        ({"gyro": -1.0}, Velocity(0.4, 0.6), 1.0),
        ({"odometry_turn": 0.4}, Velocity(0.4, 0.6), 3.5),
        ({"odometry_turn": -RATIO}, Velocity(0.4, 0.6), 1.0),
    ],
)
def test_what_goes_wrong_between_gyro_and_odometry_is_detected(
    wrong: dict[str, float], velocity: Velocity, within_s: float
) -> None:
    drive = driven(skid())
    drive.run(velocity, 3.0)
    assert drive.names == []
    for name, value in wrong.items():
        setattr(drive, name, value)
    drive.run(velocity, within_s)
    assert drive.names[0] in {"odometry_off_gyro", "turn_off_command"}


@pytest.mark.at_length
def test_a_gyro_that_drifted_is_detected_at_the_next_rest() -> None:
    drive = driven(skid())
    drive.gyro_bias_radps = 0.04
    drive.run(Velocity(0.6), 2.0)
    assert drive.names == []
    drive.moving = False
    drive.run(STANDING, 4.0)
    assert drive.names == ["uncommanded_turn"]


@pytest.mark.at_length
@pytest.mark.parametrize("turn_rad", [0.3, -0.5])
def test_a_heading_that_jumps_in_the_odometry_is_a_fault_and_no_motion(turn_rad: float) -> None:
    drive = driven(skid())
    before = pose(drive)
    drive.believed = replace(drive.believed, heading_rad=drive.believed.heading_rad + turn_rad)
    drive.run(Velocity(0.7), 0.1)
    assert drive.names == ["odometry_heading_jumped"]
    assert pose(drive).heading_rad == pytest.approx(before.heading_rad, abs=0.01)


def test_while_the_gyro_is_silent_the_odometry_turns_the_rover() -> None:
    drive = SensedDrive(skid(replace(BY_GYRO, turn_scale=1.0)))
    drive.run(Velocity(0.4, 0.5), 4.0)
    drive.lost = {Imu}
    drive.run(Velocity(0.4, 0.5), 3.0)
    drive.lost = set()
    drive.run(Velocity(0.4, 0.5), 3.0)
    assert abs(wrap_rad(pose(drive).heading_rad - drive.true.heading_rad)) < radians(1.5)
    assert drive.names == ["imu_silent"]


def test_a_gap_of_the_odometry_is_bridged() -> None:
    drive = SensedDrive(skid(), odometry_turn=RATIO)
    drive.run(Velocity(0.0, 0.5), 4.0)
    drive.lost = {Odometry}
    drive.run(Velocity(0.0, 0.5), 0.2)
    drive.lost = set()
    drive.run(Velocity(0.0, 0.5), 2.0)
    assert abs(wrap_rad(pose(drive).heading_rad - drive.true.heading_rad)) < radians(1)


@pytest.mark.parametrize(
    ("figures", "says"),
    [
        ({"turn_scale": 0.5, "turn": TurnSource.GYRO}, "turn_scale is 0.5: 0.6 to 3"),
        ({"turn_scale": 1.3}, "turn_scale needs turn: gyro"),
    ],
)
def test_a_ratio_that_no_wheels_have_is_refused(figures: dict[str, object], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        OdometrySettings(**figures)  # type: ignore[arg-type]


def test_a_heading_by_the_gyro_needs_one() -> None:
    with pytest.raises(ValueError, match=r"it needs sensors\.imu"):
        replace(load_settings("jackal"), odometry=BY_GYRO, sensors=Sensors())


@pytest.mark.at_length
def test_a_quarter_turn_is_one_of_the_rover_not_of_its_wheels(tmp_path: Path) -> None:
    rover = SensedRover(skid())
    rover.body.odometry_turn = RATIO
    with Bench(tmp_path, skid(), rover=rover, all_sensors=True) as bench:
        bench.odometry = False  # it is one of the sensors
        bench.run(2.0)
        bench.submit(RotateBy(pi / 2), 1)
        assert bench.finish(1) is Stage.EXECUTED, bench.last(1)
        bench.submit(MoveForward(1.0), 2)
        assert bench.finish(2) is Stage.EXECUTED, bench.last(2)
        assert rover.body.true.heading_rad == pytest.approx(pi / 2, abs=radians(3))
        reported = bench.executive.status.pose
        assert reported.point.distance_m(rover.body.true.point) < 0.05


def test_the_gyro_s_drift_is_listed_as_not_monitored() -> None:
    assert "not monitored: a drift of the gyro while driving" in "\n".join(
        map(str, unmonitored(skid()))
    )


@pytest.mark.parametrize(("twist_mean_s", "compared"), [(0.0, True), (0.2, True), (1.0, False)])
def test_a_late_twist_is_not_compared_with_the_accelerometer(
    twist_mean_s: float, compared: bool
) -> None:
    """Each braking would be a slide, and the pose uncertain."""
    settings = skid(OdometrySettings(10.0, twist_mean_s))
    history = FaultMonitor(ManualClock(), settings).history
    assert (history.over_ground is not None) == compared
    listed = any("sliding" in str(each) for each in unmonitored(settings, history))
    assert listed != compared
