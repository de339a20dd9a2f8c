"""The folder itself: nothing leads out of it, and nothing in it can upset the core."""

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.reasons import Figure, Reason, Refusal
from executive.state import (
    LONGEST_PATH,
    FileEvent,
    FileEventKind,
    FileFolder,
    FileStamp,
    check_path,
)
from executive.state.files import LONGEST_NAME

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


@given(path=PATHS, target=PATHS)
def test_no_path_leads_out(trap: FileFolder, path: str, target: str) -> None:
    root = trap.root.resolve()
    for found in (trap.find(path), trap.target(target)):
        assert isinstance(found, Refusal) or found.resolve().is_relative_to(root)
    stamp = trap.stamp(path)
    assert (stamp is None) == (path != "a/b.jpg")
    assert trap.about(path) == ()


@given(path=PATHS)
def test_a_path_is_fit_or_refused_with_the_argument(path: str) -> None:
    refusal = check_path(path, 2)
    if refusal is None:
        assert 0 < len(path) <= LONGEST_PATH
        assert not path.startswith("/")
    else:
        assert (refusal.reason, refusal.argument) == (Reason.BAD_PATH, 2)
        refusal.text.encode()


def test_names_too_long_for_a_disk_are_refused(folder: FileFolder) -> None:
    name = "ä" * (LONGEST_NAME // 2)
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


def test_stamps_tell_that_a_file_changed(folder: FileFolder) -> None:
    folder.store("a.jpg", b"1")
    stamp = folder.stamp("a.jpg")
    assert isinstance(stamp, FileStamp)
    assert dict(folder.entries()) == {"a.jpg": stamp}
    folder.move("a.jpg", "b.jpg")
    assert folder.stamp("b.jpg") == stamp
    (folder.root / "b.jpg").write_bytes(b"22")
    assert folder.stamp("b.jpg") != stamp


def test_what_is_known_of_a_file_is_not_told_of_another_in_its_place(folder: FileFolder) -> None:
    about = (Figure("commandId", 7), Figure("POS_X", 0.5, "m"))
    folder.store("a.jpg", b"1", about)
    assert folder.about("a.jpg") == about
    folder.move("a.jpg", "b/c.jpg")
    assert folder.about("b/c.jpg") == about
    (folder.root / "b" / "c.jpg").unlink()
    assert folder.about("b/c.jpg") == ()
    (folder.root / "b" / "c.jpg").write_bytes(b"other")
    assert folder.about("b/c.jpg") == ()


def test_what_a_killed_process_left_is_tidied(folder: FileFolder) -> None:
    folder.store("a/b.jpg", b"1")
    left = folder.root / "a" / ".c.jpg.part"
    left.write_bytes(b"half")
    folder.tidy()
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
    assert folder.about("a.jpg") == (Figure("commandId", 1),)
    assert [path.name for path in folder.root.iterdir()] == [".about", "a.jpg"]
    assert events == [FileEvent(FileEventKind.STORED, "a.jpg")]
