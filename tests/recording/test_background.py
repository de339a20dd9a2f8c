"""A recording at real time: written beside the core, bounded, and never in its way."""

import os
from contextlib import closing
from pathlib import Path
from queue import SimpleQueue

import pytest

from adapters.recording import BackgroundRecorder, RunFile, RunReader, background
from executive.core.recording import CoreCall, CoreCalled, ProcessStart, StoredFile
from executive.settings import RecordingSettings, load_settings

JACKAL = load_settings("jackal")
MINIMUM = RecordingSettings(max_mb=10.0)
FULL = Path("/dev/full")
PATIENCE_S = 60.0


def tick(number: int) -> CoreCalled:
    return CoreCalled(float(number), float(number), CoreCall.TICK)


def start(octets: int) -> ProcessStart:
    """Return a beginning that cannot be packed to less than so many octets."""
    return ProcessStart(JACKAL, os.urandom(octets), b"", (StoredFile("a", 1),), None, video=False)


def recordings(folder: Path) -> list[Path]:
    return sorted(folder.iterdir())


def test_all_that_is_handed_over_is_in_the_file(tmp_path: Path) -> None:
    with closing(BackgroundRecorder(tmp_path / "runs", JACKAL.recording)) as tape:
        tape.put(start(100))
        for number in range(1000):
            tape.put(tick(number))
    (path,) = recordings(tmp_path / "runs")
    reader = RunReader(path)
    assert len(list(reader.messages())) == 1001
    assert reader.whole


def test_flushed_data_are_in_an_unclosed_file(tmp_path: Path) -> None:
    file = RunFile(tmp_path / "run.mcap")
    file.put(tick(1))
    file.flush()
    reader = RunReader(tmp_path / "run.mcap")
    assert len(list(reader.messages())) == 1
    assert not reader.whole
    file.close()


def test_recordings_begun_in_the_same_second_are_two(tmp_path: Path) -> None:
    for _ in range(2):
        with closing(BackgroundRecorder(tmp_path, JACKAL.recording)) as tape:
            tape.put(tick(1))
    assert [len(list(RunReader(path).messages())) for path in recordings(tmp_path)] == [1, 1]


def test_a_long_recording_continues_in_other_files_and_the_first_are_deleted(
    tmp_path: Path,
) -> None:
    old, ancient = tmp_path / "20200101T000000Z.mcap", tmp_path / "20190101T000000Z.mcap"
    for path, days in ((old, 1), (ancient, 30)):
        path.write_bytes(bytes(500_000))
        changed_s = path.stat().st_mtime - days * 86_400
        os.utime(path, (changed_s, changed_s))
    with closing(BackgroundRecorder(tmp_path, MINIMUM)) as tape:
        for number in range(14):
            tape.put(start(1_100_000))
            tape.put(tick(number))
    stored = recordings(tmp_path)
    assert old not in stored
    assert ancient not in stored
    assert sum(path.stat().st_size for path in stored) <= 10_000_000
    first = next(path for path in stored if len(path.suffixes) == 1)
    assert len(stored) >= 6
    assert list(RunReader(first).messages()), "its beginning is kept, with settings and ledger"


def test_parts_are_read_as_one(tmp_path: Path) -> None:
    first = RunFile(tmp_path / "run.mcap")
    first.put(tick(1))
    second = first.continued(tmp_path / "run.2.mcap")
    second.put(tick(2))
    second.close()
    reader = RunReader(tmp_path / "run.mcap")
    assert [message.data[:11] for message in reader.messages()] == [b'{"now_s":1.', b'{"now_s":2.']
    assert reader.whole


def test_a_full_disk_ends_the_recording_and_is_reported_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(background, "_new_file", lambda _: FULL)
    monkeypatch.setattr(background, "FLUSH_S", 0.0)
    reported: SimpleQueue[str] = SimpleQueue()
    with closing(BackgroundRecorder(tmp_path, JACKAL.recording)) as tape:
        tape.on_fault = reported.put
        tape.put(tick(1))
        message = reported.get(timeout=PATIENCE_S)
        tape.put(tick(2))
    assert message == "the recording full ends: it cannot be written; the rover continues"
    assert reported.empty()


def test_a_folder_that_cannot_be_made_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match=r"Not a directory|File exists"):
        BackgroundRecorder(tmp_path / "file", JACKAL.recording)
