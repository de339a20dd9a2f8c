"""Wrong recordings to all who read them: sound readers meet every goal, broken ones are told."""

import re
import time
from pathlib import Path

import pytest

from adapters.recording import RecordingError, RunReader
from tests.stress import recording_readers
from tests.stress.recording_fuzz import read_portion
from tests.stress.recording_mutants import MIB, Mutants, originals
from tests.stress.recording_readers import Reader, ReaderFault

FEW = 8
SEED = "1"
OPENS = re.compile(
    r"from adapters\.recording import .*\b(RecordedMoments|RunReader|read_history|read_timed)\b"
)
ATTACKED = {
    "adapters/api/__init__.py",
    "adapters/calibration/drive_log.py",
    "adapters/cli/history_options.py",
    "adapters/cli/watch_file.py",
    "adapters/console/recordings/recorded.py",
    "adapters/ros/bag.py",
    "sim/drawing/run_plot.py",
    "sim/fork/run_log.py",
}
"""What opens recordings, beside the replay: `READERS` call what each of them calls."""


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> list[bytes]:
    """Give the recordings that are changed."""
    return originals(tmp_path_factory.mktemp("sound"))


@pytest.fixture(autouse=True)
def quiet(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("ERROR")


@pytest.mark.slow
def test_sound_readers_meet_every_goal(sound: list[bytes]) -> None:
    portion = read_portion(sound, FEW, SEED)
    assert portion.findings == []
    assert min(portion.read, portion.refused) > FEW


def test_mutants_are_those_of_the_seed(sound: list[bytes]) -> None:
    first, again = Mutants(sound, SEED), Mutants(sound, SEED)
    assert [first.next() for _ in range(FEW)] == [again.next() for _ in range(FEW)]


def raises(path: Path, _: Path) -> str:
    """Give what a reader may not, where it meets a wrong recording."""
    try:
        messages = list(RunReader(path).messages())
    except RecordingError as error:
        raise KeyError("x") from error
    return str(messages[0].topic)


def is_slow(_: Path, __: Path) -> str:
    """Never end."""
    while True:
        time.process_time()


def is_large(_: Path, __: Path) -> str:
    """Take 180 MiB for a moment."""
    return str(len(bytes(b"x" * (180 * MIB))))


@pytest.mark.parametrize(
    ("reader", "fault"),
    [
        (raises, ReaderFault.RAISED),
        (is_slow, ReaderFault.SLOW),
        (is_large, ReaderFault.LARGE),
    ],
)
def test_a_broken_reader_is_found_out(
    reader: Reader, fault: ReaderFault, sound: list[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recording_readers, "PATIENCE", 0.02)
    monkeypatch.setattr("tests.stress.recording_fuzz.MAX_CPU_S", 0.05)
    monkeypatch.setattr("tests.stress.recording_fuzz._warm", lambda *_: recording_readers.Meter())
    portion = read_portion(sound, 5, SEED, {"broken": reader})
    assert fault in {each for each, _ in portion.findings}


def test_all_that_read_recordings_are_attacked() -> None:
    product = Path(recording_readers.__file__).parents[2]
    importers = {
        str(path.relative_to(product))
        for part in ("adapters", "sim")
        for path in (product / part).rglob("*.py")
        if OPENS.search(path.read_text(encoding="utf-8"))
    }
    assert importers == ATTACKED, "add what is new to tests/stress/recording_readers.py"
