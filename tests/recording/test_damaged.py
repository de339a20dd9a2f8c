"""Damage costs a recording what is damaged and what builds on that; a hostile one costs nothing."""

import logging
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from adapters.recording import RecordingError, RunFile, RunReader, complete, decode
from adapters.recording.container import read_records
from adapters.recording.replay import replay
from adapters.recording.run_file import part_of
from executive.core.recording import ProcessStart, StoredFile
from tests.stress.recording_mutants import batches_of, hostile, recording_of
from tests.stress.recording_readers import MAX_CPU_S, MAX_MB, READERS, Meter, Reader
from tests.support.examples import ALL

CHUNK, INDEX, DATA_END = 6, 7, 15


def messages(path: Path) -> list[tuple[str, bytes]]:
    return [(each.topic.name, each.data) for each in RunReader(path).messages()]


def starts(path: Path, opcode: int) -> list[int]:
    """Return where the records of a kind begin."""
    with path.open("rb") as file:
        return [each.start for each in read_records(file) if each.opcode == opcode]


def flip(octets: bytes, offset: int) -> bytes:
    return octets[:offset] + bytes([octets[offset] ^ 0x10]) + octets[offset + 1 :]


def in_a_chunk(path: Path) -> bytes:
    offsets = starts(path, CHUNK)
    return flip(path.read_bytes(), offsets[len(offsets) // 2] + 300)


def in_the_kind_of_a_chunk(path: Path) -> bytes:
    octets, offsets = path.read_bytes(), starts(path, CHUNK)
    offset = offsets[len(offsets) // 2]
    return octets[:offset] + bytes([INDEX]) + octets[offset + 1 :]


def zeros_at_the_end(path: Path) -> bytes:
    offsets = starts(path, CHUNK)
    return path.read_bytes()[: offsets[len(offsets) // 2]] + bytes(4096)


DAMAGES = (in_a_chunk, in_the_kind_of_a_chunk, zeros_at_the_end)
EACH = pytest.mark.parametrize("damage", DAMAGES)
READ = [
    pytest.param(reader, damage, id=f"{name}-{damage.__name__}")
    for row, (name, reader) in enumerate(READERS.items())
    for column, damage in enumerate(DAMAGES)
    if ALL or (row + column) % len(DAMAGES) == 0
]
"""Each reader with a damage, each damage with several readers; all pairs with `--stress`."""


@pytest.mark.parametrize(("reader", "damage"), READ)
def test_every_reader_reads_up_to_the_damage(
    reader: Reader,
    damage: Callable[[Path], bytes],
    flushed: Path,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(damage(flushed))
    assert reader(path, tmp_path) == ""
    if reader is not READERS["complete"]:
        message = [each.getMessage() for each in caplog.records if "damaged" in each.getMessage()]
        assert message
        assert all(each.startswith(f"{path}: damaged after ") for each in message)
        assert all(" s: read up to there (" in each for each in message)


@EACH
def test_records_before_the_damage_are_unchanged(
    damage: Callable[[Path], bytes], flushed: Path, tmp_path: Path
) -> None:
    path, sound = tmp_path / "run.mcap", messages(flushed)
    path.write_bytes(damage(flushed))
    read = messages(path)
    assert read == sound[: len(read)]
    assert len(sound) / 4 < len(read) < len(sound) * 3 / 4
    replayed = replay(path)
    assert (replayed.difference, replayed.whole) == (None, False)
    assert 2.0 < replayed.duration_s < 6.0


def test_octets_behind_the_data_do_not_matter(flushed: Path, tmp_path: Path) -> None:
    path, octets, (end,) = tmp_path / "run.mcap", flushed.read_bytes(), starts(flushed, DATA_END)
    sound, behind = messages(flushed), end + 13
    for changed in (
        octets[:behind],
        octets + bytes(5000),
        octets[:behind] + bytes(len(octets) - behind),
        *(flip(octets, offset) for offset in range(behind, len(octets), 499)),
        flip(octets, len(octets) - 20),
    ):
        path.write_bytes(changed)
        reader = RunReader(path)
        assert [(each.topic.name, each.data) for each in reader.messages()] == sound
        assert reader.whole
        assert not reader.damaged


def test_a_file_with_later_records_is_not_read_behind_damage(flushed: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(in_a_chunk(flushed))
    part_of(path, 2).write_bytes(flushed.read_bytes())
    assert len(messages(path)) < len(messages(flushed))
    path.write_bytes(flushed.read_bytes())
    part_of(path, 2).write_bytes(in_a_chunk(flushed))
    assert len(messages(flushed)) < len(messages(path)) < 2 * len(messages(flushed))


def test_a_file_damaged_at_its_beginning_is_no_recording(flushed: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(flip(flushed.read_bytes(), starts(flushed, CHUNK)[0] + 300))
    with pytest.raises(RecordingError, match=r"run.mcap: is no MCAP file, or damaged \(the chunk"):
        messages(path)


def test_a_torn_file_that_is_damaged_is_left_as_it_is(flushed: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    torn = in_a_chunk(flushed)[: starts(flushed, DATA_END)[0]]
    path.write_bytes(torn)
    assert not complete(path)
    assert path.read_bytes() == torn


def test_a_damaged_chunk_at_the_end_is_torn(flushed: Path, tmp_path: Path) -> None:
    path, offsets = tmp_path / "run.mcap", starts(flushed, CHUNK)
    octets = flushed.read_bytes()[: offsets[5] - 400]
    path.write_bytes(octets[: offsets[4] + 99] + bytes(len(octets) - offsets[4] - 99))
    sound = messages(path)
    assert complete(path)
    assert messages(path) == sound
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("offset", ["/tmp/x", "../x", "a/../../x", "a\0b", "x" * 300])
def test_a_replay_makes_no_file_outside_its_own_folder(
    offset: str, flushed: Path, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    with closing(RunFile(path)) as file:
        for message in RunReader(flushed).messages():
            item = decode(message.topic, message.data)
            if isinstance(item, ProcessStart):
                item = replace(item, files=(StoredFile(offset, 10),))
            file.put(item)
    with pytest.raises(RecordingError):
        replay(path)


@pytest.fixture(scope="module")
def batches(flushed: Path) -> list[bytes]:
    """Give the batches of the recording."""
    return batches_of(flushed.read_bytes())


def test_batches_make_the_recording_again(
    batches: list[bytes], flushed: Path, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(recording_of(batches))
    assert messages(path) == messages(flushed)


def test_hostile_recordings_are_read_within_bounds(batches: list[bytes], tmp_path: Path) -> None:
    logging.disable()
    try:
        sound = tmp_path / "sound.mcap"
        sound.write_bytes(recording_of(batches[:4]))
        attacked = ("replay", "console", "complete")
        for name in attacked:
            (tmp_path / name).mkdir()
            assert READERS[name](sound, tmp_path / name) == ""
        meter = Meter()
        for number, (what, make) in enumerate(hostile(batches)):
            path = tmp_path / f"{number}.mcap"
            path.write_bytes(make())
            for name in attacked if ALL else (attacked[number % len(attacked)],):
                folder = tmp_path / f"{number} {name}"
                folder.mkdir()
                taken = meter.take(READERS[name], path, folder)
                assert not taken.raised, (what, name, taken)
                assert taken.cpu_s < MAX_CPU_S, (what, name, taken)
                assert taken.grown_mb < MAX_MB, (what, name, taken)
    finally:
        logging.disable(logging.NOTSET)
