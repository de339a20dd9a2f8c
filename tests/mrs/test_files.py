"""The services about files, operation by operation: listing, describing, announcing, watching."""

import asyncio
import os
import shutil
from collections.abc import Awaitable, Callable
from dataclasses import replace
from errno import ENOSPC
from pathlib import Path
from zlib import crc32

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from adapters.mal import (
    AttributeType,
    Consumer,
    MalError,
    Subscription,
    SubscriptionFilter,
    TypedAttribute,
)
from adapters.mrs.aboard.file_access import FolderWatcher
from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import FileEventType, FileInfo, mrs_specification
from executive.state import FileFolder
from executive.values.reports import FileEventKind
from tests.mrs.aboard import Aboard

LIMIT_S = 60.0
PARTS = st.sampled_from(["", ".", "..", "files", "ledger.sqlite", ".about", "out", "a", "\0", "ü"])
Reported = asyncio.Queue[tuple[FileEventKind, str]]


def root_of(aboard: Aboard) -> Path:
    root = aboard.do(lambda bench: bench.executive.files.root)
    root.mkdir(exist_ok=True)
    return root


def number_of(aboard: Aboard, operation: str, *parts: object) -> int:
    """Return the number of the error by which an operation is answered."""
    service = "FileTransfer" if operation == "listFiles" else "FileManagement"

    async def session(consumer: Consumer) -> int:
        call = consumer.submit if operation == "fileStored" else consumer.request
        with pytest.raises(MalError) as raised:
            await call(service, operation, *parts)
        return raised.value.number

    return aboard.consume(session)


def leads_back(root: Path, path: str) -> bool:
    """Return whether a path goes out by the link and comes back to the folder itself."""
    return set(path.split("/")) == {"out", "files"} and (root / path).resolve() == root.resolve()


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(path=st.lists(PARTS, max_size=5).map("/".join))
@example(path="out/files")
def test_nothing_outside_the_folder_is_reported(aboard: Aboard, path: str) -> None:
    root = root_of(aboard)
    if not (root / "out").is_symlink():
        (root / "out").symlink_to(root.parent)
    size = (root.parent / "ledger.sqlite").stat().st_size
    assert number_of(aboard, "getAttributes", path) == 5
    assert number_of(aboard, "fileStored", FileInfo(path=path, size=size, modified=0)) == 1
    if path and not leads_back(root, path):
        assert number_of(aboard, "listFiles", path) == 5


async def test_a_full_folder_is_listed_by_what_changed_last(
    aboard: Aboard, client: MrsClient
) -> None:
    root = root_of(aboard)
    (root / "old").mkdir()
    for number in range(10_000):
        (root / "old" / f"{number:05}").write_bytes(b"")
    (root / "new").mkdir()
    (root / "new" / "rock.jpg").write_bytes(b"1")

    files = await client.list_files()
    assert len(files) == 1000
    assert [file.path for file in files] == sorted(file.path for file in files)
    assert "new/rock.jpg" in {file.path for file in files}
    (file,) = await client.list_files("new")
    assert (file.path, file.size, file.mimeType) == ("new/rock.jpg", 1, "image/jpeg")
    assert file.metaData is None


async def test_a_checksum_is_in_the_list_once_it_is_known(
    aboard: Aboard, client: MrsClient
) -> None:
    path = root_of(aboard) / "rock.JPEG"
    path.write_bytes(b"rock")

    assert (await client.get_attributes("rock.JPEG")).checksum == crc32(b"rock")
    assert (await client.list_files())[0].checksum is None, "it may change within its second"
    _age(path)
    assert (await client.get_attributes("rock.JPEG")).checksum == crc32(b"rock")
    assert (await client.list_files())[0].checksum == crc32(b"rock")
    path.write_bytes(b"moss")
    assert (await client.get_attributes("rock.JPEG")).checksum == crc32(b"moss")


def test_copies_of_the_current_recording_are_made_one_at_a_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recordings = tmp_path / "recordings"
    recordings.mkdir()
    (recordings / "run.mcap").write_bytes(bytes(20_000_000))
    aboard = Aboard(tmp_path / "aboard", recordings=recordings)
    folder = root_of(aboard) / "current-recording"

    def on_full_disk(_: Path, target: Path) -> None:
        target.write_bytes(b"begun")
        raise OSError(ENOSPC, os.strerror(ENOSPC))

    async def session(client: MrsClient) -> None:
        lists = (client.list_files(folder.name) for _ in range(6))
        found = {(each.path, each.size) for (each,) in await asyncio.gather(*lists)}
        assert found == {("current-recording/run.mcap", 20_000_000)}
        monkeypatch.setattr(shutil, "copyfile", on_full_disk)
        with pytest.raises(MalError, match="No space"):
            await client.list_files(folder.name)
        assert [each.name for each in folder.iterdir()] == ["run.mcap"]
        shutil.rmtree(folder)
        folder.symlink_to(recordings)
        with pytest.raises(MalError, match="is a link"):
            await client.list_files(folder.name)

    try:
        aboard.ground(session)
    finally:
        aboard.close()
    assert [each.name for each in recordings.iterdir()] == ["run.mcap"]


def _age(path: Path) -> None:
    os.utime(path, ns=(10**18, 10**18))


def test_a_file_unlike_its_description_is_not_stored(aboard: Aboard) -> None:
    (root_of(aboard) / "lidar.pcd").write_bytes(b"points")
    message = FileInfo(path="lidar.pcd", size=6, modified=0, checksum=crc32(b"points"))
    assert number_of(aboard, "fileStored", replace(message, size=5)) == 1
    assert number_of(aboard, "fileStored", replace(message, checksum=0)) == 1
    assert number_of(aboard, "fileStored", replace(message, path="nothing")) == 1


async def test_a_file_stored_by_others_is_announced_once(aboard: Aboard, client: MrsClient) -> None:
    path = root_of(aboard) / "lidar.pcd"
    path.write_bytes(b"points")
    message = FileInfo(path="lidar.pcd", size=6, modified=0, checksum=crc32(b"points"))
    events = await client.file_events()
    for _ in range(2):
        await client.file_stored(message)
    path.write_bytes(b"more points")
    await client.file_stored(replace(message, size=11, checksum=None))
    first, second = [await anext(events) for _ in range(2)]
    assert (first.event, first.file.size) == (FileEventType.STORED, 6)
    assert (second.event, second.file.size) == (FileEventType.CHANGED, 11)


async def test_events_can_be_requested_by_kind_of_file(aboard: Aboard, client: MrsClient) -> None:
    root = root_of(aboard)
    (root / "a.txt").write_bytes(b"1")
    (root / "a.jpg").write_bytes(b"1")
    received: asyncio.Queue[FileInfo] = asyncio.Queue()

    consumer = await Consumer.connect(mrs_specification(), aboard.uri)
    pictures = SubscriptionFilter(
        name="mimeType", values=(TypedAttribute(AttributeType.STRING, "image/jpeg"),)
    )
    await consumer.subscribe(
        "FileManagement",
        "monitorFiles",
        Subscription(subscriptionId="pictures", filters=(pictures,)),
        lambda _header, _event, file: received.put_nowait(file),
    )
    for name in ("a.txt", "a.jpg"):
        await client.file_stored(FileInfo(path=name, size=1, modified=0))
    first = await received.get()
    await consumer.close()
    assert first.path == "a.jpg"


def test_a_file_written_by_a_camera_program_is_listed(
    aboard: Aboard, monkeypatch: pytest.MonkeyPatch
) -> None:
    aboard.hang_up()
    monkeypatch.setattr("adapters.mrs.aboard.file_access.PERIOD_S", 0.02)
    aboard.listen()
    root = root_of(aboard)

    async def session(client: MrsClient) -> None:
        events = await client.file_events()
        (root / "camera").mkdir()
        (root / "camera" / ".1.png").write_bytes(b"png")
        (root / "camera" / ".1.png").rename(root / "camera" / "1.png")
        stored = await anext(events)
        assert (stored.event, stored.file.path) == (FileEventType.STORED, "camera/1.png")
        assert (stored.file.size, stored.file.mimeType) == (3, "image/png")
        (root / "camera" / "1.png").unlink()
        closed = await anext(events)
        assert (closed.event, closed.file) == (FileEventType.DELETED, stored.file)

    aboard.ground(session)


async def _reported(reported: Reported, count: int) -> list[tuple[FileEventKind, str]]:
    async with asyncio.timeout(LIMIT_S):
        return [await reported.get() for _ in range(count)]


def _watching(
    act: Callable[[FileFolder, FolderWatcher, Reported], Awaitable[None]], root: Path
) -> None:
    """Run a session with a watch over a folder."""

    async def hold() -> None:
        reported: Reported = asyncio.Queue()

        folder = FileFolder(root, lambda _: None)
        watch = FolderWatcher(folder, lambda kind, path, *_: reported.put_nowait((kind, path)))
        await act(folder, watch, reported)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("adapters.mrs.aboard.file_access.PERIOD_S", 0.01)
        asyncio.run(hold())


def test_a_change_is_reported_once_by_the_first_observer(tmp_path: Path) -> None:
    (tmp_path / "known").write_bytes(b"1")

    async def act(folder: FileFolder, watch: FolderWatcher, reported: Reported) -> None:
        (tmp_path / "new").write_bytes(b"1")
        watch.notify(FileEventKind.STORED, "new", folder.stamp("new"))
        (tmp_path / "found").write_bytes(b"1")
        assert sorted(path for _, path in await _reported(reported, 2)) == ["found", "new"]
        watch.notify(FileEventKind.STORED, "found", folder.stamp("found"))
        (tmp_path / "known").write_bytes(b"22")
        assert await _reported(reported, 1) == [(FileEventKind.CHANGED, "known")]
        (tmp_path / "known").unlink()
        assert await _reported(reported, 1) == [(FileEventKind.DELETED, "known")]
        watch.notify(FileEventKind.DELETED, "known", None)
        watch.notify(FileEventKind.DELETED, "never", None)
        (tmp_path / "last").write_bytes(b"1")
        assert await _reported(reported, 1) == [(FileEventKind.STORED, "last")]

    _watching(act, tmp_path)


def test_a_created_and_deleted_file_is_reported_in_order(tmp_path: Path) -> None:
    async def act(folder: FileFolder, watch: FolderWatcher, reported: Reported) -> None:
        for name in ("a", "b"):
            (tmp_path / name).write_bytes(b"1")
            stamp = folder.stamp(name)
            (tmp_path / name).unlink()
            watch.notify(FileEventKind.STORED, name, stamp)
            watch.notify(FileEventKind.DELETED, name, None)
        both = (FileEventKind.STORED, FileEventKind.DELETED)
        assert await _reported(reported, 4) == [
            (kind, name) for name in ("a", "b") for kind in both
        ]

    _watching(act, tmp_path)


def test_a_file_being_written_is_reported_when_complete(tmp_path: Path) -> None:
    async def act(folder: FileFolder, _: FolderWatcher, reported: Reported) -> None:
        polls = 0
        entries = folder.entries

        def grow() -> object:
            nonlocal polls
            polls += 1
            with (tmp_path / "film").open("ab") as file:
                file.write(b"x" * (polls < 10))
            return entries()

        folder.entries = grow  # type: ignore[method-assign, assignment]
        assert await _reported(reported, 1) == [(FileEventKind.STORED, "film")]
        assert polls >= 10

    _watching(act, tmp_path)


def test_many_simultaneous_files_are_reported_in_their_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("adapters.mrs.aboard.file_access.MAX_REPORTED", 7)

    async def act(_: FileFolder, __: FolderWatcher, reported: Reported) -> None:
        names = [f"{number:02}" for number in range(30)]
        for name in names:
            (tmp_path / name).write_bytes(b"1")
        assert sorted(path for _, path in await _reported(reported, 30)) == names
        for name in names:
            (tmp_path / name).unlink()
        kinds = {kind for kind, _ in await _reported(reported, 30)}
        assert kinds == {FileEventKind.DELETED}
        assert reported.empty()

    _watching(act, tmp_path)


def test_an_unreadable_folder_is_checked_again(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async def act(folder: FileFolder, _: FolderWatcher, reported: Reported) -> None:
        entries, faults = folder.entries, iter([OSError("bad disk")])

        def fail() -> object:
            for fault in faults:
                raise fault
            return entries()

        folder.entries = fail  # type: ignore[method-assign, assignment]
        (tmp_path / "a").write_bytes(b"1")
        assert await _reported(reported, 1) == [(FileEventKind.STORED, "a")]

    _watching(act, tmp_path)
    assert "cannot be scanned" in caplog.text
