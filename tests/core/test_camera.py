import pytest

from executive.commands import (
    Command,
    MoveCameraAngles,
    MoveForward,
    SetCameraAngles,
    SetCameraRotateSpeed,
    Stop,
    TakePicture,
)
from executive.geometry import STANDING
from executive.reasons import Reason
from executive.reports import Identity, Stage
from executive.state import Battery, CameraAngles
from tests.support.kinematic import WHOLE_LIFE, Bench


def test_the_camera_works_while_stopped(bench: Bench) -> None:
    bench.submit(Stop(), 1)
    bench.finish(1)
    bench.submit(SetCameraAngles(0.5, None), 2)
    assert bench.finish(2) is Stage.EXECUTED
    assert bench.rover.velocity == STANDING


def test_camera_angles_absolute_relative_and_bounded(bench: Bench) -> None:
    bench.submit(SetCameraAngles(1.0, 0.5), 1)
    bench.submit(MoveCameraAngles(-0.4, 0.0), 2)
    bench.submit(MoveCameraAngles(5.0, 0.0), 3)
    bench.finish(2)
    assert bench.rover.angles.pan_rad == pytest.approx(0.6)
    assert bench.finish(3) is Stage.EXECUTED
    assert bench.rover.angles.pan_rad == pytest.approx(2.8)


def test_a_relative_angle_is_added_once_though_a_hazard_comes_between(bench: Bench) -> None:
    bench.submit(MoveForward(5.0), 1)
    bench.run(2.0)
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
    bench.submit(MoveCameraAngles(0.2, 0.0), 3)
    assert bench.finish(3) is Stage.EXECUTED
    assert bench.rover.angles.pan_rad == pytest.approx(here_rad + 0.2, abs=0.08)


def test_a_stop_leaves_a_camera_alone_that_has_arrived(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.submit(SetCameraAngles(0.5, 0.1), 1)
    assert bench.finish(1) is Stage.EXECUTED
    pointed: list[float] = []
    monkeypatch.setattr(bench.rover, "point_camera", lambda wanted: pointed.append(wanted.pan_rad))
    bench.submit(Stop(), 2)
    bench.run(1.0)
    assert pointed == []


def test_a_camera_may_be_slowed_down_on_its_way(bench: Bench) -> None:
    bench.rover.lazy_camera = True
    bench.submit(SetCameraAngles(2.0, 0.0), 1)
    bench.submit(SetCameraRotateSpeed(0.1), 2)
    assert bench.finish(1) is Stage.EXECUTED


def test_an_axis_is_kept_even_before_the_camera_has_told_its_angles(bench: Bench) -> None:
    bench.rover.angles = CameraAngles(0.4, 0.3)
    bench.crash()
    bench.submit(SetCameraAngles(pan_rad=0.1), 1)
    assert bench.finish(1) is Stage.EXECUTED
    assert bench.rover.angles == CameraAngles(0.1, 0.3)


def test_a_picture_is_stored_whole_under_its_command(bench: Bench) -> None:
    bench.submit(TakePicture(), 7)
    assert bench.finish(7) is Stage.EXECUTED
    (stored,) = (bench.folder / "files/pictures").iterdir()
    assert stored.name == "MOE-7.jpg"
    assert stored.read_bytes() == b"\xff\xd8picture"
    assert stored.name in bench.last(7).text


def test_every_source_keeps_its_own_pictures(bench: Bench) -> None:
    sources = ["MOE", "a b", "a_b", "a/b", "../b", "x" * 3000]
    for source in sources:
        bench.send(Command(Identity(source, 7), TakePicture(), "direct"))
        bench.run(0.2)
    assert len(list((bench.folder / "files/pictures").iterdir())) == len(sources)


def test_a_dead_camera_fails_by_its_deadline_and_the_drive_goes_on(bench: Bench) -> None:
    bench.rover.camera_works = False
    bench.submit(TakePicture(), 1)
    bench.submit(MoveForward(8.0), 2)
    assert bench.finish(1) is Stage.FAILED
    assert bench.last(1).reason is Reason.CAPTURE_DEADLINE
    assert bench.finish(2) is Stage.EXECUTED


def test_motion_and_camera_work_side_by_side(bench: Bench) -> None:
    bench.submit(MoveForward(3.0), 1)
    bench.submit(SetCameraAngles(1.0, 0.0), 2)
    bench.submit(TakePicture(), 3)
    bench.run(0.5)
    assert bench.stages(3) == WHOLE_LIFE
    assert bench.stages(1)[-1] is Stage.STARTED
