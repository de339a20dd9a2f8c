"""What a stop, the end of a motion and `why` say of whether the rover moves."""

from dataclasses import replace
from pathlib import Path

import pytest

from executive.commands import DriveFor, Mode, MoveForward, MoveTo, Stop, Waypoint
from executive.geometry import STANDING, Pose, Velocity
from executive.reasons import Reason
from executive.reports import Identity, Stage
from executive.state import ForeignPublishers, Imu, Joints, Odometry, SecondOdometry
from tests.support.kinematic import STEP_S, Bench, KinematicRover, ignoring


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
    told = [r for r in sliding.heard.reports if r.stage is Stage.PROGRESS]
    assert [report.step for report in told] == [1, 2, 3, 4]
    assert "0.40 m/s, 0.00 rad/s by odometry" in told[0].text
    last = sliding.last(1)
    assert last.reason is Reason.STOP_DEADLINE
    assert "0.40 m/s" in last.text
    assert {f.name: round(f.value, 2) for f in last.figures}["odometry"] == 0.4


def test_a_stop_is_done_once_the_pose_has_stood_for_a_while(sliding: SlidingBench) -> None:
    sliding.slide_mps = 0.4
    sliding.submit(Stop(), 1)
    sliding.run(1.5)
    sliding.slide_mps = 0.0
    sliding.run(0.1)
    assert sliding.stages(1)[-1] is Stage.PROGRESS
    assert sliding.finish(1, 0.3) is Stage.EXECUTED
    assert sliding.last(1).text.endswith("by odometry alone")


def test_a_stop_waits_for_frames_of_a_second_odometry_that_stand(sliding: SlidingBench) -> None:
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
            assert "m/s, 0.00 rad/s by second odometry" in sliding.last(1).text
    assert sliding.stages(1)[-1] is Stage.EXECUTED
    assert "by odometry and second odometry" in sliding.last(1).text


@pytest.mark.parametrize("source", ["joints", "gyro"])
def test_a_stop_is_not_done_while_wheels_or_gyro_turn(bench: Bench, source: str) -> None:
    def tell(turning: bool) -> None:
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
        tell(turning=True)
    assert bench.stages(1)[-1] is Stage.PROGRESS
    assert f"rad/s by {source}" in bench.last(1).text
    for _ in range(5):
        tell(turning=False)
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


def test_the_end_of_a_motion_says_where_the_rover_is_and_by_what(bench: Bench) -> None:
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


def test_why_tells_the_measured_velocity_not_the_commanded(tmp_path: Path) -> None:
    blind = ignoring("odometry_frozen", "off_command", "no_progress", "odometry_off_twist")
    with Bench(tmp_path, blind, rover=BlockedRover()) as bench:
        bench.drive_on()
        assert bench.executive.velocity.travel_mps > 0.5
        assert bench.executive.why == "stands for a moment within MOE:1 moveForward"


def test_why_tells_of_motion_that_nobody_here_commands(bench: Bench) -> None:
    bench.executive.observe(ForeignPublishers(("/joystick",)))
    bench.run(1.0)
    bench.rover.velocity = Velocity(0.0, 0.7)  # another node spins it
    bench.run(0.5)
    moves = "moves at +0.00 m/s, +0.70 rad/s, but should stand: "
    assert bench.executive.why.startswith(moves + "no motion goal")
    bench.submit(Stop(), 1)
    bench.rover.velocity = Velocity(0.0, 0.7)
    bench.step()
    assert bench.executive.why.startswith(moves + "stopped by MOE:1")
    bench.finish(1)
    assert Identity("MOE", 1) == bench.last(1).identity
    bench.drive_on()
    assert bench.executive.why.startswith(
        "stands: STOPPED because the rover should stand, and turns"
    )


def test_a_publisher_that_sends_nothing_does_not_excuse_motion(bench: Bench) -> None:
    bench.executive.observe(ForeignPublishers(("/joystick",)))
    bench.run(3.0)
    bench.rover.velocity = Velocity(0.3, 0.0)  # it slides, or somebody drives it unheard
    bench.run(2.0)
    assert bench.executive.mode is Mode.STOPPED
    assert "(publishers of velocities: /joystick)" in bench.executive.why


def test_why_says_at_what_speed_a_command_moves_the_rover(bench: Bench) -> None:
    bench.submit(MoveForward(5.0), 1)
    bench.run(0.9)
    assert bench.executive.why.startswith("moves at +0.")
    assert bench.executive.why.endswith("for MOE:1 moveForward")
