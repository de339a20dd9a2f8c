from pathlib import Path

import pytest

from executive.commands import (
    Command,
    DeleteFile,
    ExecuteAction,
    MoveCameraAngles,
    MoveFile,
    MoveForward,
    Request,
    SetCameraAngles,
    SetCameraRotateSpeed,
    Stop,
    TakePicture,
)
from executive.commands.lifecycle import Admitted
from executive.geometry import STANDING
from executive.reasons import Reason
from executive.reports import Identity, Stage
from executive.state import Battery, CameraAngles, FileEvent, FileEventKind, FileFolder
from tests.support.kinematic import Bench


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


def test_a_relative_angle_is_added_once_though_a_hazard_comes_between(bench: Bench) -> None:
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


def test_a_camera_may_be_slowed_down_on_its_way(bench: Bench) -> None:
    bench.rover.lazy_camera = True
    bench.submit(SetCameraAngles(2.0, 0.0), 1)
    bench.submit(SetCameraRotateSpeed(0.1), 2)
    assert bench.finish(1) is Stage.EXECUTED


def test_an_axis_is_kept_even_before_the_camera_has_told_its_angles(bench: Bench) -> None:
    bench.rover.angles = CameraAngles(0.4, 0.3)
    bench.crash()
    bench.execute(SetCameraAngles(pan_rad=0.1), 1)
    assert bench.rover.angles == CameraAngles(0.1, 0.3)


def test_a_picture_is_stored_whole_under_its_command(bench: Bench) -> None:
    bench.execute(TakePicture(), 7)
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


PICTURE = "pictures/MOE-1.jpg"


def reason(bench: Bench, request: Request, number: int) -> Reason:
    answer = bench.refusal(request, number)
    assert bench.last(number).stage is Stage.REJECTED
    return answer.reason


def asked(request: Request, number: int) -> Command:
    return Command(Identity("MOE", number), request, "direct")


def photograph(bench: Bench) -> FileFolder:
    bench.execute(TakePicture(), 1)
    return bench.executive.files


def test_a_picture_shows_up_with_where_it_was_taken(bench: Bench) -> None:
    files = photograph(bench)
    assert bench.heard.files == [FileEvent(FileEventKind.STORED, PICTURE)]
    assert list(files.paths()) == [PICTURE]
    about = {figure.name: figure.value for figure in files.about(PICTURE)}
    assert about["commandId"] == 1
    assert {"POS_X", "POS_Y", "HEAD", "CAM_PAN", "CAM_TILT"} <= set(about)


def test_a_file_is_moved_with_what_is_known_about_it_and_deleted(bench: Bench) -> None:
    files = photograph(bench)
    about = files.about(PICTURE)
    bench.execute(MoveFile(PICTURE, "kept/rock.jpg"), 2)
    assert list(files.paths()) == ["kept/rock.jpg"]
    assert files.about("kept/rock.jpg") == about
    bench.execute(DeleteFile("kept/rock.jpg"), 3)
    assert list(files.paths()) == []
    assert bench.heard.files[1:] == [
        FileEvent(FileEventKind.DELETED, PICTURE),
        FileEvent(FileEventKind.STORED, "kept/rock.jpg"),
        FileEvent(FileEventKind.DELETED, "kept/rock.jpg"),
    ]


def test_what_is_not_there_and_what_is_there_already_are_refused(bench: Bench) -> None:
    files = photograph(bench)
    files.store("other.jpg", b"2")
    assert reason(bench, DeleteFile("nothing.jpg"), 2) is Reason.NO_SUCH_FILE
    assert reason(bench, DeleteFile("pictures"), 3) is Reason.NO_SUCH_FILE
    assert reason(bench, MoveFile("nothing.jpg", "a.jpg"), 4) is Reason.NO_SUCH_FILE
    assert reason(bench, MoveFile("other.jpg", PICTURE), 5) is Reason.TARGET_EXISTS
    assert reason(bench, MoveFile("other.jpg", "other.jpg"), 6) is Reason.TARGET_EXISTS


@pytest.mark.parametrize(
    "path",
    ["", "/etc/passwd", "../ledger.sqlite", "pictures/../../x", "a//b", "./a", ".about/x", "a\0b",
     "a/", "x" * 256],
)  # fmt: skip
def test_no_path_leads_out(bench: Bench, path: str) -> None:
    photograph(bench)
    assert reason(bench, DeleteFile(path), 2) is Reason.BAD_PATH
    assert reason(bench, MoveFile(path, "a.jpg"), 3) is Reason.BAD_PATH
    assert reason(bench, MoveFile(PICTURE, path), 4) is Reason.BAD_PATH


def test_links_lead_nowhere(bench: Bench, tmp_path: Path) -> None:
    files = photograph(bench)
    (tmp_path / "secret").write_text("s")
    (files.root / "link").symlink_to(tmp_path / "secret")
    (files.root / "outside").symlink_to(tmp_path)
    assert reason(bench, DeleteFile("link"), 2) is Reason.NO_SUCH_FILE
    assert reason(bench, DeleteFile("outside/secret"), 3) is Reason.NO_SUCH_FILE
    assert reason(bench, MoveFile(PICTURE, "outside/picture.jpg"), 4) is Reason.BAD_PATH
    assert list(files.paths()) == [PICTURE]
    assert (tmp_path / "secret").read_text() == "s"


def test_what_another_deletes_first_fails(bench: Bench) -> None:
    files = photograph(bench)
    bench.executive.submit(asked(DeleteFile(PICTURE), 2), lambda _: None)
    bench.executive.submit(asked(MoveFile(PICTURE, "a.jpg"), 3), lambda _: None)
    bench.run(0.2)
    assert [bench.last(number).stage for number in (2, 3)] == [Stage.EXECUTED, Stage.FAILED]
    assert bench.last(3).reason is Reason.NO_SUCH_FILE
    assert list(files.paths()) == []


def test_a_text_command_is_done_whatever_its_case(bench: Bench) -> None:
    assert isinstance(bench.submit(ExecuteAction(" video  on "), 1), Admitted)
    assert bench.finish(1) is Stage.EXECUTED
    switched = [bench.video.on]
    bench.execute(ExecuteAction("VIDEO OFF"), 2)
    assert [*switched, bench.video.on] == [True, False]
    assert reason(bench, ExecuteAction("DANCE"), 3) is Reason.UNKNOWN_ACTION


def test_while_a_stop_is_under_way_it_counts_among_those_that_wait(bench: Bench) -> None:
    bench.drive_on()
    bench.submit(Stop(), 2)
    bench.submit(ExecuteAction("VIDEO ON"), 3)
    assert bench.executive.goals_waiting == 1
    assert bench.finish(3) is Stage.EXECUTED
    assert bench.executive.goals_waiting == 0


def test_an_action_that_cannot_be_done_fails(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(_: bool) -> None:
        raise OSError(98, "Address already in use")

    monkeypatch.setattr(bench.video, "switch", broken)
    bench.submit(ExecuteAction("VIDEO ON"), 1)
    assert bench.finish(1) is Stage.FAILED
    assert "Address already in use" in bench.last(1).text
