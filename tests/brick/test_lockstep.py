"""An executive that commands MOCUP by strings, in lock step with physics."""

from pathlib import Path

import pytest

from executive.commands.catalogue import (
    Command,
    DriveFor,
    MoveForward,
    Request,
    Resume,
    RotateBy,
    SetCameraAngles,
    Stop,
)
from executive.settings import load_settings
from executive.values.facts import MotionStarted
from executive.values.geometry import Velocity, arc, wrap_rad
from executive.values.reasons import Reason
from executive.values.reports import Identity, Report, Stage
from sim.rover.faults import (
    BatteryNan,
    BrickSilent,
    EncoderScale,
    HeadStuck,
    LeftWheelsStuck,
    MotorDead,
    OdometryJump,
    OdometryLost,
    OdometryRepeated,
    OdometryZeroTwist,
    Side,
    SimulatedFault,
    WheelsStuck,
)
from sim.rover.lockstep import LockStep
from sim.rover.mocup import SimulatedMocup
from sim.rover.world import World


class Mocup:
    """MOCUP and its executive."""

    def __init__(self, folder: Path, seed: int = 1) -> None:
        self.lock = LockStep(load_settings("mocup"), World(), folder, seed)
        assert isinstance(self.lock.rover, SimulatedMocup)
        self.rover = self.lock.rover
        self._numbers = 0
        self.lock.run(0.5)

    def request(self, request: Request) -> int:
        self._numbers += 1
        self.lock.submit(Command(Identity("MOE", self._numbers), request, "direct"))
        return self._numbers

    def lifecycle(self, number: int) -> list[Report]:
        return [
            report
            for report in self.lock.downlink_record.reports
            if report.identity == Identity("MOE", number)
        ]

    def ended(self, number: int) -> bool:
        lifecycle = self.lifecycle(number)
        return bool(lifecycle) and lifecycle[-1].stage is not None and lifecycle[-1].stage.terminal

    def do(self, request: Request) -> Report:
        number = self.request(request)
        assert self.lock.run_until(lambda: self.ended(number), 90.0), self.lifecycle(number)
        return self.lifecycle(number)[-1]


@pytest.fixture
def mocup(tmp_path: Path) -> Mocup:
    return Mocup(tmp_path)


def test_a_stop_halts_within_a_tenth_of_a_second_and_ends_the_motion(mocup: Mocup) -> None:
    moving = mocup.request(MoveForward(5.0))
    mocup.lock.run(2.0)
    assert mocup.rover.true_velocity.travel_mps == pytest.approx(0.2, abs=0.01)
    stop = mocup.request(Stop())
    mocup.lock.run(0.1)
    assert mocup.rover.true_velocity.travel_mps == pytest.approx(0.0, abs=0.005)
    assert mocup.lock.run_until(lambda: mocup.ended(stop), 2.0)
    assert mocup.lifecycle(stop)[-1].stage is Stage.EXECUTED
    assert mocup.lifecycle(moving)[-1].stage is Stage.CANCELLED
    assert mocup.do(Resume()).stage is Stage.EXECUTED
    assert mocup.do(MoveForward(0.2)).stage is Stage.EXECUTED


@pytest.mark.parametrize(
    ("fault", "request_", "reason", "within_s"),
    [
        (LeftWheelsStuck(), MoveForward(3.0), Reason.OFF_COMMAND, 0.8),
        (WheelsStuck(), RotateBy(6.0), Reason.OFF_COMMAND, 0.8),
        (EncoderScale(0.75), MoveForward(3.0), Reason.OFF_COMMAND, 2.5),
        (EncoderScale(1.3), RotateBy(6.0), Reason.OFF_COMMAND, 1.2),
        (OdometryZeroTwist(), MoveForward(3.0), Reason.OFF_COMMAND, 0.6),
        (OdometryRepeated(), MoveForward(3.0), Reason.ODOMETRY_FROZEN, 1.0),
        (OdometryJump(0.15), MoveForward(3.0), Reason.ODOMETRY_JUMPED, 0.3),
        (BrickSilent(), MoveForward(3.0), Reason.ODOMETRY_STALE, 1.2),
    ],
    ids=lambda value: type(value).__name__,
)
def test_a_fault_during_a_motion_fails_the_command_with_figures(
    mocup: Mocup, fault: SimulatedFault, request_: Request, reason: Reason, within_s: float
) -> None:
    number = mocup.request(request_)
    mocup.lock.run(2.0)
    mocup.rover.inject(fault)
    assert mocup.lock.run_until(lambda: mocup.ended(number), within_s)
    ended = mocup.lifecycle(number)[-1]
    assert (ended.stage, ended.reason) == (Stage.FAILED, reason)
    assert any(figure.name == "bound" for figure in ended.figures)
    mocup.lock.run(1.0)
    assert mocup.rover.true_velocity.travel_mps == pytest.approx(0.0, abs=0.005)


def test_a_rover_that_does_not_report_its_start_is_watched_later(
    mocup: Mocup, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("adapters.mocup.plugin.MotionStarted", lambda _: MotionStarted(-1))
    assert mocup.do(MoveForward(2.0)).stage is Stage.EXECUTED
    number = mocup.request(MoveForward(2.0))
    mocup.lock.run(6.0)
    mocup.rover.inject(OdometryZeroTwist())
    assert mocup.lock.run_until(lambda: mocup.ended(number), 0.8)
    assert mocup.lifecycle(number)[-1].reason is Reason.OFF_COMMAND


@pytest.mark.parametrize("request_", [MoveForward(-1.0), RotateBy(3.0), RotateBy(-6.0)])
def test_a_late_start_report_of_the_brick_is_accepted(mocup: Mocup, request_: Request) -> None:
    number, status = mocup.request(request_), mocup.lock.executive.status
    assert mocup.lock.run_until(lambda: status.motion_started is not None, 2.0)
    status.motion_started_at_s += 1.0
    assert mocup.lock.run_until(lambda: mocup.ended(number), 30.0)
    assert mocup.lifecycle(number)[-1].stage is Stage.EXECUTED, mocup.lifecycle(number)[-1]


def test_a_command_aborted_by_the_brick_fails(mocup: Mocup) -> None:
    mocup.rover.inject(WheelsStuck())
    assert mocup.do(MoveForward(0.1)).reason is Reason.MOTION_NOT_EXECUTED


@pytest.mark.parametrize("before_end_s", [0.2, 0.3, 0.4, 0.5])
def test_what_ends_with_another_heading_fails(mocup: Mocup, before_end_s: float) -> None:
    number = mocup.request(MoveForward(0.3))
    mocup.lock.run(2.2 - before_end_s)
    mocup.rover.inject(MotorDead(Side.LEFT))
    assert mocup.lock.run_until(lambda: mocup.ended(number), 10.0)
    off_rad = abs(mocup.rover.true_pose.heading_rad)
    assert off_rad < 0.1 or mocup.lifecycle(number)[-1].stage is Stage.FAILED


@pytest.mark.parametrize("velocity", [Velocity(0.2), Velocity(-0.15, 0.1)])
def test_a_held_velocity_covers_its_stated_distance(mocup: Mocup, velocity: Velocity) -> None:
    start = mocup.rover.brick.machine.odometry.pose
    ended = mocup.do(DriveFor(velocity.travel_mps, velocity.rotate_radps, 2.0))
    assert ended.stage is Stage.EXECUTED, ended
    _, wanted = arc(start, velocity, 2.0)
    seen = mocup.rover.brick.machine.odometry.pose
    assert seen.point.distance_m(wanted.point) < 0.03
    assert wrap_rad(seen.heading_rad - wanted.heading_rad) == pytest.approx(0.0, abs=0.05)


def test_a_voltage_that_is_no_number_is_warned_of_and_stops_nothing(mocup: Mocup) -> None:
    mocup.rover.inject(BatteryNan())
    assert mocup.do(MoveForward(0.5)).stage is Stage.EXECUTED
    reasons = [report.reason for report in mocup.lock.downlink_record.reports]
    assert Reason.BATTERY_NOT_FINITE in reasons


def test_a_head_that_is_stuck_fails_its_command(mocup: Mocup) -> None:
    mocup.rover.inject(HeadStuck())
    assert mocup.do(SetCameraAngles(0.5, 0.2)).reason is Reason.PAN_TILT_DEADLINE


def test_lost_telemetry_halts_the_rover(mocup: Mocup) -> None:
    mocup.request(MoveForward(5.0))
    mocup.lock.run(2.0)
    mocup.rover.inject(OdometryLost())
    mocup.lock.run(1.5)
    assert mocup.rover.true_velocity.travel_mps == pytest.approx(0.0, abs=0.005)


def test_a_restarted_executive_commands_the_brick_again(mocup: Mocup) -> None:
    mocup.request(MoveForward(5.0))
    mocup.lock.run(2.0)
    mocup.lock.kill()
    mocup.lock.start()
    mocup.lock.run(1.0)
    assert mocup.rover.true_velocity.travel_mps == pytest.approx(0.0, abs=0.005)
    mocup.do(Resume())
    assert mocup.do(MoveForward(0.2)).stage is Stage.EXECUTED
