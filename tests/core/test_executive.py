from dataclasses import replace
from itertools import pairwise
from math import cos, hypot, nan, pi, sin
from pathlib import Path

import pytest
from py_trees.common import Status

from executive.admission import Admitted, Refused, Repeated
from executive.commands import (
    Command,
    DriveFor,
    FollowPath,
    Identity,
    MoveCameraAngles,
    MoveForward,
    MoveTo,
    Resume,
    RotateBy,
    RotateTo,
    SetCameraAngles,
    SetCameraRotateSpeed,
    SetPositionCompensation,
    SetStatusInterval,
    SetTravelSpeed,
    Stop,
    TakePicture,
    Waypoint,
)
from executive.context import Context
from executive.facts import Battery, ForeignPublishers, Odometry
from executive.geometry import STANDING, Pose, Velocity
from executive.ledger import LedgerError
from executive.modes import Mode
from executive.reasons import Reason
from executive.reports import Kind, Stage
from executive.runner import LeafError
from tests.support.kinematic import Bench
from trees.motion import Drive
from trees.rover import RoverTree

WHOLE_LIFE = [Stage.RECEIVED, Stage.ACCEPTED, Stage.STARTED, Stage.EXECUTED]


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path)


def reasons(bench: Bench, number: int) -> Reason | None:
    return bench.last(number).reason


@pytest.mark.parametrize(
    "target",
    [
        Waypoint(3.0, 2.0, pi / 2),
        Waypoint(-2.0, 0.0, 0.0),
        Waypoint(0.5, -0.5),
        Waypoint(0.0, 0.0, pi),
        Waypoint(0.0, 0.3, 0.0),
    ],
)
def test_move_to_ends_at_its_place_and_heading(bench: Bench, target: Waypoint) -> None:
    bench.submit(MoveTo(target), 1)
    assert bench.finish(1) is Stage.EXECUTED
    assert bench.stages(1) == WHOLE_LIFE
    pose = bench.rover.pose
    assert hypot(pose.x_m - target.x_m, pose.y_m - target.y_m) < 0.03
    if target.heading_rad is not None:
        assert abs(pose.heading_rad - target.heading_rad) % (2 * pi) == pytest.approx(0, abs=0.035)


@pytest.mark.parametrize("bearing_rad", [3.0, -3.0, 2.2, -1.9, 0.9])
def test_a_line_is_found_again_forward_and_backward(bench: Bench, bearing_rad: float) -> None:
    target = Waypoint(7.0 * cos(bearing_rad), 7.0 * sin(bearing_rad))
    bench.submit(MoveTo(target), 1)
    bench.run(3.0)
    pose = bench.rover.pose
    bench.rover.pose = replace(pose, x_m=pose.x_m - 0.08, y_m=pose.y_m + 0.08)
    assert bench.finish(1) is Stage.EXECUTED
    pose = bench.rover.pose
    assert hypot(pose.x_m - target.x_m, pose.y_m - target.y_m) < 0.02
    duration = bench.last(1).figures[0]
    assert duration.name == "duration"
    assert duration.value < 10.5


def test_a_missed_waypoint_is_tried_again(bench: Bench) -> None:
    bench.submit(MoveTo(Waypoint(3.0, 0.0)), 1)
    bench.run(3.2)
    bench.rover.pose = replace(bench.rover.pose, y_m=0.15)
    assert bench.finish(1) is Stage.EXECUTED
    assert hypot(bench.rover.pose.x_m - 3.0, bench.rover.pose.y_m) < 0.05


def test_no_straight_drive_ends_with_success_away_from_its_target(bench: Bench) -> None:
    bench.submit(MoveForward(3.0), 1)
    bench.run(3.2)
    bench.rover.pose = replace(bench.rover.pose, y_m=0.15)
    assert bench.finish(1) is Stage.FAILED
    assert reasons(bench, 1) is Reason.OFF_TARGET


def test_move_forward_and_backward_keep_the_heading(bench: Bench) -> None:
    bench.submit(MoveForward(2.0), 1)
    bench.finish(1)
    assert bench.rover.pose.x_m == pytest.approx(2.0, abs=0.03)
    bench.submit(MoveForward(-0.5), 2)
    bench.finish(2)
    assert bench.rover.pose.x_m == pytest.approx(1.5, abs=0.06)
    assert bench.rover.pose.heading_rad == pytest.approx(0.0, abs=0.02)


def test_rotations_are_absolute_and_relative(bench: Bench) -> None:
    bench.submit(RotateTo(-pi / 2), 1)
    bench.submit(RotateBy(pi), 2)
    assert bench.finish(2) is Stage.EXECUTED
    assert bench.rover.pose.heading_rad == pytest.approx(pi / 2, abs=0.07)


def test_a_path_reports_each_waypoint(bench: Bench) -> None:
    bench.submit(FollowPath((Waypoint(1.0, 0.0), Waypoint(1.0, 1.0), Waypoint(0.0, 1.0, 0.0))), 1)
    assert bench.finish(1) is Stage.EXECUTED
    steps = [(r.step, r.step_count) for r in bench.heard.reports if r.stage is Stage.PROGRESS]
    assert steps == [(1, 3), (2, 3)]


def test_drive_holds_its_velocity_for_its_time(bench: Bench) -> None:
    bench.submit(DriveFor(0.5, 0.2, 4.0), 1)
    bench.run(2.0)
    assert bench.executive.mode is Mode.TELEOP
    assert bench.rover.velocity == Velocity(0.5, 0.2)
    assert bench.finish(1) is Stage.EXECUTED
    assert bench.rover.velocity == STANDING
    assert bench.rover.pose.heading_rad == pytest.approx(0.8, abs=0.05)


def test_speed_and_acceleration_stay_within_bounds(bench: Bench) -> None:
    bench.submit(SetTravelSpeed(0.4), 1)
    bench.submit(MoveTo(Waypoint(2.0, 1.0, 1.0)), 2)
    bench.finish(2)
    sent = bench.rover.sent
    assert max(abs(v.travel_mps) for v in sent) == pytest.approx(0.4)
    for before, after in pairwise(sent):
        assert abs(after.travel_mps - before.travel_mps) <= 1.0 * 0.05 + 1e-9
        assert abs(after.rotate_radps - before.rotate_radps) <= 3.0 * 0.05 + 1e-9


def test_a_stop_sends_zero_before_anything_else_and_ends_all(bench: Bench) -> None:
    bench.submit(MoveForward(5.0), 1)
    bench.submit(MoveForward(1.0), 2)
    bench.submit(SetCameraAngles(2.0, 0.0), 3)
    bench.run(2.0)
    assert bench.rover.velocity.travel_mps > 0.9
    assert bench.submit(Stop(), 9) == Admitted()
    assert bench.rover.velocity == STANDING
    assert bench.executive.mode is Mode.STOPPED
    assert bench.finish(9) is Stage.EXECUTED
    assert bench.stages(1)[-1] is bench.stages(2)[-1] is Stage.CANCELLED
    assert reasons(bench, 1) is Reason.STOPPED
    assert "MOE:9" in bench.last(1).text


def test_nothing_moves_while_stopped_until_resumed(bench: Bench) -> None:
    bench.submit(Stop(), 1)
    bench.finish(1)
    refused = bench.submit(MoveForward(1.0), 2)
    assert isinstance(refused, Refused)
    assert refused.refusal.reason is Reason.WRONG_MODE
    assert bench.stages(2) == [Stage.RECEIVED, Stage.REJECTED]
    bench.run(1.0)
    assert set(bench.rover.sent) == {STANDING}
    assert "MOE:1" in bench.executive.why
    bench.submit(Resume(), 3)
    assert bench.stages(3) == WHOLE_LIFE
    bench.submit(MoveForward(1.0), 4)
    assert bench.finish(4) is Stage.EXECUTED


def test_the_camera_works_while_stopped(bench: Bench) -> None:
    bench.submit(Stop(), 1)
    bench.finish(1)
    bench.submit(SetCameraAngles(0.5, None), 2)
    assert bench.finish(2) is Stage.EXECUTED
    assert bench.rover.velocity == STANDING


def test_motion_is_appended_by_default_and_replaces_on_request(bench: Bench) -> None:
    bench.submit(MoveForward(5.0), 1)
    bench.run(2.0)
    bench.submit(MoveForward(5.0), 2)
    bench.run(0.5)
    assert bench.stages(2) == [Stage.RECEIVED, Stage.ACCEPTED]
    bench.replace(RotateTo(pi / 2), 3)
    assert bench.stages(1)[-1] is bench.stages(2)[-1] is Stage.CANCELLED
    assert reasons(bench, 1) is Reason.REPLACED
    assert bench.finish(3) is Stage.EXECUTED
    assert bench.rover.pose.heading_rad == pytest.approx(pi / 2, abs=0.04)
    assert bench.rover.pose.x_m < 3.5


def test_a_replacing_velocity_takes_over_without_standing(bench: Bench) -> None:
    bench.submit(DriveFor(0.5, 0.0, 10.0), 1)
    bench.run(2.0)
    bench.replace(DriveFor(0.8, 0.0, 10.0), 2)
    bench.run(1.0)
    assert bench.rover.velocity.travel_mps == pytest.approx(0.8)
    assert min(v.travel_mps for v in bench.rover.sent[-20:]) > 0.3


def test_a_repeat_is_answered_with_the_last_report_and_not_executed(bench: Bench) -> None:
    bench.submit(MoveForward(1.0), 1)
    bench.finish(1)
    place = bench.rover.pose
    last = bench.last(1)
    answer = bench.submit(MoveForward(1.0), 1)
    assert answer == Repeated(last)
    assert bench.heard.reports[-1] == last
    bench.run(3.0)
    assert bench.rover.pose == place


def test_a_number_used_for_something_else_is_refused(bench: Bench) -> None:
    bench.submit(MoveForward(1.0), 1)
    answer = bench.submit(MoveForward(2.0), 1)
    assert isinstance(answer, Refused)
    assert answer.refusal.reason is Reason.DUPLICATE
    assert bench.finish(1) is Stage.EXECUTED


def test_a_stop_stops_even_under_a_used_number(bench: Bench) -> None:
    bench.submit(MoveForward(5.0), 1)
    bench.run(1.0)
    answer = bench.submit(Stop(), 1)
    assert isinstance(answer, Refused)
    assert bench.rover.velocity == STANDING
    assert bench.executive.mode is Mode.STOPPED


def test_a_repeated_stop_does_not_stop_what_was_resumed(bench: Bench) -> None:
    bench.submit(Stop(), 1)
    bench.finish(1)
    bench.submit(Resume(), 2)
    bench.submit(MoveForward(3.0), 3)
    bench.run(1.0)
    assert isinstance(bench.submit(Stop(), 1), Repeated)
    assert bench.executive.mode is Mode.MOVING
    assert bench.finish(3) is Stage.EXECUTED


def test_a_command_expires_in_the_queue(bench: Bench) -> None:
    bench.submit(MoveForward(5.0), 1)
    bench.submit(MoveForward(1.0), 2, lifetime_s=2.0)
    bench.finish(1)
    assert bench.finish(2) is Stage.EXPIRED
    assert bench.stages(2) == [Stage.RECEIVED, Stage.ACCEPTED, Stage.EXPIRED]
    assert reasons(bench, 2) is Reason.EXPIRED


def test_kill_9_ends_what_was_under_way_and_never_runs_it_again(bench: Bench) -> None:
    bench.submit(MoveForward(5.0), 1)
    bench.submit(MoveForward(1.0), 2)
    bench.run(2.0)
    bench.crash()
    assert bench.rover.velocity == STANDING
    assert bench.stages(1)[-1] is Stage.FAILED
    assert reasons(bench, 1) is Reason.INTERRUPTED
    assert bench.stages(2)[-1] is Stage.CANCELLED
    place = bench.rover.pose
    assert isinstance(bench.submit(MoveForward(5.0), 1), Repeated)
    bench.run(3.0)
    assert bench.rover.pose == place
    sequences = [report.sequence for report in bench.heard.reports[:-1]]
    assert sequences == list(range(1, len(sequences) + 1))


def test_lost_odometry_stops_the_rover_within_its_bound(bench: Bench) -> None:
    bench.submit(MoveForward(5.0), 1)
    bench.run(2.0)
    bench.odometry = False
    bench.run(0.35)
    assert bench.rover.velocity == STANDING
    assert bench.executive.mode is Mode.SAFE
    assert bench.stages(1)[-1] is Stage.FAILED
    assert reasons(bench, 1) is Reason.ODOMETRY_STALE
    still = bench.submit(Resume(), 2)
    assert isinstance(still, Refused)
    assert still.refusal.reason is Reason.CAUSE_PERSISTS
    bench.odometry = True
    bench.run(0.1)
    bench.submit(Resume(), 3)
    assert bench.executive.context.latches.hazard is None


def test_a_jump_of_the_odometry_is_not_followed(bench: Bench) -> None:
    bench.submit(MoveForward(5.0), 1)
    bench.run(2.0)
    bench.rover.pose = replace(bench.rover.pose, y_m=bench.rover.pose.y_m + 0.5)
    bench.step()
    assert bench.rover.velocity == STANDING
    assert reasons(bench, 1) is Reason.ODOMETRY_JUMPED
    bench.submit(Resume(), 2)
    assert bench.executive.mode is Mode.IDLE


def test_odometry_that_is_not_finite_counts_as_lost(bench: Bench) -> None:
    bench.submit(MoveForward(5.0), 1)
    bench.run(1.0)
    bench.odometry = False
    for _ in range(8):
        bench.step()
        bench.executive.observe(Odometry(0.0, Pose(nan, 0.0), STANDING))
    assert reasons(bench, 1) is Reason.ODOMETRY_STALE


def test_leaning_and_a_low_battery_make_the_rover_safe(bench: Bench) -> None:
    bench.submit(MoveForward(5.0), 1)
    bench.run(1.0)
    bench.rover.pose = replace(bench.rover.pose, roll_rad=0.6)
    bench.executive.observe(Odometry(0.0, bench.rover.pose, bench.rover.velocity))
    bench.executive.tick()
    assert reasons(bench, 1) is Reason.TILTED
    bench.rover.pose = replace(bench.rover.pose, roll_rad=0.0)
    bench.run(0.1)
    bench.submit(Resume(), 2)
    bench.executive.observe(Battery(20.0))
    bench.executive.tick()
    assert bench.executive.mode is Mode.SAFE
    assert bench.heard.reports[-1].reason is Reason.BATTERY_LOW


class Exploding(RoverTree):
    """A rover tree whose drive leaf raises when told to."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self.armed = False
        (drive,) = [node for node in self.root.iterate() if isinstance(node, Drive)]
        act = drive.act

        def explode() -> Status:
            if self.armed:
                raise ZeroDivisionError("boom")
            return act()

        vars(drive)["act"] = explode


def test_a_leaf_that_raises_is_contained(tmp_path: Path) -> None:
    bench = Bench(tmp_path, build_tree=Exploding)
    tree = bench.executive.tree
    assert isinstance(tree, Exploding)
    bench.submit(MoveForward(5.0), 1)
    bench.run(1.0)
    tree.armed = True
    bench.step()
    assert bench.rover.velocity == STANDING
    assert bench.stages(1)[-1] is Stage.FAILED
    assert reasons(bench, 1) is Reason.LEAF_RAISED
    assert "rover/work/motion and camera/motion/go/leg/drive" in bench.last(1).text
    assert "boom" in bench.last(1).text
    tree.armed = False
    bench.submit(MoveForward(1.0), 2)
    assert bench.finish(2) is Stage.EXECUTED


def test_a_leaf_error_names_its_path(tmp_path: Path) -> None:
    bench = Bench(tmp_path, build_tree=Exploding)
    tree = bench.executive.tree
    assert isinstance(tree, Exploding)
    tree.armed = True
    bench.executive.dispatcher.submit(Command(Identity("MOE", 1), MoveForward(1.0), "direct"))
    with pytest.raises(LeafError, match="go/leg/drive"):
        tree.tick()


def test_a_ledger_that_cannot_be_written_stops_everything_but_a_stop(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.submit(MoveForward(5.0), 1)
    bench.run(1.0)

    def full() -> None:
        raise LedgerError("disk full")

    with monkeypatch.context() as broken:
        broken.setattr(bench.executive.ledger, "commit", full)
        answer = bench.submit(MoveForward(1.0), 2)
        assert isinstance(answer, Refused)
        assert answer.refusal.reason is Reason.LEDGER_FAILED
        assert bench.rover.velocity == STANDING
        assert bench.executive.mode is Mode.SAFE
        place = bench.rover.pose
        bench.submit(Stop(), 3)
        bench.run(1.0)
        assert bench.rover.pose == place
    bench.run(0.1)
    assert bench.stages(1)[-1] is Stage.FAILED
    assert bench.stages(2)[-1].terminal
    sequences = [report.sequence for report in bench.heard.reports]
    assert sequences == list(range(1, len(sequences) + 1))


def test_a_stuck_rover_fails_by_its_deadline(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    bench.submit(MoveForward(1.0), 1)
    monkeypatch.setattr(bench.rover, "advance", lambda _: None)
    assert bench.finish(1, limit_s=20.0) is Stage.FAILED
    assert reasons(bench, 1) is Reason.DRIVE_DEADLINE
    bench.run(2.0)
    assert bench.rover.velocity == STANDING


def test_camera_angles_absolute_relative_and_bounded(bench: Bench) -> None:
    bench.submit(SetCameraAngles(1.0, 0.5), 1)
    bench.submit(MoveCameraAngles(-0.4, 0.0), 2)
    bench.submit(MoveCameraAngles(5.0, 0.0), 3)
    bench.finish(2)
    assert bench.rover.angles.pan_rad == pytest.approx(0.6)
    assert bench.finish(3) is Stage.EXECUTED
    assert bench.rover.angles.pan_rad == pytest.approx(2.8)


def test_a_picture_is_stored_whole_under_its_command(bench: Bench) -> None:
    bench.submit(TakePicture(), 7)
    assert bench.finish(7) is Stage.EXECUTED
    (stored,) = (bench.folder / "pictures").iterdir()
    assert stored.name == "MOE-7.jpg"
    assert stored.read_bytes() == b"\xff\xd8picture"
    assert stored.name in bench.last(7).text


def test_a_dead_camera_fails_by_its_deadline_and_the_drive_goes_on(bench: Bench) -> None:
    bench.rover.camera_works = False
    bench.submit(TakePicture(), 1)
    bench.submit(MoveForward(8.0), 2)
    assert bench.finish(1) is Stage.FAILED
    assert reasons(bench, 1) is Reason.CAPTURE_DEADLINE
    assert bench.finish(2) is Stage.EXECUTED


def test_motion_and_camera_work_side_by_side(bench: Bench) -> None:
    bench.submit(MoveForward(3.0), 1)
    bench.submit(SetCameraAngles(1.0, 0.0), 2)
    bench.submit(TakePicture(), 3)
    bench.run(0.5)
    assert bench.stages(3) == WHOLE_LIFE
    assert bench.stages(1)[-1] is Stage.STARTED


def test_settings_are_commands_with_a_whole_life(bench: Bench) -> None:
    bench.submit(SetCameraRotateSpeed(0.3), 1)
    bench.submit(SetPositionCompensation(1.0, 0.0, 0.0, pi / 2), 2)
    assert bench.stages(1) == bench.stages(2) == WHOLE_LIFE
    assert bench.rover.camera_speed_radps == 0.3
    pose = bench.executive.status.pose
    assert (pose.x_m, pose.heading_rad) == pytest.approx((1.0, pi / 2))


def test_telemetry_comes_at_its_interval_or_on_change(bench: Bench) -> None:
    bench.heard.values.clear()
    bench.run(5.0)
    assert len(bench.heard.values) == 5
    assert {len(values) for values in bench.heard.values} == {12}
    bench.submit(SetStatusInterval(0.0), 1)
    bench.run(0.5)
    bench.heard.values.clear()
    bench.run(5.0)
    assert bench.heard.values == []
    bench.submit(SetTravelSpeed(0.5), 2)
    bench.run(0.1)
    ((changed,),) = bench.heard.values
    assert (changed.parameter.value, changed.value) == ("TRAVEL_SPEED", 0.5)


def test_started_and_progress_are_reported_only_on_request(bench: Bench) -> None:
    bench.submit(
        FollowPath((Waypoint(0.5, 0.0), Waypoint(1.0, 0.0))),
        1,
        report_started=False,
        report_progress=False,
    )
    bench.finish(1)
    assert bench.stages(1) == [Stage.RECEIVED, Stage.ACCEPTED, Stage.EXECUTED]


def test_the_executive_keeps_silent_when_idle_so_that_a_joystick_may_drive(bench: Bench) -> None:
    bench.submit(MoveForward(0.5), 1)
    bench.finish(1)
    bench.run(1.0)
    sent = len(bench.rover.sent)
    bench.run(5.0)
    assert len(bench.rover.sent) == sent
    bench.submit(Stop(), 2)
    bench.run(1.0)
    assert len(bench.rover.sent) > sent + 15


def test_other_publishers_are_noticed_once(bench: Bench) -> None:
    for _ in range(3):
        bench.executive.observe(ForeignPublishers(("/joystick",)))
        bench.step()
    events = [report.text for report in bench.heard.reports if report.kind is Kind.EVENT]
    assert events == ["others may move the rover: /joystick"]
    assert "/joystick" in bench.executive.why


def test_closing_stands_and_leaves_no_command_open(bench: Bench) -> None:
    bench.submit(MoveForward(5.0), 1)
    bench.run(1.0)
    bench.executive.close()
    assert bench.rover.velocity == STANDING
    assert bench.stages(1)[-1] is Stage.CANCELLED
