"""A truncated recording is completed: viewers read it by its index, and nothing is lost."""

import os
from contextlib import closing
from pathlib import Path

import pytest
from mcap.reader import SeekingReader

from adapters.recording import (
    PROFILE,
    BackgroundRecorder,
    RecordingError,
    RunFile,
    RunReader,
    complete,
)
from adapters.recording.replay import replay
from adapters.recording.rows import RowReader
from executive.core.recording import CoreCall, CoreCalled
from executive.settings import load_settings

SETTINGS = load_settings("jackal")


def messages(path: Path) -> list[tuple[str, bytes]]:
    """Return what a reader finds by streaming, which needs no index."""
    return [(each.topic.name, each.data) for each in RunReader(path).messages()]


def batches(path: Path) -> list[bytes]:
    """Return what a viewer finds by the index."""
    with path.open("rb") as file:
        reader = SeekingReader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        found = [message.data for _, _, message in reader.iter_messages(["/run"])]
        reported = summary.statistics.channel_message_counts
        (number,) = (key for key, each in summary.channels.items() if each.topic == "/run")
        assert reported[number] == len(found)
        return found


@pytest.mark.parametrize("part", [0.02, 0.3, 0.5, 0.77, 0.9, 0.96, 0.995])
def test_it_has_an_index_and_all_that_could_be_read(
    flushed: Path, tmp_path: Path, part: float
) -> None:
    octets = flushed.read_bytes()
    path = tmp_path / "run.mcap"
    path.write_bytes(octets[: round(part * len(octets))])
    os.utime(path, (1e9, 1e9))
    readable = messages(path)
    assert complete(path)
    assert path.stat().st_mtime == 1e9
    assert messages(path) == readable
    assert not complete(path)
    if readable:
        reader = RowReader()
        rows = [row for batch in batches(path) for row in reader.rows(batch)]
        assert [(row.topic, row.data) for row in rows] == readable
        assert not replay(path).whole
        assert replay(path).difference is None


def test_it_remains_of_the_version_that_wrote_it(flushed: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    older = flushed.read_bytes().replace(PROFILE.encode(), b"rover-run-2", 1)
    path.write_bytes(older[: len(older) // 2])
    assert complete(path)
    with pytest.raises(RecordingError, match=r"of another version \(rover-run-2, not "):
        messages(path)


def test_complete_files_and_other_files_are_left_alone(flushed: Path, tmp_path: Path) -> None:
    for octets in (flushed.read_bytes(), b"", b"\x89MCAP0", b"a text, and no recording at all"):
        path = tmp_path / "run.mcap"
        path.write_bytes(octets)
        assert not complete(path)
        assert path.read_bytes() == octets


def test_garbage_behind_the_last_chunk_is_cut_off(flushed: Path, tmp_path: Path) -> None:
    octets = flushed.read_bytes()
    path = tmp_path / "run.mcap"
    chunk = b"\x06" + (9).to_bytes(8, "little") + b"x" * 9
    for garbage in (bytes(100), b"\x06" + b"\xff" * 60, chunk):
        path.write_bytes(octets[: len(octets) // 2])
        complete(path)
        sound = messages(path)
        path.write_bytes(path.read_bytes()[:-8] + garbage)
        assert complete(path)
        assert messages(path) == sound


def test_the_next_start_completes_the_file_of_a_killed_process(tmp_path: Path) -> None:
    killed = RunFile(tmp_path / "20200101T000000Z.mcap")
    killed.put(CoreCalled(1.0, 1.0, CoreCall.TICK))
    killed.flush()
    with closing(BackgroundRecorder(tmp_path, SETTINGS.recording)):
        pass
    assert len(batches(tmp_path / "20200101T000000Z.mcap")) == 1
    killed.close()
