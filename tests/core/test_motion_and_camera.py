"""How the rover moves and where its camera looks, as commands say."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from math import cos, hypot, pi, radians, sin
from pathlib import Path

import pytest

from executive.commands import (
    Command,
    DriveFor,
    FollowPath,
    Mode,
    MoveCameraAngles,
    MoveForward,
    MoveTo,
    Request,
    RotateBy,
    RotateTo,
    SetCameraAngles,
    SetCameraRotateSpeed,
    SetRotateSpeed,
    SetTravelSpeed,
    Stop,
    TakePicture,
    Waypoint,
)
from executive.motion.velocity_control import VelocityDriver
from executive.settings import SpeedProfileKind, load_settings
from executive.values.facts import Battery, CameraAngles
from executive.values.geometry import STANDING, Velocity
from executive.values.reasons import Reason
from executive.values.reports import Identity, Stage
from tests.support.kinematic import ALL_STAGES, PICTURE, STEP_S, Bench, ignoring

pytestmark = pytest.mark.alike


@pytest.mark.at_length
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
def test_move_to_ends_at_its_position_and_heading(bench: Bench, target: Waypoint) -> None:
    bench.execute(MoveTo(target), 1)
    assert bench.stages(1) == ALL_STAGES
    pose = bench.rover.pose
    assert hypot(pose.x_m - target.x_m, pose.y_m - target.y_m) < 0.03
    if target.heading_rad is not None:
        assert abs(pose.heading_rad - target.heading_rad) % (2 * pi) == pytest.approx(0, abs=0.035)


@pytest.mark.at_length
@pytest.mark.parametrize(("x_m", "y_m"), [(0.014, 0.0), (0.0, 0.014), (-0.01, -0.01), (0.5, 0.5)])
def test_a_finer_tolerance_is_respected(bench: Bench, x_m: float, y_m: float) -> None:
    bench.execute(MoveTo(Waypoint(x_m, y_m, tolerance_m=0.01)), 1)
    assert hypot(bench.rover.pose.x_m - x_m, bench.rover.pose.y_m - y_m) <= 0.01


@pytest.fixture
def shoved(tmp_path: Path) -> Iterator[Bench]:
    """Give a bench whose rover may be shoved aside without its velocity showing it."""
    with Bench(tmp_path, ignoring("odometry_off_twist")) as bench:
        yield bench


@pytest.mark.at_length
@pytest.mark.parametrize("bearing_rad", [3.0, -3.0, 2.2, -1.9, 0.9])
def test_a_line_is_found_again_forward_and_backward(shoved: Bench, bearing_rad: float) -> None:
    bench = shoved
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


def test_a_missed_waypoint_is_tried_again(shoved: Bench) -> None:
    bench = shoved
    bench.submit(MoveTo(Waypoint(3.0, 0.0)), 1)
    bench.run(3.2)
    bench.rover.pose = replace(bench.rover.pose, y_m=0.15)
    assert bench.finish(1) is Stage.EXECUTED
    assert hypot(bench.rover.pose.x_m - 3.0, bench.rover.pose.y_m) < 0.05


def test_no_straight_drive_ends_with_success_away_from_its_target(shoved: Bench) -> None:
    bench = shoved
    bench.submit(MoveForward(3.0), 1)
    bench.run(3.2)
    bench.rover.pose = replace(bench.rover.pose, y_m=0.15)
    assert bench.finish(1) is Stage.FAILED
    assert bench.last(1).reason is Reason.OFF_TARGET


def test_move_forward_and_backward_maintain_the_heading(bench: Bench) -> None:
    bench.execute(MoveForward(2.0), 1)
    assert bench.rover.pose.x_m == pytest.approx(2.0, abs=0.03)
    bench.execute(MoveForward(-0.5), 2)
    assert bench.rover.pose.x_m == pytest.approx(1.5, abs=0.06)
    assert bench.rover.pose.heading_rad == pytest.approx(0.0, abs=0.02)


def test_rotations_are_absolute_and_relative(bench: Bench) -> None:
    bench.submit(RotateTo(-pi / 2), 1)
    bench.execute(RotateBy(pi), 2)
    assert bench.rover.pose.heading_rad == pytest.approx(pi / 2, abs=0.07)


@pytest.mark.at_length
@pytest.mark.parametrize("degrees", [180, -180, 270, -270, 360, -360])
def test_a_relative_turn_covers_its_whole_angle_to_its_side(bench: Bench, degrees: int) -> None:
    bench.execute(RotateBy(radians(degrees)), 1)
    turned_rad = sum(velocity.rotate_radps * STEP_S for velocity in bench.rover.sent)
    assert turned_rad == pytest.approx(radians(degrees), abs=0.04)


@pytest.mark.parametrize("small", [0.012, 0.02, -0.029])
def test_moves_smaller_than_the_tolerance_are_made(bench: Bench, small: float) -> None:
    bench.execute(MoveForward(small), 1)
    assert bench.rover.pose.x_m == pytest.approx(small, abs=0.006)
    bench.execute(RotateBy(small), 2)
    assert bench.rover.pose.heading_rad == pytest.approx(small, abs=0.01)


def test_half_a_turn_remains_on_its_side_though_the_heading_wavers(bench: Bench) -> None:
    bench.submit(RotateTo(pi), 1)
    bench.rover.pose = replace(bench.rover.pose, heading_rad=-0.01)
    bench.run(0.1)
    assert bench.rover.velocity.rotate_radps > 0.0
    assert bench.finish(1) is Stage.EXECUTED


@pytest.mark.at_length
@pytest.mark.parametrize(
    ("request_", "slower"),
    [(MoveTo(Waypoint(3.0, 0.0)), SetTravelSpeed(0.1)), (RotateTo(3.0), SetRotateSpeed(0.1))],
)
def test_a_motion_may_be_slowed_down(bench: Bench, request_: Request, slower: Request) -> None:
    bench.submit(request_, 1)
    bench.run(1.0)
    bench.submit(slower, 2)
    assert bench.finish(1) is Stage.EXECUTED


@pytest.mark.at_length
@pytest.mark.parametrize("request_", [MoveForward(5.0), RotateTo(3.0)])
def test_a_short_gap_in_the_odometry_is_no_jump(bench: Bench, request_: Request) -> None:
    bench.submit(request_, 1)
    bench.run(1.2)
    bench.odometry = False
    bench.run(0.15)
    bench.odometry = True
    assert bench.finish(1) is Stage.EXECUTED


def test_no_profile_turns_round_when_slowed_down(tmp_path: Path) -> None:
    settings = load_settings("jackal")
    law = replace(settings.turn_drive, profile=SpeedProfileKind.TRAPEZOID)
    with Bench(tmp_path, replace(settings, turn_drive=law)) as bench:
        bench.submit(MoveForward(3.0), 1)
        bench.run(1.5)
        bench.submit(SetTravelSpeed(0.3), 2)
        bench.run(3.0)
        assert min(velocity.travel_mps for velocity in bench.rover.sent) >= 0.0
        assert bench.finish(1) is Stage.EXECUTED


@pytest.mark.at_length
def test_a_path_reports_each_waypoint(bench: Bench) -> None:
    bench.execute(FollowPath((Waypoint(1.0, 0.0), Waypoint(1.0, 1.0), Waypoint(0.0, 1.0, 0.0))), 1)
    steps = [(r.step, r.step_count) for r in bench.received.reports if r.stage is Stage.PROGRESS]
    assert steps == [(1, 3), (2, 3)]


def test_drive_holds_its_velocity_for_its_time(bench: Bench) -> None:
    bench.submit(DriveFor(0.5, 0.2, 4.0), 1)
    bench.run(2.0)
    assert bench.executive.mode is Mode.TELEOP
    assert bench.rover.velocity.travel_mps == 0.5
    assert bench.rover.velocity.rotate_radps == pytest.approx(0.2, abs=0.01)
    assert bench.finish(1) is Stage.EXECUTED
    assert bench.rover.velocity == STANDING
    assert bench.rover.pose.heading_rad == pytest.approx(0.8, abs=0.05)


@pytest.mark.at_length
def test_speed_and_acceleration_stay_within_bounds(bench: Bench) -> None:
    bench.submit(SetTravelSpeed(0.4), 1)
    bench.execute(MoveTo(Waypoint(2.0, 1.0, 1.0)), 2)
    sent = bench.rover.sent
    assert max(abs(v.travel_mps) for v in sent) == pytest.approx(0.4)
    for before, after in pairwise(sent):
        assert abs(after.travel_mps - before.travel_mps) <= 1.0 * 0.05 + 1e-9
        assert abs(after.rotate_radps - before.rotate_radps) <= 3.0 * 0.05 + 1e-9


def test_a_motion_that_is_commanded_between_ticks_begins_at_once(bench: Bench) -> None:
    bench.step()
    bench.submit(MoveForward(2.0), 1)
    bench.executive.serve_inbox()
    assert bench.rover.sent[-1] == Velocity(1.0 * 0.05, 0.0)
    bench.executive.serve_inbox()
    assert bench.rover.sent[-1] == Velocity(1.0 * 0.05, 0.0)
    bench.step()
    assert bench.rover.sent[-1].travel_mps == pytest.approx(2 * 1.0 * 0.05)


def test_a_motion_that_ends_between_ticks_ends_at_once(bench: Bench) -> None:
    settings, now_s = bench.settings, bench.clock.now_s()
    mover = VelocityDriver(bench.clock, settings, bench.executive.status, bench.rover)
    bench.step()
    mover.commit(Velocity(0.1, 0.1), now_s, settings.tick_s)
    assert mover.velocity == Velocity(1.0 * 0.05, 0.1)
    mover.commit(STANDING, now_s + 0.01, 0.01)
    assert bench.rover.sent[-1] == STANDING
    for _ in range(2):
        mover.commit(Velocity(0.1, 0.1), now_s, settings.tick_s)
    mover.commit(STANDING, now_s + 0.01, 0.01)
    assert bench.rover.sent[-1] == Velocity(0.1 - 1.0 * 0.01, 0.1 - 3.0 * 0.01)


def test_motion_is_appended_by_default_and_replaces_on_request(bench: Bench) -> None:
    bench.drive_on(2.0)
    bench.submit(MoveForward(5.0), 2)
    bench.run(0.5)
    assert bench.stages(2) == [Stage.RECEIVED, Stage.ACCEPTED]
    bench.replace(RotateTo(pi / 2), 3)
    assert bench.stages(1)[-1] is bench.stages(2)[-1] is Stage.CANCELLED
    assert bench.last(1).reason is Reason.REPLACED
    assert bench.finish(3) is Stage.EXECUTED
    assert bench.rover.pose.heading_rad == pytest.approx(pi / 2, abs=0.04)
    assert bench.rover.pose.x_m < 3.5


def test_a_replacing_velocity_acts_without_standstill(bench: Bench) -> None:
    bench.submit(DriveFor(0.5, 0.0, 10.0), 1)
    bench.run(2.0)
    bench.replace(DriveFor(0.8, 0.0, 10.0), 2)
    bench.run(1.0)
    assert bench.rover.velocity.travel_mps == pytest.approx(0.8)
    assert min(v.travel_mps for v in bench.rover.sent[-20:]) > 0.3


@pytest.mark.parametrize("wanted", [(0.5, 0.0), (0.0, 1.0), (0.5, 0.4), (-0.3, 0.6)])
def test_a_repeated_velocity_is_held_and_ended_by_zero(
    bench: Bench, wanted: tuple[float, float]
) -> None:
    velocity = Velocity(*wanted)
    for number in range(1, 13):
        bench.replace(DriveFor(*wanted, 0.8), number)
        bench.run(0.25)
        if number > 4:
            assert bench.rover.velocity.travel_mps == pytest.approx(velocity.travel_mps, abs=0.02)
            assert bench.rover.velocity.rotate_radps == pytest.approx(wanted[1], abs=0.1)
    first = len(bench.rover.sent)
    bench.replace(DriveFor(0.0, 0.0, 0.0), 13)
    assert bench.finish(13) is Stage.EXECUTED, bench.last(13).text
    ended = bench.rover.sent[first:]
    assert min(each.travel_mps * velocity.travel_mps for each in ended) >= 0.0
    assert min(each.rotate_radps * velocity.rotate_radps for each in ended) >= -1e-9
    assert not bench.executive.status.uncertainty
    assert bench.executive.mode is Mode.IDLE


def test_a_velocity_without_repetition_ends_by_itself(bench: Bench) -> None:
    for number in (1, 2, 3):
        bench.replace(DriveFor(0.5, 0.3, 0.8), number)
        bench.run(0.25)
    assert bench.finish(3) is Stage.EXECUTED, bench.last(3).text
    assert bench.rover.velocity == STANDING


def test_the_camera_works_while_stopped(bench: Bench) -> None:
    bench.execute(Stop(), 1)
    bench.execute(SetCameraAngles(0.5, None), 2)
    assert bench.rover.velocity == STANDING


def test_camera_angles_absolute_relative_and_bounded(bench: Bench) -> None:
    bench.submit(SetCameraAngles(1.0, 0.5), 1)
    bench.submit(MoveCameraAngles(-0.4, 0.0), 2)
    bench.submit(MoveCameraAngles(5.0, 0.0), 3)
    bench.finish(2)
    assert bench.rover.angles.pan_rad == pytest.approx(0.6)
    assert bench.finish(3) is Stage.EXECUTED
    assert bench.rover.angles.pan_rad == pytest.approx(2.8)


def test_a_relative_angle_is_added_once_despite_a_hazard_in_between(bench: Bench) -> None:
    bench.drive_on(2.0)
    bench.rover.lazy_camera = True
    bench.submit(MoveCameraAngles(1.0, 0.0), 2)
    bench.run(0.5)
    bench.executive.observe(Battery(10.0))
    bench.executive.tick()
    assert bench.stages(1)[-1] is Stage.FAILED
    assert bench.finish(2) is Stage.EXECUTED
    assert bench.rover.angles.pan_rad == pytest.approx(1.0, abs=0.03)


def test_a_stop_holds_the_camera_where_it_is(bench: Bench) -> None:
    bench.rover.lazy_camera = True
    bench.submit(SetCameraAngles(2.0, 0.1), 1)
    bench.run(0.5)
    bench.submit(Stop(), 2)
    here_rad = bench.rover.angles.pan_rad
    assert 0.3 < here_rad < 0.7
    bench.run(3.0)
    assert bench.stages(1)[-1] is Stage.CANCELLED
    assert bench.rover.angles.pan_rad == pytest.approx(here_rad, abs=0.06)
    bench.execute(MoveCameraAngles(0.2, 0.0), 3)
    assert bench.rover.angles.pan_rad == pytest.approx(here_rad + 0.2, abs=0.08)


def test_a_stop_leaves_a_camera_at_rest(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    bench.execute(SetCameraAngles(0.5, 0.1), 1)
    pointed: list[float] = []
    monkeypatch.setattr(bench.rover, "point_camera", lambda wanted: pointed.append(wanted.pan_rad))
    bench.submit(Stop(), 2)
    bench.run(1.0)
    assert pointed == []


@pytest.mark.at_length
def test_a_camera_may_be_slowed_down_during_its_motion(bench: Bench) -> None:
    bench.rover.lazy_camera = True
    bench.submit(SetCameraAngles(2.0, 0.0), 1)
    bench.submit(SetCameraRotateSpeed(0.1), 2)
    assert bench.finish(1) is Stage.EXECUTED


def test_an_axis_is_held_even_before_the_camera_has_reported_its_angles(bench: Bench) -> None:
    bench.rover.angles = CameraAngles(0.4, 0.3)
    bench.crash()
    bench.execute(SetCameraAngles(pan_rad=0.1), 1)
    assert bench.rover.angles == CameraAngles(0.1, 0.3)


def test_a_picture_is_stored_whole_under_its_command(bench: Bench) -> None:
    bench.execute(TakePicture(), 7)
    (stored,) = (bench.folder / "files/pictures").iterdir()
    assert stored.name == "MOE-7.jpg"
    assert stored.read_bytes() == PICTURE
    assert stored.name in bench.last(7).text


def test_every_source_has_its_own_pictures(bench: Bench) -> None:
    sources = ["MOE", "a b", "a_b", "a/b", "../b", "x" * 256]
    for source in sources:
        bench.send(Command(Identity(source, 7), TakePicture(), "direct"))
        bench.run(0.2)
    assert len(list((bench.folder / "files/pictures").iterdir())) == len(sources)


@pytest.mark.at_length
def test_a_dead_camera_fails_by_its_deadline_and_the_drive_continues(bench: Bench) -> None:
    bench.rover.camera_works = False
    bench.submit(TakePicture(), 1)
    bench.submit(MoveForward(8.0), 2)
    assert bench.finish(1) is Stage.FAILED
    assert bench.last(1).reason is Reason.CAPTURE_DEADLINE
    assert bench.finish(2) is Stage.EXECUTED
