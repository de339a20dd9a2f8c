"""What wheels, inertial sensors and a second odometry show, and what they do not."""

from dataclasses import replace
from functools import cache
from math import nan, radians
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from executive.commands import DriveFor, MoveForward, Resume, Stop
from executive.faults import ClearPolicy, Reaction
from executive.safety import unmonitored
from executive.settings import SecondOdometrySettings, Sensors, Settings, load_settings
from executive.values.facts import Fact, Imu, Joints, SecondOdometry
from executive.values.geometry import STANDING, Pose, Velocity
from executive.values.reasons import Reason
from executive.values.reports import ReportKind, Severity, Stage
from tests.support.kinematic import Bench, ignoring
from tests.support.sensed_drive import SensedDrive, SensedRover

pytestmark = pytest.mark.alike

AHEAD = Velocity(0.8, 0.0)
SPIN = Velocity(0.0, 1.2)
ARC = Velocity(0.6, 0.8)


@cache
def asset(*, fused: bool = False) -> Settings:
    jackal = ignoring(
        "odometry_frozen", "off_command", "turn_off_command", "turn_angle_off_command"
    )
    second = SecondOdometrySettings(rate_hz=2.0, fused=fused)
    return replace(jackal, sensors=replace(jackal.sensors, second_odometry=second))


def driving(velocity: Velocity = AHEAD, duration_s: float = 4.0, **given: Any) -> SensedDrive:
    drive = SensedDrive(asset(), **given)
    drive.run(STANDING, 1.0)
    drive.run(velocity, duration_s)
    assert drive.names == []
    return drive


def goes_wrong(drive: SensedDrive, limit_s: float = 5.0, **given: Any) -> float:
    """Have something go wrong, and return after how many seconds a fault began."""
    for name, value in given.items():
        assert hasattr(drive, name)
        setattr(drive, name, value)
    for tick in range(round(limit_s / 0.05)):
        drive.run(drive.wanted, 0.05)
        if drive.begun:
            return (tick + 1) * 0.05
    return limit_s


SPEEDS = st.floats(-1.0, 1.0)
RATES = st.floats(-1.5, 1.5)


@pytest.mark.at_length
@settings(max_examples=8, deadline=None)
@given(
    legs=st.lists(st.tuples(SPEEDS, RATES, st.floats(0.3, 3.0)), min_size=1, max_size=4),
    roll_rad=st.floats(-0.3, 0.3),
    pitch_rad=st.floats(-0.3, 0.3),
    gyro_bias_radps=st.floats(-0.008, 0.008),
    clock_off_s=st.sampled_from([0.0, -1e9, 31.7]),
    frame=st.builds(Pose, SPEEDS, SPEEDS, st.just(0.0), st.floats(-3.0, 3.0)),
)
def test_no_fault_is_seen_in_a_rover_that_does_what_it_is_told(
    legs: list[tuple[float, float, float]],
    roll_rad: float,
    pitch_rad: float,
    gyro_bias_radps: float,
    clock_off_s: float,
    frame: Pose,
) -> None:
    drive = SensedDrive(
        asset(),
        roll_rad=roll_rad,
        pitch_rad=pitch_rad,
        gyro_bias_radps=gyro_bias_radps,
        clock_off_s=clock_off_s,
        second_in_odometry=frame,
    )
    drive.run(STANDING, 3.0)
    for travel_mps, rotate_radps, duration_s in legs:
        drive.run(Velocity(travel_mps, rotate_radps), duration_s)
    drive.run(STANDING, 2.0)
    assert drive.names == []


@pytest.mark.at_length
@pytest.mark.parametrize(
    ("velocity", "given", "name", "within_s"),
    [
        (AHEAD, {"left": 0.0}, "wheels_off_command", 0.6),
        (SPIN, {"right": 0.3}, "wheels_off_command", 0.6),
        (AHEAD, {"left": 0.9, "torque_nm": 0.0}, "wheels_unpowered", 0.8),
        (AHEAD, {"odometry_travel": 0.0}, "odometry_off_wheels", 0.3),
        (AHEAD, {"odometry_travel": 1.05}, "odometry_off_wheels", 3.0),
        (SPIN, {"odometry_turn": 0.0}, "odometry_off_gyro", 0.3),
        (SPIN, {"odometry_turn": 1.06}, "odometry_off_gyro", 4.0),
        (AHEAD, {"gyro_bias_radps": 0.03}, "odometry_off_gyro", 2.0),
        (SPIN, {"gyro": 0.0, "odometry_turn": 0.0}, "wheels_off_gyro", 0.8),
        (AHEAD, {"grip": 0.0}, "wheel_slip", 0.4),
        (AHEAD, {"held_n": 60.0}, "motion_blocked", 0.7),
        (AHEAD, {"roll_rad": 0.6}, "tilt_limit", 0.2),
        (AHEAD, {"aside_mps": 0.5}, "travel_slip", 1.6),
        (AHEAD, {"aside_mps": 0.15}, "travel_slip", 5.0),
    ],
)
def test_a_fault_is_seen_by_what_it_shows_in(
    velocity: Velocity, given: dict[str, float], name: str, within_s: float
) -> None:
    drive = driving(velocity)
    assert goes_wrong(drive, **given) <= within_s
    assert drive.names[0] == name, drive.begun[0].refusal.text


@pytest.mark.at_length
def test_a_fault_of_several_windows_begins_once_and_is_over_with_the_last() -> None:
    faults = asset().faults
    row = replace(faults.odometry_off_wheels, reaction=Reaction.WARN, clears=ClearPolicy.AUTO)
    drive = SensedDrive(replace(asset(), faults=replace(faults, odometry_off_wheels=row)))
    drive.lost.add(SecondOdometry)
    drive.run(STANDING, 1.0)
    drive.run(AHEAD, 4.0)
    drive.odometry_travel = 0.8
    drive.run(AHEAD, 4.0)
    assert (drive.names, drive.over) == (["odometry_off_wheels"], [])
    drive.odometry_travel = 1.0
    drive.run(AHEAD, 2.0)
    assert drive.over == []
    drive.run(AHEAD, 2.0)
    assert [each.name for each in drive.over] == drive.names == ["odometry_off_wheels"]


@pytest.mark.at_length
def test_a_resume_waits_for_each_window_of_a_fault() -> None:
    drive = driving()
    assert goes_wrong(drive, odometry_travel=0.0) <= 0.3
    drive.odometry_travel = 1.05
    drive.run(AHEAD, 4.0)
    left = drive.safety.unresolved_cause()
    assert left is not None
    assert left.text.endswith("over 3.0 s")
    drive.odometry_travel = 1.0
    drive.run(AHEAD, 4.0)
    assert drive.safety.unresolved_cause() is None


@pytest.mark.parametrize("rate_radps", [0.3, 0.025])
def test_a_gyro_that_the_odometry_shares_is_seen_by_the_second_odometry(rate_radps: float) -> None:
    drive = driving()
    drive.gyro_bias_radps = rate_radps
    drive.odometry_bias_radps = rate_radps
    assert goes_wrong(drive, limit_s=8.0) < 8.0
    assert drive.names[0] == "turn_slip"


def test_the_evidence_says_in_figures_who_told_what() -> None:
    drive = driving()
    goes_wrong(drive, odometry_travel=0.0)
    refusal = drive.begun[0].refusal
    assert refusal.reason is Reason.ODOMETRY_OFF_WHEELS
    figures = {figure.name: figure for figure in refusal.figures}
    assert list(figures) == ["commanded", "wheels", "odometry", "bound", "window"]
    assert figures["commanded"].value == pytest.approx(0.8)
    assert figures["wheels"].value == pytest.approx(0.8, abs=0.01)
    assert figures["odometry"].value < 0.7
    assert figures["window"].value == 0.5
    assert "wheels 0.80 m/s" in refusal.text


@pytest.mark.at_length
@pytest.mark.parametrize(
    ("kind", "name", "limit_s"),
    [
        (Joints, "joints_silent", 1.0),
        (Imu, "imu_silent", 1.0),
        (SecondOdometry, "second_odometry_silent", 7.0),
    ],
)
def test_a_sensor_that_falls_silent_is_told_and_stops_nothing(
    kind: type[Joints | Imu | SecondOdometry], name: str, limit_s: float
) -> None:
    drive = driving()
    drive.lost.add(kind)
    assert goes_wrong(drive, limit_s) <= limit_s
    assert drive.names == [name]
    assert drive.begun[0].row.reaction is Reaction.WARN
    assert "not monitored" in drive.begun[0].refusal.text
    drive.run(AHEAD, 1.0)
    drive.lost.clear()
    drive.run(AHEAD, 5.0)
    assert drive.names == [name]
    assert [fault.name for fault in drive.over] == [name]


def test_a_sensor_that_is_never_heard_is_told_once_it_had_its_time() -> None:
    drive = SensedDrive(asset(), lost={Imu})
    drive.run(STANDING, 10.0)
    assert drive.names == []
    drive.run(STANDING, 1.0)
    assert drive.names == ["imu_silent"]
    assert "no IMU message yet" in drive.begun[0].refusal.text


def test_what_is_not_finite_counts_as_silence() -> None:
    drive = driving()
    drive.lost |= {Joints, Imu}
    for _ in range(20):
        drive.run(AHEAD, 0.05)
        now_s = drive.clock.now_s()
        drive.safety.observe(Joints(now_s, (nan, 8.0), (8.0, 8.0), (1.0,), (1.0,)))
        drive.safety.observe(Joints(now_s, (), ()))
        drive.safety.observe(Imu(now_s, 0.0, 0.0, 0.0, 0.0, nan, 0.0, 0.0, 9.81))
    assert set(drive.names) == {"joints_silent", "imu_silent"}


def test_an_imu_without_orientation_keeps_its_gyro_and_its_force_and_no_lean() -> None:
    drive = driving()
    drive.oriented = False
    drive.run(AHEAD, 2.0)
    assert drive.names == []
    gaps = unmonitored(drive.settings, drive.safety.history)
    (lean,) = (each for each in gaps if each.cause == "it measures no orientation")
    assert set(lean.faults) == {"wheel_slip", "tilt_limit_imu"}
    assert "odometry_off_gyro" in found(drive, gyro_bias_radps=0.3)
    drive = driving()
    drive.oriented = False
    assert "motion_blocked" in found(drive, held_n=100.0)


@pytest.mark.at_length
def test_on_a_slope_an_imu_without_orientation_stops_nobody() -> None:
    drive = driving()
    drive.oriented = False
    drive.pitch_rad = -radians(10)
    drive.run(AHEAD, 4.0)
    drive.run(Velocity(0.0, 0.8), 6.0)
    assert drive.names == []


def found(drive: SensedDrive, **wrong: float) -> list[str]:
    goes_wrong(drive, **wrong)
    return drive.names


def test_an_asset_without_the_sensors_has_none_of_their_faults() -> None:
    bare = replace(load_settings("jackal"), sensors=Sensors())
    drive = SensedDrive(bare)
    drive.run(STANDING, 1.0)
    drive.run(AHEAD, 4.0)
    goes_wrong(drive, odometry_travel=1.2, gyro=0.0, aside_mps=0.5)
    assert drive.names == []


def test_torques_are_not_missed_where_the_wheels_tell_none() -> None:
    drive = driving()
    drive.torques = False
    assert goes_wrong(drive, left=0.9, held_n=100.0) == 5.0
    assert drive.names == []


def test_a_rover_that_slides_while_it_is_to_stand_is_told_of() -> None:
    drive = driving()
    drive.run(STANDING, 3.0)
    drive.moving = False
    assert goes_wrong(drive, aside_mps=0.2) <= 2.5
    assert drive.names == ["slide_at_rest"]
    assert drive.begun[0].refusal.reason is Reason.SLIDE_AT_REST


def test_where_the_second_odometry_corrects_the_pose_only_gross_slip_is_a_fault() -> None:
    drive = SensedDrive(asset(fused=True))
    drive.run(STANDING, 1.0)
    drive.run(AHEAD, 4.0)
    assert goes_wrong(drive, aside_mps=0.15) == 5.0
    assert goes_wrong(drive, aside_mps=0.8) <= 2.0
    assert drive.names == ["travel_slip"]


@pytest.mark.at_length
@pytest.mark.parametrize("wheel_noise_radps", [0.0, 0.03])
def test_a_bias_of_the_gyro_is_learnt_while_the_wheels_stand_and_only_then(
    wheel_noise_radps: float,
) -> None:
    drive = SensedDrive(asset(), gyro_bias_radps=0.015, wheel_noise_radps=wheel_noise_radps)
    drive.run(STANDING, 3.0)
    drive.run(AHEAD, 8.0)
    assert drive.names == []
    inertia = drive.safety.history.inertia
    assert inertia is not None
    assert inertia.bias_radps == pytest.approx(0.015, abs=1e-6)
    assert goes_wrong(drive, gyro_bias_radps=0.04) <= 4.0
    assert drive.names == ["odometry_off_gyro"]


@pytest.mark.at_length
@pytest.mark.parametrize("wrong_radps", [0.012, 0.02, 0.05, 0.3, -0.3])
@pytest.mark.parametrize("bias_radps", [0.0, 0.006])
def test_a_gyro_that_was_wrong_at_rest_leaves_no_fault_behind(
    wrong_radps: float, bias_radps: float
) -> None:
    drive = SensedDrive(asset(), gyro_bias_radps=bias_radps)
    drive.moving = False
    drive.run(STANDING, 6.0)
    drive.gyro_bias_radps = bias_radps + wrong_radps
    drive.odometry_bias_radps = wrong_radps
    drive.run(STANDING, 6.0)
    drive.gyro_bias_radps, drive.odometry_bias_radps = bias_radps, 0.0
    drive.safety.history.reset_reference()
    drive.safety.resume()
    drive.moving, drive.begun = True, []
    drive.run(AHEAD, 8.0)
    assert drive.names == []
    assert drive.safety.history.inertia is not None
    assert drive.safety.history.inertia.bias_radps == pytest.approx(bias_radps, abs=0.002)


@pytest.mark.at_length
def test_a_bias_that_stays_another_one_is_learnt_in_the_end() -> None:
    drive = SensedDrive(asset(), gyro_bias_radps=0.002)
    drive.moving = False
    drive.run(STANDING, 6.0)
    drive.gyro_bias_radps = 0.014
    drive.run(STANDING, 60.0)
    drive.moving = True
    drive.run(AHEAD, 8.0)
    assert drive.names == []


@pytest.mark.at_length
def test_what_was_before_the_first_motion_after_a_fault_is_not_looked_at() -> None:
    """It slid aside and was stopped; once it slides no more, nothing of that counts."""
    drive = driving()
    assert goes_wrong(drive, aside_mps=0.5) < 5.0
    drive.moving = False
    drive.run(STANDING, 2.5)
    drive.aside_mps = 0.0
    while drive.safety.active:
        drive.run(STANDING, 0.05)
    drive.moving, drive.begun = True, []
    drive.run(AHEAD, 8.0)
    assert drive.names == []


@pytest.mark.at_length
def test_what_was_before_a_resume_is_not_looked_at(tmp_path: Path) -> None:
    """While it was stopped it was moved aside, more slowly than is noticed at rest."""
    rover = SensedRover(asset())
    with Bench(tmp_path, asset(), rover=rover, all_sensors=True) as bench:
        bench.odometry = False  # it is one of the sensors
        bench.run(3.0)
        bench.submit(Stop(), 1)
        bench.run(2.0)
        rover.body.aside_mps = 0.09
        bench.run(3.0)
        rover.body.aside_mps = 0.0
        assert bench.executive.safety.active == []
        bench.run(0.5)
        bench.submit(Resume(), 2)
        bench.submit(DriveFor(0.5, 0.0, 3.0), 3)
        bench.run(2.5)
        assert bench.stages(3)[-1] is Stage.STARTED, bench.last(3)


def test_a_gyro_may_have_a_bias_before_it_was_learnt() -> None:
    drive = SensedDrive(asset(), gyro_bias_radps=0.015)
    drive.run(AHEAD, 8.0)
    assert drive.names == []


@pytest.mark.at_length
def test_nothing_is_made_of_a_gap_in_what_a_sensor_tells() -> None:
    drive = driving(ARC)
    for kind in (Imu, Joints, SecondOdometry):
        drive.lost.add(kind)
        drive.run(AHEAD, 0.45)
        drive.run(ARC, 0.0)
        drive.lost.clear()
        drive.run(ARC, 2.0)
    assert drive.names == []


DRIVE = DriveFor(0.8, 0.0, 10.0)
TURN = DriveFor(0.0, 1.2, 10.0)


@pytest.mark.at_length
@pytest.mark.parametrize(
    ("request_", "given", "reason"),
    [
        (DRIVE, {"left": 0.0}, Reason.WHEELS_OFF_COMMAND),
        (DRIVE, {"right": 0.9, "torque_nm": 0.0}, Reason.WHEELS_UNPOWERED),
        (DRIVE, {"odometry_travel": 0.0}, Reason.ODOMETRY_OFF_WHEELS),
        (DRIVE, {"odometry_travel": 1.05}, Reason.ODOMETRY_OFF_WHEELS),
        (TURN, {"odometry_turn": 0.0}, Reason.ODOMETRY_OFF_GYRO),
        (TURN, {"odometry_turn": 1.06}, Reason.ODOMETRY_OFF_GYRO),
        (DRIVE, {"gyro_bias_radps": 0.03}, Reason.ODOMETRY_OFF_GYRO),
        (TURN, {"gyro": 0.0, "odometry_turn": 0.0}, Reason.WHEELS_OFF_GYRO),
        (DRIVE, {"grip": 0.0}, Reason.WHEEL_SLIP),
        (DRIVE, {"grip": 0.8}, Reason.TRAVEL_SLIP),
        (DRIVE, {"held_n": 60.0}, Reason.MOTION_BLOCKED),
        (DRIVE, {"roll_rad": 0.6}, Reason.TILT_LIMIT),
        (DRIVE, {"pitch_rad": -0.6}, Reason.TILT_LIMIT),
        (DRIVE, {"aside_mps": 0.5}, Reason.TRAVEL_SLIP),
        (DRIVE, {"aside_mps": 0.15}, Reason.TRAVEL_SLIP),
        (DRIVE, {"gyro_bias_radps": 0.3, "odometry_bias_radps": 0.3}, Reason.TURN_SLIP),
        (DRIVE, {"gyro_bias_radps": 0.025, "odometry_bias_radps": 0.025}, Reason.TURN_SLIP),
    ],
)
def test_a_motion_ends_by_what_its_sensors_show_and_says_so(
    tmp_path: Path, request_: DriveFor, given: dict[str, float], reason: Reason
) -> None:
    rover = SensedRover(asset())
    with Bench(tmp_path, asset(), rover=rover, all_sensors=True) as bench:
        bench.odometry = False  # it is one of the sensors
        bench.run(1.0)
        bench.submit(request_, 1)
        bench.run(3.0)
        assert bench.stages(1)[-1] is not Stage.FAILED
        for name, value in given.items():
            setattr(rover.body, name, value)
        bench.finish(1)
        assert (bench.last(1).stage, bench.last(1).reason) == (Stage.FAILED, reason)
        bench.run(2.0)
        assert rover.velocity == STANDING


def test_gaps_of_the_inertial_sensors_that_repeat_hide_no_slip(tmp_path: Path) -> None:
    rover = SensedRover(load_settings("jackal"))
    with Bench(tmp_path, rover.body.settings, rover=rover, all_sensors=True) as bench:
        bench.odometry = False  # it is one of the sensors
        bench.run(1.0)
        rover.body.grip = 0.0
        bench.submit(MoveForward(2.0), 1)
        for tick in range(60):
            rover.body.lost = {Imu} if tick % 3 else set()
            bench.step()
        assert (bench.last(1).stage, bench.last(1).reason) == (Stage.FAILED, Reason.WHEEL_SLIP)


@pytest.mark.at_length
@pytest.mark.parametrize(
    ("kind", "fault"),
    [
        (Joints, "joints_silent"),
        (Imu, "imu_silent"),
        (SecondOdometry, "second_odometry_silent"),
    ],
)
def test_a_motion_goes_on_without_a_sensor_and_tells_of_its_silence(
    tmp_path: Path, kind: type[Joints | Imu | SecondOdometry], fault: str
) -> None:
    rover = SensedRover(asset())
    with Bench(tmp_path, asset(), rover=rover, all_sensors=True) as bench:
        bench.odometry = False
        bench.run(1.0)
        bench.submit(DRIVE, 1)
        rover.body.lost.add(kind)
        bench.run(7.0)
        rover.body.lost.clear()
        assert bench.finish(1) is Stage.EXECUTED
        told = [r for r in bench.received.reports if r.kind is ReportKind.EVENT]
        assert [r.severity for r in told if r.reason is Reason.SENSOR_SILENT] == [Severity.WARNING]
        assert told[-1].text == f"{fault} cleared"


@pytest.mark.at_length
def test_a_rover_that_slides_where_it_stands_tells_it(tmp_path: Path) -> None:
    rover = SensedRover(asset())
    with Bench(tmp_path, asset(), rover=rover, all_sensors=True) as bench:
        bench.odometry = False
        bench.execute(MoveForward(0.5), 1)
        bench.run(1.0)
        rover.body.aside_mps = 0.2
        bench.run(2.5)
        assert Reason.SLIDE_AT_REST in [r.reason for r in bench.received.reports]


@pytest.mark.parametrize(("aside_mps", "stage"), [(0.1, Stage.EXECUTED), (0.8, Stage.FAILED)])
def test_of_a_fused_second_odometry_only_gross_slip_ends_a_motion(
    tmp_path: Path, aside_mps: float, stage: Stage
) -> None:
    rover, settings = SensedRover(asset(fused=True)), asset(fused=True)
    with Bench(tmp_path, settings, rover=rover, all_sensors=True) as bench:
        bench.odometry = False
        bench.run(1.0)
        bench.submit(DriveFor(0.5, 0.0, 5.0), 1)
        bench.run(2.0)
        rover.body.aside_mps = aside_mps
        bench.run(2.0)
        rover.body.aside_mps = 0.0
        assert bench.finish(1) is stage
        assert bench.last(1).reason is (None if stage is Stage.EXECUTED else Reason.TRAVEL_SLIP)


@pytest.mark.parametrize("velocity", [AHEAD, SPIN])
@pytest.mark.parametrize("stall_s", [0.2, 0.4, 0.8])
def test_a_stall_of_the_executive_is_no_fault_of_the_rover(
    velocity: Velocity, stall_s: float
) -> None:
    drive = SensedDrive(load_settings("jackal"))
    drive.run(STANDING, 1.0)
    for _ in range(3):
        drive.run(velocity, 0.6)
        drive.stalled = True
        drive.run(velocity, stall_s)
        drive.stalled = False
        drive.run(velocity, 1.0)
    assert drive.names == []
    over_ground = drive.safety.history.over_ground
    assert over_ground is not None
    assert over_ground.slid_m == 0.0


@pytest.mark.parametrize("velocity", [ARC, SPIN])
@pytest.mark.parametrize("stall_s", [0.2, 0.25])
def test_a_base_without_processor_time_has_no_fault_of_its_wheels(
    velocity: Velocity, stall_s: float
) -> None:
    drive = SensedDrive(load_settings("jackal"))
    drive.run(STANDING, 1.0)
    back = Velocity(-velocity.travel_mps, -velocity.rotate_radps)
    for wanted in (velocity, STANDING, back, STANDING):
        for before_s in (0.1, 0.2):
            drive.run(wanted, before_s)
            drive.base_stalled = True
            drive.run(wanted, stall_s)
            drive.base_stalled = False
        drive.run(wanted, 1.0)
    assert drive.names == []


class LateWheels(SensedDrive):
    """A drive with wheel speeds that are received late."""

    received_at_s = 0.0

    def _send(self, fact: Fact, late_s: float) -> None:
        late_s = (
            max(0.08, self.received_at_s - self.clock.now_s()) if type(fact) is Joints else late_s
        )
        super()._send(fact, late_s)


def test_a_dead_wheel_is_seen_after_a_burst_of_late_speeds() -> None:
    drive = LateWheels(load_settings("jackal"))
    drive.run(STANDING, 0.5)
    drive.run(AHEAD, 1.0)
    drive.received_at_s = drive.clock.now_s() + 0.4
    drive.run(AHEAD, 1.5)
    assert drive.names == []
    goes_wrong(drive, limit_s=0.5, left=0.0, torque_nm=0.0)
    assert drive.names == ["wheels_off_command"]


class StampsInBursts(SensedDrive):
    """A drive with inertial messages that are stamped ten at a time, once in 0.1 s."""

    def _send(self, fact: Fact, late_s: float) -> None:
        if type(fact) is Imu:
            burst, number = divmod(round(fact.stamp_s / 0.01), 10)
            fact = replace(fact, stamp_s=0.1 * (burst + 1) + 0.001 * number)
            late_s = 0.01 * (9 - number)
        super()._send(fact, late_s)


def test_stamps_in_bursts_hide_no_slip() -> None:
    drive = StampsInBursts(load_settings("jackal"))
    drive.run(STANDING, 1.0)
    drive.run(Velocity(0.3), 1.0)
    assert drive.names == []
    goes_wrong(drive, limit_s=0.05, grip=0.0)
    drive.run(AHEAD, 1.5)
    assert drive.names == ["wheel_slip"]
