"""Files aboard: nothing leads out of their folder; what commands and actions do with them."""

import os
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from executive.commands import (
    Command,
    DeleteFile,
    ExecuteAction,
    MoveFile,
    Request,
    Stop,
    TakePicture,
)
from executive.commands.lifecycle import Accepted
from executive.state import MAX_PATH_OCTETS, FileFolder, FileStamp, check_path
from executive.state.files import MAX_NAME_OCTETS
from executive.values.reasons import Figure, Reason, Refusal
from executive.values.reports import FileEvent, FileEventKind, Identity, Stage
from tests.support.kinematic import Bench

PARTS = st.sampled_from(
    ["", ".", "..", "...", "a", "b.jpg", "out", "secret", ".about", ".a.part", "~", "\0", "ä", "/"]
)
PATHS = st.one_of(st.lists(PARTS, max_size=6).map("/".join), st.text(max_size=40))


@pytest.fixture
def events() -> list[FileEvent]:
    return []


@pytest.fixture
def folder(tmp_path: Path, events: list[FileEvent]) -> FileFolder:
    (tmp_path / "secret").write_text("s")
    return FileFolder(tmp_path / "files", events.append)


@pytest.fixture(scope="module")
def trap(tmp_path_factory: pytest.TempPathFactory) -> FileFolder:
    """Give a folder with links that lead out of it, and a secret beside it."""
    base = tmp_path_factory.mktemp("trap")
    (base / "secret").write_text("s")
    folder = FileFolder(base / "files", lambda _: None)
    folder.store("a/b.jpg", b"1")
    (folder.root / "out").symlink_to(base)
    (folder.root / "a" / "secret").symlink_to(base / "secret")
    return folder


@pytest.mark.at_length
@given(path=PATHS, target=PATHS)
@settings(max_examples=40)
def test_no_path_escapes_the_folder(trap: FileFolder, path: str, target: str) -> None:
    root = trap.root.resolve()
    for found in (trap.find(path), trap.target(target)):
        assert isinstance(found, Refusal) or found.resolve().is_relative_to(root)
    stamp = trap.stamp(path)
    assert (stamp is None) == (path != "a/b.jpg")
    assert trap.metadata(path) == ()


@given(path=PATHS)
def test_a_path_is_fit_or_refused_with_the_argument(path: str) -> None:
    refusal = check_path(path, 2)
    if refusal is None:
        assert 0 < len(path) <= MAX_PATH_OCTETS
        assert not path.startswith("/")
    else:
        assert (refusal.reason, refusal.argument) == (Reason.BAD_PATH, 2)
        refusal.text.encode()


def test_names_too_long_for_a_disk_are_refused(folder: FileFolder) -> None:
    name = "ä" * (MAX_NAME_OCTETS // 2)
    folder.store(name, b"1")
    assert isinstance(folder.find(name), Path)
    assert isinstance(folder.find(name + "a"), Refusal)
    assert folder.move(name, name[1:]) is None
    assert list(folder.paths()) == [name[1:]]


def test_what_cannot_be_named_or_is_no_file_is_not_listed(folder: FileFolder) -> None:
    folder.store("a/b.jpg", b"1")
    root = os.fsencode(folder.root)
    for name in (b"\xff.jpg", b"new\nline", b"\x1b[31m", b".hidden"):
        with open(root + b"/" + name, "wb") as file:
            file.write(b"1")
    os.mkfifo(folder.root / "pipe")
    (folder.root / "loop").symlink_to("loop")
    (folder.root / "again").symlink_to(folder.root)
    (folder.root / "empty").mkdir()
    (folder.root / "inside").symlink_to("a/b.jpg")
    assert list(folder.paths()) == ["a/b.jpg", "inside"]
    for path in ("loop", "loop/a", "again", "pipe", "a/b.jpg/c"):
        assert isinstance(folder.find(path), Refusal)
        assert folder.stamp(path) is None
    assert list(folder.paths("a")) == ["a/b.jpg"]
    for path in ("loop", "again/..", "nothing", "a/b.jpg", "../files", "/"):
        with pytest.raises(NotADirectoryError):
            list(folder.entries(path))


def test_a_folder_that_is_not_there_yet_is_empty(folder: FileFolder) -> None:
    assert list(folder.entries()) == []


def test_stamps_reveal_a_changed_file(folder: FileFolder) -> None:
    folder.store("a.jpg", b"1")
    stamp = folder.stamp("a.jpg")
    assert isinstance(stamp, FileStamp)
    assert dict(folder.entries()) == {"a.jpg": stamp}
    folder.move("a.jpg", "b.jpg")
    assert folder.stamp("b.jpg") == stamp
    (folder.root / "b.jpg").write_bytes(b"22")
    assert folder.stamp("b.jpg") != stamp


def test_metadata_of_a_file_is_not_given_for_its_replacement(folder: FileFolder) -> None:
    about = (Figure("commandId", 7), Figure("POS_X", 0.5, "m"))
    folder.store("a.jpg", b"1", about)
    assert folder.metadata("a.jpg") == about
    folder.move("a.jpg", "b/c.jpg")
    assert folder.metadata("b/c.jpg") == about
    (folder.root / "b" / "c.jpg").unlink()
    assert folder.metadata("b/c.jpg") == ()
    (folder.root / "b" / "c.jpg").write_bytes(b"other")
    assert folder.metadata("b/c.jpg") == ()


def test_remains_of_a_killed_process_are_removed(folder: FileFolder) -> None:
    folder.store("a/b.jpg", b"1")
    left = folder.root / "a" / ".c.jpg.part"
    left.write_bytes(b"half")
    folder.remove_partial_files()
    assert not left.exists()
    assert list(folder.paths()) == ["a/b.jpg"]


def test_a_disk_that_is_full_leaves_the_old_file(
    folder: FileFolder, events: list[FileEvent], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder.store("a.jpg", b"old", (Figure("commandId", 1),))

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(OSError, match="No space"):
        folder.store("a.jpg", b"new")
    assert (folder.root / "a.jpg").read_bytes() == b"old"
    assert folder.metadata("a.jpg") == (Figure("commandId", 1),)
    assert sorted(path.name for path in folder.root.iterdir()) == [".about", "a.jpg"]
    assert events == [FileEvent(FileEventKind.STORED, "a.jpg")]


PICTURE = "pictures/MOE-1.jpg"


def reason(bench: Bench, request: Request, number: int) -> Reason:
    answer = bench.refusal(request, number)
    assert bench.last(number).stage is Stage.REJECTED
    return answer.reason


def command_of(request: Request, number: int) -> Command:
    return Command(Identity("MOE", number), request, "direct")


def photograph(bench: Bench) -> FileFolder:
    bench.execute(TakePicture(), 1)
    return bench.executive.files


def test_a_picture_shows_up_with_where_it_was_taken(bench: Bench) -> None:
    files = photograph(bench)
    assert bench.received.files == [FileEvent(FileEventKind.STORED, PICTURE)]
    assert list(files.paths()) == [PICTURE]
    about = {figure.name: figure.value for figure in files.metadata(PICTURE)}
    assert about["commandId"] == 1
    assert {"POS_X", "POS_Y", "HEAD", "CAM_PAN", "CAM_TILT"} <= set(about)


def test_a_file_is_moved_with_its_metadata_and_deleted(bench: Bench) -> None:
    files = photograph(bench)
    about = files.metadata(PICTURE)
    bench.execute(MoveFile(PICTURE, "kept/rock.jpg"), 2)
    assert list(files.paths()) == ["kept/rock.jpg"]
    assert files.metadata("kept/rock.jpg") == about
    bench.execute(DeleteFile("kept/rock.jpg"), 3)
    assert list(files.paths()) == []
    assert bench.received.files[1:] == [
        FileEvent(FileEventKind.DELETED, PICTURE),
        FileEvent(FileEventKind.STORED, "kept/rock.jpg"),
        FileEvent(FileEventKind.DELETED, "kept/rock.jpg"),
    ]


def test_an_absent_source_and_an_existing_target_are_refused(bench: Bench) -> None:
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
def test_no_command_escapes_the_folder(bench: Bench, path: str) -> None:
    photograph(bench)
    assert reason(bench, DeleteFile(path), 2) is Reason.BAD_PATH
    assert reason(bench, MoveFile(path, "a.jpg"), 3) is Reason.BAD_PATH
    assert reason(bench, MoveFile(PICTURE, path), 4) is Reason.BAD_PATH


def test_links_are_not_followed(bench: Bench, tmp_path: Path) -> None:
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
    bench.executive.submit(command_of(DeleteFile(PICTURE), 2), lambda _: None)
    bench.executive.submit(command_of(MoveFile(PICTURE, "a.jpg"), 3), lambda _: None)
    bench.run(0.2)
    assert [bench.last(number).stage for number in (2, 3)] == [Stage.EXECUTED, Stage.FAILED]
    assert bench.last(3).reason is Reason.NO_SUCH_FILE
    assert list(files.paths()) == []


def test_a_text_command_is_executed_in_any_case(bench: Bench) -> None:
    assert isinstance(bench.submit(ExecuteAction(" video  on "), 1), Accepted)
    assert bench.finish(1) is Stage.EXECUTED
    switched = [bench.video.enabled]
    bench.execute(ExecuteAction("VIDEO OFF"), 2)
    assert [*switched, bench.video.enabled] == [True, False]
    assert reason(bench, ExecuteAction("DANCE"), 3) is Reason.UNKNOWN_ACTION


def test_an_active_stop_counts_among_the_waiting_ones(bench: Bench) -> None:
    bench.drive_on()
    bench.submit(Stop(), 2)
    bench.submit(ExecuteAction("VIDEO ON"), 3)
    assert bench.executive.queued_goals == 1
    assert bench.finish(3) is Stage.EXECUTED
    assert bench.executive.queued_goals == 0


def test_an_action_that_cannot_be_done_fails(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(_: bool) -> None:
        raise OSError(98, "Address already in use")

    monkeypatch.setattr(bench.video, "set_enabled", broken)
    bench.submit(ExecuteAction("VIDEO ON"), 1)
    assert bench.finish(1) is Stage.FAILED
    assert "Address already in use" in bench.last(1).text
