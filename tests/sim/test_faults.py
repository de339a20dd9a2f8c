"""Each fault has its effect on the rover while it is there."""

from dataclasses import replace
from math import degrees, hypot, isnan, radians
from pathlib import Path

import pytest

from adapters.mops import Message, MopsStream, load_dictionary
from executive.commands import Command, MoveForward
from executive.commands.lifecycle import Rejected
from executive.settings import LaserSettings, load_settings
from executive.values.facts import Battery, Frame, Odometry
from executive.values.geometry import STANDING, Pose, Velocity, wrap_rad
from executive.values.parameters import Parameter
from executive.values.ports import CameraIntent
from executive.values.reasons import Reason
from executive.values.reports import Identity
from sim.rover import faults
from sim.rover.camera import PictureSettings
from sim.rover.faults import Side, SimulatedFault, declared_faults
from sim.rover.jackal import SimulatedJackal
from sim.rover.lockstep import LockStep
from sim.rover.mocup import SimulatedMocup
from sim.rover.world import World
from tests.brick.rig import command
from tests.sim.driving import hold, readings

AHEAD = Velocity(0.5, 0)
TURN = Velocity(0, 1.0)


@pytest.fixture
def rover() -> SimulatedJackal:
    rover = SimulatedJackal(World())
    hold(rover, AHEAD, 1.0)
    return rover


def received(rover: SimulatedJackal, velocity: Velocity, duration_s: float) -> list[Odometry]:
    return readings(rover, Odometry, velocity, duration_s)


def off_m(rover: SimulatedJackal) -> float:
    true, seen = rover.true_pose, rover.odometry.pose
    return hypot(true.x_m - seen.x_m, true.y_m - seen.y_m)


def turned_deg(after: Pose, before: Pose) -> float:
    return degrees(wrap_rad(after.heading_rad - before.heading_rad))


def test_lost_odometry_is_silent_until_it_recovers(rover: SimulatedJackal) -> None:
    rover.inject(faults.OdometryLost())
    assert received(rover, AHEAD, 1.0) == []
    rover.clear(faults.OdometryLost)
    facts = received(rover, AHEAD, 1.0)
    assert len(facts) == 50
    assert facts[-1].pose.x_m == pytest.approx(rover.true_pose.x_m, abs=0.03)


@pytest.mark.parametrize(
    ("fault", "stamps"), [(faults.OdometryFrozen(), 50), (faults.OdometryRepeated(), 1)]
)
def test_frozen_odometry_has_new_stamps_and_repeated_has_not(
    rover: SimulatedJackal, fault: SimulatedFault, stamps: int
) -> None:
    rover.inject(fault)
    facts = received(rover, AHEAD, 1.0)
    assert len(facts) == 50
    assert len({fact.stamp_s for fact in facts}) == stamps
    assert len({fact.pose for fact in facts}) == 1
    rover.clear(type(fault))
    assert len({fact.pose for fact in received(rover, AHEAD, 1.0)}) == 50


def test_jumping_odometry_stays_where_it_jumped_to(rover: SimulatedJackal) -> None:
    rover.inject(faults.OdometryJump(by_m=-0.5))
    assert off_m(rover) == pytest.approx(0.5, abs=0.02)
    rover.clear(faults.OdometryJump)
    hold(rover, STANDING, 1.0)
    assert off_m(rover) == pytest.approx(0.5, abs=0.02)


def test_drifting_odometry_creeps_to_the_left(rover: SimulatedJackal) -> None:
    rover.inject(faults.OdometryDrift(rate_mps=0.2))
    facts = received(rover, AHEAD, 2.0)
    assert facts[-1].pose.y_m - rover.true_pose.y_m == pytest.approx(0.4, abs=0.02)
    assert facts[-1].velocity.travel_mps == pytest.approx(0.5, abs=0.03)
    rover.clear(faults.OdometryDrift)
    hold(rover, AHEAD, 1.0)
    assert off_m(rover) == pytest.approx(0.4, abs=0.03)


def test_late_odometry_is_old_and_all_of_it_arrives(rover: SimulatedJackal) -> None:
    rover.inject(faults.OdometryLate(by_s=0.3))
    assert received(rover, AHEAD, 0.3) == []
    facts = received(rover, AHEAD, 0.5)
    assert len(facts) == 25
    assert rover.time_s - facts[-1].stamp_s == pytest.approx(0.32, abs=0.011)
    rover.clear(faults.OdometryLate)
    more = received(rover, AHEAD, 0.1)
    assert len(more) == 20
    assert rover.time_s - more[-1].stamp_s == pytest.approx(0.02, abs=0.011)
    stamps_s = [fact.stamp_s for fact in (*facts, *more)]
    assert stamps_s == sorted(set(stamps_s))


def test_odometry_with_jitter_is_late_by_chance_and_all_of_it_arrives_in_order() -> None:
    rover = SimulatedJackal(World(), seed=3)
    rover.inject(faults.OdometryJitter())
    facts, late_s = [], []
    for _ in range(60 * 50):
        rover.advance(0.02)
        arrived = [fact for fact in rover.facts() if isinstance(fact, Odometry)]
        facts += arrived
        late_s += [rover.time_s - fact.stamp_s for fact in arrived]
    stamps_s = [fact.stamp_s for fact in facts]
    assert stamps_s == sorted(set(stamps_s))
    assert len(facts) > 2980
    assert max(late_s) <= 0.221
    assert 0.03 < sum(late_s) / len(late_s) < 0.06
    assert 4 < sum(late > 0.1 for late in late_s) < 150
    rover.clear(faults.OdometryJitter)
    last = received(rover, STANDING, 0.3)[-1]
    assert rover.time_s - last.stamp_s == pytest.approx(0.02, abs=0.011)


def test_odometry_without_twist_reports_standstill(rover: SimulatedJackal) -> None:
    rover.inject(faults.OdometryZeroTwist())
    facts = received(rover, AHEAD, 1.0)
    assert {fact.velocity for fact in facts} == {STANDING}
    assert off_m(rover) < 0.02


@pytest.mark.parametrize(
    ("fault", "ratio"),
    [
        (faults.EncoderScale(factor=1.5), 1.5),
        (faults.EncoderScale(factor=-1.0), -1.0),
        (faults.EncoderDead(), 0.0),
        (faults.EncoderDead(Side.LEFT), 0.5),
    ],
)
def test_encoders_count_their_input(
    rover: SimulatedJackal, fault: SimulatedFault, ratio: float
) -> None:
    before, true = rover.odometry.pose.x_m, rover.true_pose.x_m
    rover.inject(fault)
    hold(rover, AHEAD, 2.0)
    counted_m, driven_m = rover.odometry.pose.x_m - before, rover.true_pose.x_m - true
    assert counted_m == pytest.approx(ratio * driven_m, abs=0.02)


@pytest.mark.parametrize(
    ("fault", "ratio", "rate_radps"),
    [
        (faults.GyroGain(factor=1.2), 1.2, 0.0),
        (faults.GyroGain(factor=-1.0), -1.0, 0.0),
        (faults.GyroDead(), 0.0, 0.0),
        (faults.GyroBias(rate_radps=0.3), 1.0, 0.3),
    ],
)
def test_the_gyro_measures_its_input(
    rover: SimulatedJackal, fault: SimulatedFault, ratio: float, rate_radps: float
) -> None:
    rover.inject(fault)
    facts = received(rover, TURN, 2.0)
    true_radps = rover.true_velocity.rotate_radps
    assert true_radps == pytest.approx(1.0, abs=0.1)
    measured_radps = sum(fact.velocity.rotate_radps for fact in facts[-10:]) / 10
    assert measured_radps == pytest.approx(ratio * true_radps + rate_radps, abs=0.02)


@pytest.mark.parametrize(
    ("fault", "ahead_deg", "turn_deg"),
    [
        (faults.LeftWheelsStuck(), 102, 58),
        (faults.RightWheelsStuck(), -102, 58),
        (faults.WheelsStuck(), 0, 3),
        (faults.MotorDead(Side.LEFT), 0, 14),
        (faults.MotorDead(), 0, 7),
        (None, 0, 116),
    ],
)
def test_wheels_that_do_not_drive_change_how_it_turns(
    fault: SimulatedFault | None, ahead_deg: float, turn_deg: float
) -> None:
    for velocity, expected_deg in ((AHEAD, ahead_deg), (TURN, turn_deg)):
        rover = SimulatedJackal(World())
        hold(rover, velocity, 1.0)
        before = rover.true_pose
        if fault is not None:
            rover.inject(fault)
        hold(rover, velocity, 2.0)
        assert turned_deg(rover.true_pose, before) == pytest.approx(expected_deg, abs=3)
        if fault is not None:
            rover.clear(type(fault))
        hold(rover, velocity, 1.0)
        assert rover.true_velocity.travel_mps == pytest.approx(velocity.travel_mps, abs=0.02)
        assert rover.true_velocity.rotate_radps == pytest.approx(velocity.rotate_radps, abs=0.05)


def test_locked_wheels_stop_it_and_dead_motors_let_it_roll() -> None:
    rolled_m = []
    for fault in (faults.WheelsStuck(), faults.MotorDead()):
        rover = SimulatedJackal(World())
        hold(rover, Velocity(1.0, 0), 1.5)
        start_m = rover.true_pose.x_m
        rover.inject(fault)
        hold(rover, STANDING, 3.0)
        rolled_m.append(rover.true_pose.x_m - start_m)
    assert rolled_m[0] < 0.2
    assert rolled_m[1] > 1.0


def test_a_brownout_leaves_too_little_torque_to_climb() -> None:
    climbed_m = []
    for factor in (1.0, 0.12):
        rover = SimulatedJackal(World(slope_rad=radians(10)))
        rover.inject(faults.Brownout(factor))
        hold(rover, AHEAD, 2.0)
        climbed_m.append(rover.true_pose.x_m)
    assert climbed_m[0] > 0.9
    assert climbed_m[1] < 0.5 * climbed_m[0]


def test_slippery_ground_does_not_hold_it() -> None:
    rover = SimulatedJackal(World(slope_rad=radians(10)))
    hold(rover, STANDING, 0.5)
    rover.inject(faults.LowFriction(factor=0.1))
    hold(rover, STANDING, 1.0)
    assert rover.true_pose.x_m < -0.2
    rover.clear(faults.LowFriction)
    hold(rover, STANDING, 1.0)
    assert abs(rover.true_velocity.travel_mps) < 0.01


def test_commands_that_are_cut_time_out(rover: SimulatedJackal) -> None:
    rover.inject(faults.CmdVelLost())
    hold(rover, AHEAD, 0.8)
    assert rover.true_velocity.travel_mps == pytest.approx(0, abs=0.01)
    rover.clear(faults.CmdVelLost)
    hold(rover, AHEAD, 0.5)
    assert rover.true_velocity.travel_mps == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize(("rate_hz", "distance_m"), [(50.0, (0.75, 0.85)), (10.0, (0.08, 0.4))])
def test_the_more_frequent_publisher_has_the_base(
    rover: SimulatedJackal, rate_hz: float, distance_m: tuple[float, float]
) -> None:
    rover.inject(faults.CmdVelOverridden(travel_mps=-0.4, rate_hz=rate_hz))
    hold(rover, STANDING, 0.5)
    start_m = rover.true_pose.x_m
    hold(rover, STANDING, 2.0)
    assert distance_m[0] < start_m - rover.true_pose.x_m < distance_m[1]
    rover.clear(faults.CmdVelOverridden)
    hold(rover, STANDING, 0.5)
    assert abs(rover.true_velocity.travel_mps) < 0.01


@pytest.mark.parametrize(("by_deg", "lies_deg"), [(30, 0), (120, 180), (-120, 180)])
def test_it_falls_over_and_is_set_upright_again(by_deg: float, lies_deg: float) -> None:
    rover = SimulatedJackal(World())
    hold(rover, AHEAD, 1.0)
    heading_rad = rover.true_pose.heading_rad
    rover.inject(faults.Tip(radians(by_deg)))
    assert rover.true_pose.roll_rad == pytest.approx(radians(by_deg), abs=0.02)
    hold(rover, STANDING, 2.0)
    assert abs(degrees(rover.true_pose.roll_rad)) == pytest.approx(lies_deg, abs=5)
    rover.clear(faults.Tip)
    hold(rover, STANDING, 1.0)
    assert abs(degrees(rover.true_pose.roll_rad)) < 2
    assert rover.true_pose.heading_rad == pytest.approx(heading_rad, abs=0.3)
    hold(rover, AHEAD, 0.5)
    assert rover.true_velocity.travel_mps == pytest.approx(0.5, abs=0.05)


def test_pushed_it_drives_beside_its_path_and_odometry_does_not_measure_it(
    rover: SimulatedJackal,
) -> None:
    rover.inject(faults.Pushed(by_m=-0.7))
    assert rover.true_pose.y_m == pytest.approx(-0.7, abs=0.02)
    hold(rover, AHEAD, 1.0)
    assert rover.true_pose.y_m == pytest.approx(-0.7, abs=0.03)
    assert rover.odometry.pose.y_m == pytest.approx(0, abs=0.03)
    assert rover.true_velocity.travel_mps == pytest.approx(0.5, abs=0.02)


def volts(rover: SimulatedJackal) -> list[float]:
    return [battery.voltage_v for battery in readings(rover, Battery, STANDING, 3.0)]


def test_the_battery_reports_too_little_nothing_or_no_number(rover: SimulatedJackal) -> None:
    rover.inject(faults.BatteryLow())
    assert volts(rover) == [21.5] * 3
    rover.clear(faults.BatteryLow)
    rover.inject(faults.BatteryNan())
    assert len(nans := volts(rover)) == 3
    assert all(map(isnan, nans))
    rover.clear(faults.BatteryNan)
    rover.inject(faults.BatterySilent())
    assert volts(rover) == []
    rover.clear(faults.BatterySilent)
    assert all(24 < voltage_v < 29.4 for voltage_v in volts(rover))


def charge_ratios(rover: SimulatedJackal) -> list[float | None]:
    return [battery.charge_ratio for battery in readings(rover, Battery, STANDING, 1.0)]


def test_a_drained_battery_remains_at_its_charge_and_is_not_charged(rover: SimulatedJackal) -> None:
    full = charge_ratios(rover)
    rover.inject(faults.BatteryDrained(1.0))
    assert charge_ratios(rover) == pytest.approx(full, abs=1e-3)
    assert max(volts(rover)) > 27
    rover.inject(faults.BatteryDrained(0.1))
    assert charge_ratios(rover) == pytest.approx([0.1], abs=1e-3)
    assert 23 < max(volts(rover)) < 26
    rover.clear(faults.BatteryDrained)
    assert charge_ratios(rover) == pytest.approx([0.1], abs=1e-3)


@pytest.mark.parametrize(
    ("charge", "reason"),
    [(0.1, Reason.BATTERY_INSUFFICIENT), (0.0, Reason.WRONG_MODE)],
    ids=["short", "empty: SAFE by its voltage"],
)
def test_a_rover_with_a_drained_battery_begins_no_motion(
    tmp_path: Path, charge: float, reason: Reason
) -> None:
    lockstep = LockStep(load_settings("jackal"), World(), tmp_path)
    lockstep.run(1.5)
    lockstep.rover.inject(faults.BatteryDrained(charge))
    lockstep.run(1.5)
    answer = lockstep.submit(Command(Identity("MOE", 1), MoveForward(1.0), "direct"))
    lockstep.executive.close()
    assert isinstance(answer, Rejected)
    assert answer.refusal.reason is reason


@pytest.mark.parametrize("blind", [faults.LaserBlind(), faults.LaserBlind(0.9, radians(60))])
def test_a_rover_with_a_blind_laser_does_not_drive_into_its_sector(
    tmp_path: Path, blind: faults.LaserBlind
) -> None:
    jackal = load_settings("jackal")
    seeing = replace(jackal, sensors=replace(jackal.sensors, laser=LaserSettings(10)))
    lockstep = LockStep(seeing, World(), tmp_path)
    lockstep.rover.inject(blind)
    lockstep.run(1.5)
    lockstep.submit(Command(Identity("MOE", 1), MoveForward(1.5), "direct"))
    lockstep.run(2.0)
    last = [
        each for each in lockstep.downlink_record.reports if each.identity == Identity("MOE", 1)
    ][-1]
    lockstep.executive.close()
    assert last.reason is Reason.LASER_BLIND
    assert hypot(lockstep.rover.true_pose.x_m, lockstep.rover.true_pose.y_m) < 0.05


def picture(rover: SimulatedJackal) -> Frame | None:
    rover.request_frame()
    frames = readings(rover, Frame, TURN, 0.2)
    return frames[0] if frames else None


def test_a_dead_camera_sends_no_picture(rover: SimulatedJackal) -> None:
    rover.inject(faults.CameraDead())
    assert picture(rover) is None
    rover.clear(faults.CameraDead)
    assert not readings(rover, Frame, STANDING, 0.2)
    assert picture(rover)


def test_a_stale_camera_sends_its_last_frame_and_a_cut_one_too_little(
    rover: SimulatedJackal,
) -> None:
    rover.inject(faults.CameraStale())
    since_s = rover.time_s
    hold(rover, TURN, 1.0)
    first, second = picture(rover), picture(rover)
    assert first is not None
    assert first == second
    assert first.stamp_s == since_s
    rover.clear(faults.CameraStale)
    fresh = picture(rover)
    assert fresh is not None
    assert fresh.data != first.data
    assert fresh.stamp_s > since_s + 1.0
    rover.inject(faults.CameraTruncated())
    cut = picture(rover)
    assert cut is not None
    assert len(cut.data) == 200


OF_SENSORS = {
    *("imu_dead", "joints_dead", "laser_dead", "laser_blind"),
    *("second_odometry_lost", "second_odometry_frozen"),
    *("second_odometry_jump", "second_odometry_drift"),
}


@pytest.mark.parametrize(
    ("kind", "lacks"),
    [
        (SimulatedJackal, {"link_lost", "brick_silent", *OF_SENSORS}),
        (
            SimulatedMocup,
            {
                *("link_lost", "gyro_gain", "gyro_bias", "gyro_dead"),
                *("cmd_vel_lost", "cmd_vel_overridden", "odometry_jitter", *OF_SENSORS),
            },
        ),
    ],
)
def test_a_rover_has_each_fault_of_its_parts(
    kind: type[SimulatedJackal] | type[SimulatedMocup], lacks: set[str]
) -> None:
    rover = kind(World(), picture=PictureSettings(16, 12))
    refused = set()
    for declaration in declared_faults():
        if declaration.name in lacks:
            with pytest.raises(ValueError, match=f"{declaration.name} needs "):
                rover.inject(declaration.make({}))
            refused.add(declaration.name)
            continue
        rover.inject(declaration.make({}))
        rover.request_frame()
        rover.advance(0.1)
        rover.facts()
        rover.clear(declaration.kind)
        rover.advance(0.1)
        assert rover.true_pose.finite
    assert refused == lacks


class Mocup:
    """MOCUP on its way ahead at 0.2 m/s, and what its telemetry tells."""

    def __init__(self) -> None:
        self.rover = SimulatedMocup(World())
        self.rover.receive(str(command("setTravelSpeed", 1, "0.2")).encode())
        self.rover.advance(0.2)
        self.rover.receive(str(command("moveForward", 2, "9")).encode())
        self.reports(2.0)

    def reports(self, duration_s: float) -> list[dict[Parameter, float | None]]:
        """Return what each telemetry of a time says."""
        self.rover.advance(duration_s)
        spelling = load_dictionary().spelling.telemetry
        found: list[Message] = []
        stream = MopsStream(lambda line: pytest.fail(line))
        found += stream.feed(self.rover.brick.transmit())
        return [
            {
                name: float(text) if text else None
                for name, text in zip(spelling.outputs, message.outputs, strict=True)
            }
            for message in found
            if message.code == spelling.code
        ]

    def speeds_mps(self, duration_s: float = 1.0) -> list[float | None]:
        return [each[Parameter.CURRENT_TRAVEL_SPEED] for each in self.reports(duration_s)]


def test_telemetry_of_mocup_fails_as_odometry_does() -> None:
    mocup = Mocup()
    rover = mocup.rover
    assert mocup.speeds_mps() == pytest.approx([0.2] * 5, abs=0.01)
    rover.inject(faults.OdometryLost())
    assert mocup.reports(1.0) == []
    rover.clear(faults.OdometryLost)
    rover.inject(faults.OdometryRepeated())
    first, *more = mocup.reports(1.0)
    assert more == [first] * 4
    rover.clear(faults.OdometryRepeated)
    rover.inject(faults.OdometryZeroTwist())
    assert mocup.speeds_mps() == [0.0] * 5
    rover.clear(faults.OdometryZeroTwist)
    rover.inject(faults.OdometryLate(by_s=0.6))
    message = mocup.reports(2.0)[-1][Parameter.POS_X]
    assert message is not None
    assert rover.brick.machine.odometry.pose.x_m - message == pytest.approx(0.2 * 0.6, abs=0.05)
    rover.clear(faults.OdometryLate)
    rover.inject(faults.BatterySilent())
    assert {each[Parameter.BATERY_VOLTAGE] for each in mocup.reports(1.0)} == {None}


@pytest.mark.parametrize(
    ("fault", "ratio"), [(faults.EncoderScale(factor=1.5), 1.5), (faults.OdometryFrozen(), 0.0)]
)
def test_mocup_counts_its_commands(fault: SimulatedFault, ratio: float) -> None:
    mocup = Mocup()
    rover = mocup.rover
    counted = rover.brick.machine.odometry
    before, true = counted.pose.x_m, rover.true_pose.x_m
    rover.inject(fault)
    rover.advance(0.8)
    counted_m, driven_m = counted.pose.x_m - before, rover.true_pose.x_m - true
    assert driven_m > 0.1
    assert counted_m == pytest.approx(ratio * driven_m, abs=0.01)


def test_mocup_with_a_dead_encoder_takes_its_motor_for_stuck() -> None:
    mocup = Mocup()
    mocup.rover.inject(faults.EncoderDead(Side.RIGHT))
    mocup.rover.advance(2.0)
    assert b"the right motor is stuck" in mocup.rover.brick.transmit()


def test_a_silent_brick_continues_and_reports_again_later() -> None:
    mocup = Mocup()
    rover = mocup.rover
    rover.inject(faults.BrickSilent())
    before_m = rover.true_pose.x_m
    assert mocup.reports(1.0) == []
    assert rover.true_pose.x_m == pytest.approx(before_m + 0.2, abs=0.02)
    rover.clear(faults.BrickSilent)
    assert len(mocup.reports(1.0)) == 5


def test_a_head_that_is_stuck_stays_where_it_was_until_it_is_free(rover: SimulatedJackal) -> None:
    rover.point_camera(CameraIntent(1.0, 0.5, 1.0))
    hold(rover, STANDING, 0.5)
    rover.inject(faults.HeadStuck())
    stuck = rover.camera_angles
    hold(rover, STANDING, 2.0)
    assert rover.camera_angles.pan_rad == pytest.approx(stuck.pan_rad, abs=0.02)
    rover.clear(faults.HeadStuck)
    hold(rover, STANDING, 2.0)
    assert rover.camera_angles.pan_rad == pytest.approx(1.0, abs=0.02)


def test_a_voltage_that_is_no_number_is_as_good_as_none(tmp_path: Path) -> None:
    for asset in ("jackal", "mocup"):
        lock = LockStep(load_settings(asset), World(), tmp_path / asset)
        lock.run(1.5)
        before = lock.executive.parameters()
        lock.rover.inject(faults.BatteryNan())
        lock.run(1.5)
        volts = [
            value.value
            for values in (before, lock.executive.parameters())
            for value in values
            if value.parameter is Parameter.BATERY_VOLTAGE
        ]
        assert volts[0] is not None
        assert volts[1] is None
