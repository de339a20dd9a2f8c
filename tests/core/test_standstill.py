"""What a stop, the end of a motion and `why` say of whether the rover moves."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from executive.commands import DriveFor, Mode, MoveForward, MoveTo, Resume, Stop, Waypoint
from executive.settings import load_settings
from executive.values.facts import ForeignPublishers, Imu, Joints, Odometry, SecondOdometry
from executive.values.geometry import GRAVITY_MPS2, STANDING, Pose, Velocity
from executive.values.reasons import Reason
from executive.values.reports import Identity, Stage
from tests.support.kinematic import STEP_S, Bench, KinematicRover, ignoring, with_figures


class SlidingBench(Bench):
    """The rover slides on, whatever is commanded, and what tells of it is chosen.

    Attributes:
        slide_mps: along x; the pose of the odometry shows it if `shown`, its twist never does.
    """

    slide_mps = 0.0
    shown = True
    true_x_m = 0.0

    def step(self) -> None:
        self.true_x_m += self.slide_mps * STEP_S
        if self.shown and self.slide_mps:
            pose = self.rover.pose
            self.rover.pose = replace(pose, x_m=pose.x_m + self.slide_mps * STEP_S)
        super().step()


@pytest.fixture
def sliding(tmp_path: Path) -> SlidingBench:
    return SlidingBench(tmp_path)


def test_a_stop_is_not_done_while_the_pose_moves_without_a_twist(sliding: SlidingBench) -> None:
    sliding.slide_mps = 0.4
    sliding.submit(Stop(), 1)
    assert sliding.finish(1) is Stage.FAILED
    reported = [r for r in sliding.received.reports if r.stage is Stage.PROGRESS]
    assert [report.step for report in reported] == [1, 2, 3, 4]
    assert "0.40 m/s, 0.00°/s by odometry" in reported[0].text
    last = sliding.last(1)
    assert last.reason is Reason.STOP_DEADLINE
    assert "0.40 m/s" in last.text
    assert {f.name: round(f.value, 2) for f in last.figures}["odometry"] == 0.4


def test_a_stop_is_done_once_the_pose_was_constant_for_a_while(sliding: SlidingBench) -> None:
    sliding.slide_mps = 0.4
    sliding.submit(Stop(), 1)
    sliding.run(1.5)
    sliding.slide_mps = 0.0
    sliding.run(0.1)
    assert sliding.stages(1)[-1] is Stage.PROGRESS
    assert sliding.finish(1, 0.3) is Stage.EXECUTED
    assert sliding.last(1).text.endswith("by odometry alone")


def test_a_stop_waits_for_stationary_frames_of_a_second_odometry(sliding: SlidingBench) -> None:
    sliding.slide_mps, sliding.shown = 0.4, False
    sliding.submit(Stop(), 1)
    for halves in range(5):
        now_s = sliding.clock.now_s()
        sliding.executive.observe(SecondOdometry(now_s - 0.3, Pose(sliding.true_x_m)))
        if halves == 2:
            sliding.slide_mps = 0.0
        sliding.run(0.5)
        if halves == 2:
            assert sliding.stages(1)[-1] is Stage.PROGRESS
            assert "m/s, 0.00°/s by second odometry" in sliding.last(1).text
    assert sliding.stages(1)[-1] is Stage.EXECUTED
    assert "by odometry and second odometry" in sliding.last(1).text


@pytest.mark.parametrize("source", ["joints", "gyro"])
def test_a_stop_is_not_done_while_wheels_or_gyro_turn(bench: Bench, source: str) -> None:
    def log(turning: bool) -> None:
        wheels, rate_radps = ((4.0, 4.1), 0.5) if turning else ((0.1, 0.0), 0.01)
        stamp_s = bench.clock.now_s()
        bench.rover.facts = [
            Joints(stamp_s, wheels, (0.0, 0.0))
            if source == "joints"
            else Imu(stamp_s, 0.0, 0.0, 0.0, 0.0, rate_radps, 0.0, 0.0, 9.81)
        ]
        bench.step()

    bench.submit(Stop(), 1)
    for _ in range(30):
        log(turning=True)
    assert bench.stages(1)[-1] is Stage.PROGRESS
    assert f"°/s by {source}" in bench.last(1).text
    for _ in range(5):
        log(turning=False)
    assert bench.stages(1)[-1] is Stage.EXECUTED
    assert f"by odometry and {source}" in bench.last(1).text


def test_odometry_that_showed_no_motion_is_not_believed_at_once(tmp_path: Path) -> None:
    class Dead(Bench):
        def step(self) -> None:
            true, self.rover.pose = self.rover.pose, Pose()
            velocity, self.odometry = self.rover.velocity, False
            super().step()
            self.rover.pose = true
            self.executive.observe(Odometry(self.clock.now_s(), Pose(), STANDING))
            del velocity

    blind = ignoring("odometry_frozen", "off_command", "no_progress")
    with Dead(tmp_path, blind) as bench:
        bench.submit(DriveFor(1.0, 0.0, 5.0), 1)
        bench.run(2.0)
        assert bench.executive.velocity.travel_mps > 0.9
        bench.submit(Stop(), 2)
        bench.run(0.9)
        assert bench.stages(2)[-1] is Stage.STARTED
        assert bench.finish(2, 0.3) is Stage.EXECUTED


def test_the_end_of_a_motion_reports_pose_and_source(bench: Bench) -> None:
    bench.execute(MoveTo(Waypoint(1.0, 0.5, 0.3)), 1)
    assert bench.last(1).text.endswith("by odometry alone")
    figures = {figure.name: figure for figure in bench.last(1).figures}
    assert figures["x"].value == bench.rover.pose.x_m
    assert figures["y"].value == bench.rover.pose.y_m
    assert figures["heading"].value == bench.rover.pose.heading_rad
    bench.execute(DriveFor(0.2, 0.0, 1.0), 2)
    assert bench.last(2).text == "velocity held for its time, by odometry alone"
    assert {"x", "y", "heading"} <= {figure.name for figure in bench.last(2).figures}


class BlockedRover(KinematicRover):
    """Stands before a wall."""

    def advance(self, step_s: float) -> None:
        sent, self.velocity = self.velocity, STANDING
        super().advance(step_s)
        del sent


def test_why_gives_the_measured_velocity_not_the_commanded(tmp_path: Path) -> None:
    blind = ignoring("odometry_frozen", "off_command", "no_progress", "odometry_off_twist")
    with Bench(tmp_path, blind, rover=BlockedRover()) as bench:
        bench.drive_on()
        assert bench.executive.velocity.travel_mps > 0.5
        assert bench.executive.why == "standing during MOE:1 moveForward"


def test_why_reports_motion_without_a_command_here(bench: Bench) -> None:
    bench.executive.observe(ForeignPublishers(("/joystick",)))
    bench.run(1.0)
    bench.rover.velocity = Velocity(0.0, 0.7)  # another node spins it
    bench.run(0.5)
    moves = "moves at +0.00 m/s, +40.1°/s, but should be stationary: "
    assert bench.executive.why.startswith(moves + "no motion goal")
    bench.submit(Stop(), 1)
    for _ in range(4):
        bench.rover.velocity = Velocity(0.0, 0.7)
        bench.step()
        assert bench.executive.why.startswith(moves + "stopped by MOE:1")
    bench.finish(1)
    assert Identity("MOE", 1) == bench.last(1).identity
    bench.drive_on()
    assert bench.executive.why.startswith("STOPPED: the rover turns at ")
    assert "°/s without a command" in bench.executive.why


def test_a_publisher_that_sends_nothing_does_not_excuse_motion(bench: Bench) -> None:
    bench.executive.observe(ForeignPublishers(("/joystick",)))
    bench.run(3.0)
    bench.rover.velocity = Velocity(0.3, 0.0)  # it slides, or somebody drives it unheard
    bench.run(2.0)
    assert bench.executive.mode is Mode.STOPPED
    assert "(velocity publishers: /joystick)" in bench.executive.why


def test_why_gives_the_speed_of_a_command(bench: Bench) -> None:
    bench.submit(MoveForward(5.0), 1)
    bench.run(0.9)
    assert bench.executive.why.startswith("moves at +0.")
    assert bench.executive.why.endswith("for MOE:1 moveForward")


class IceBench(Bench):
    """The wheels of a level rover turn as commanded at once; friction makes the rover follow.

    Attributes:
        friction: of the ground.
        true_mps: how fast it truly goes.
        imu, joints: whether they are received.
    """

    friction = 0.6
    true_mps = 0.0
    imu = joints = True

    def step(self) -> None:
        before_mps, wheels_mps = self.true_mps, self.rover.velocity.travel_mps
        max_mps = GRAVITY_MPS2 * self.friction * STEP_S
        self.true_mps += max(-max_mps, min(max_mps, wheels_mps - before_mps))
        ahead_mps2 = (self.true_mps - before_mps) / STEP_S
        stamp_s, radps = self.clock.now_s() + STEP_S, (wheels_mps / 0.098,)
        self.rover.facts = [
            *([Joints(stamp_s, radps, radps)] if self.joints else []),
            *([Imu(stamp_s, 0.0, 0.0, 0.0, 0.0, 0.0, ahead_mps2, 0.0, 9.81)] if self.imu else []),
        ]
        super().step()


@pytest.fixture
def ice(tmp_path: Path) -> Iterator[IceBench]:
    with IceBench(tmp_path, all_sensors=True) as bench:
        bench.run(2.0)
        bench.submit(DriveFor(1.0, 0.0, 30.0), 1)
        bench.run(3.0)
        yield bench


def test_a_stop_on_ice_is_done_once_the_accelerometer_felt_the_speed_lost(ice: IceBench) -> None:
    ice.friction = 0.1
    ice.submit(Stop(), 2)
    ice.run(0.9)
    assert ice.true_mps > 0.05
    assert ice.stages(2)[-1] is Stage.STARTED
    assert "slides at 0.1" in ice.executive.why
    assert "by accelerometer, with its wheels at rest: stopped by MOE:2" in ice.executive.why
    ice.run(1.0)
    assert ice.stages(2)[-1] is Stage.EXECUTED
    assert ice.last(2).text.endswith("by odometry, joints, gyro and accelerometer")
    assert ice.true_mps == 0.0
    assert ice.executive.why.startswith("standing")


def test_while_it_slides_a_stop_reports_at_what_speed_and_then_fails(ice: IceBench) -> None:
    ice.friction = 0.015
    ice.submit(Stop(), 2)
    assert ice.finish(2) is Stage.FAILED
    reported = [each.text for each in ice.received.reports if each.stage is Stage.PROGRESS]
    assert "0.86 m/s by accelerometer" in reported[0]
    assert "0.42 m/s by accelerometer" in reported[3]
    last = ice.last(2)
    assert last.reason is Reason.SLIDE_AT_REST
    assert "Check that the rover is stationary before resume" in last.text
    figures = {figure.name: figure.value for figure in last.figures}
    assert figures["lost by the wheels"] == pytest.approx(1.0, abs=0.02)
    assert figures["felt by the accelerometer"] == pytest.approx(0.74, abs=0.03)
    assert ice.executive.mode is Mode.STOPPED


@pytest.mark.at_length
def test_the_end_of_a_motion_waits_for_the_accelerometer(ice: IceBench) -> None:
    ice.submit(Stop(), 2)
    ice.finish(2)
    ice.submit(Resume(), 3)
    ice.submit(DriveFor(0.3, 0.0, 2.0), 4)
    ice.run(1.5)
    ice.friction = 0.05
    while ice.rover.velocity != STANDING:
        ice.step()
    ice.run(0.15)
    assert ice.true_mps > 0.05
    assert ice.stages(4)[-1] is Stage.STARTED
    assert ice.finish(4) is Stage.EXECUTED
    assert ice.true_mps == 0.0


@pytest.mark.at_length
def test_a_motion_that_slides_on_is_not_executed(ice: IceBench) -> None:
    ice.friction = 0.01
    assert ice.finish(1) is Stage.FAILED
    assert ice.last(1).reason in {Reason.SLIDE_AT_REST, Reason.WHEEL_SLIP}


@pytest.mark.at_length
@pytest.mark.parametrize("source", ["joints", "gyro"])
def test_a_stop_waits_for_a_sensor_that_fell_silent(ice: IceBench, source: str) -> None:
    setattr(ice, "imu" if source == "gyro" else source, False)
    ice.run(1.0)
    ice.submit(Stop(), 2)
    ice.run(7.0)
    assert ice.stages(2)[-1] is Stage.PROGRESS
    assert f"by {source}, not received since standstill" in ice.last(2).text
    ice.run(1.5)
    assert ice.stages(2)[-1] is Stage.FAILED
    assert ice.last(2).reason is Reason.UNVERIFIED
    assert f"by {source}, not received since standstill" in ice.last(2).text
    ice.imu = ice.joints = True
    ice.submit(Stop(), 3)
    assert ice.finish(3) is Stage.EXECUTED


@pytest.mark.parametrize("gap_s", [4.0, 10.0])
def test_a_stop_waits_for_frames_after_a_gap(sliding: SlidingBench, gap_s: float) -> None:
    def frame() -> None:
        now_s = sliding.clock.now_s()
        sliding.executive.observe(SecondOdometry(now_s - 0.3, Pose(sliding.true_x_m)))
        sliding.run(0.5)

    for _ in range(4):
        frame()
    sliding.run(4.0)
    sliding.submit(Stop(), 1)
    sliding.run(gap_s)
    for _ in range(4):
        frame()
    last = sliding.last(1)
    assert last.stage is (Stage.EXECUTED if gap_s < 5.0 else Stage.FAILED)
    if last.stage is Stage.FAILED:
        assert last.reason is Reason.UNVERIFIED
        assert "by second odometry, not received since standstill" in last.text


def test_a_fault_that_just_showed_it_sliding_holds_the_stop_back(ice: IceBench) -> None:
    ice.submit(Stop(), 2)
    ice.finish(2)
    ice.submit(Resume(), 3)
    ice.friction = 0.005
    ice.submit(DriveFor(1.0, 0.0, 5.0), 4)
    assert ice.finish(4) is Stage.FAILED
    assert ice.last(4).reason is Reason.WHEEL_SLIP
    ice.friction = 2.0
    ice.submit(Stop(), 5)
    ice.run(1.1)
    assert ice.true_mps == 0.0
    assert "the wheels slip" in ice.last(5).text
    assert ice.finish(5, 1.5) is Stage.EXECUTED


def test_a_motion_with_wheels_stopped_before_the_rover_is_not_executed(ice: IceBench) -> None:
    ice.submit(Stop(), 2)
    ice.finish(2)
    ice.submit(Resume(), 3)
    ice.submit(DriveFor(1.0, 0.0, 3.0), 4)
    ice.run(2.5)
    ice.friction = 0.05
    assert ice.finish(4) is Stage.FAILED
    last = ice.last(4)
    assert last.reason is Reason.SLIDE_AT_REST
    assert "by its accelerometer, not measured by its wheels" in last.text
    assert {figure.name: figure.value for figure in last.figures}["slid"] > 0.1
    assert ice.true_mps == 0.0


def test_a_stop_waits_for_odometry_that_shows_standstill(tmp_path: Path) -> None:
    settings = load_settings("jackal")
    late = with_figures(settings.faults.odometry_stale, above=3.0)
    settings = replace(settings, faults=replace(settings.faults, odometry_stale=late))
    with Bench(tmp_path, settings) as bench:
        bench.run(1.0)
        bench.odometry = False
        bench.run(0.7)
        bench.submit(Stop(), 1)
        bench.run(0.5)
        bench.odometry = True
        assert bench.finish(1) is Stage.EXECUTED
