"""Wrong strings to all who read them: sound readers meet every goal, broken ones are told."""

import ctypes
from collections.abc import Callable

import pytest
from click.testing import CliRunner

from adapters.mops import load_dictionary
from executive.settings import load_settings
from tests.benchmarks.commands import bench
from tests.stress import broken_readers, mops_fuzz
from tests.stress.fuzzing import break_nothing
from tests.stress.mops_readers import Brick, Fault, MopsFindings

FEW = 600


def missed(prepare: Callable[[], None], seed: int = 1) -> set[str]:
    figures = mops_fuzz.measure(load_settings("jackal"), FEW, seed, lambda _: None, prepare)
    return {figure.name.removeprefix("MOPS: ") for figure in figures if figure.met is False}


def test_a_stop_under_another_name_is_expected_as_the_brick_is_sent_it() -> None:
    brick, findings = Brick(load_dictionary()), MopsFindings(print)
    for _ in range(3):
        brick.take((b"10E|MOE|MOCUP|REMOVE_PLAN|1||False|False|7|#",), findings)
    assert findings.counts[Fault.MOVED] == 0


def test_sound_readers_meet_every_goal() -> None:
    assert missed(break_nothing, seed=2) == set()


@pytest.mark.parametrize(
    ("breaks", "names"),
    [
        (broken_readers.is_lenient, {"taken though wrong"}),
        (broken_readers.raises, {"raised something else than a refusal"}),
        (broken_readers.does_not_find_back, {"not taken though sound"}),
        (broken_readers.is_silent, {"wrong and not told"}),
        (broken_readers.reports_twice, {"told in more than one line"}),
        (broken_readers.reports_in_many_lines, {"told in more than one line"}),
        (broken_readers.writes_otherwise, {"read otherwise than it was written"}),
        (broken_readers.has_the_brick_execute_foreign_commands, {"motion"}),
        (broken_readers.moves, {"motion"}),
        (
            broken_readers.accepts_commands_without_source,
            {"said or done though no sound string asked for it"},
        ),
        (
            broken_readers.reports_unsent_messages,
            {"said or done though no sound string asked for it"},
        ),
        (broken_readers.grows, {"memory gained"}),
    ],
)
def test_a_broken_reader_is_found_out(
    breaks: Callable[[pytest.MonkeyPatch], None], names: set[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    ctypes.CDLL(None).malloc_trim(0)  # else what other tests gave back is taken first
    assert missed(lambda: breaks(monkeypatch)) >= names
    broken_readers.RETAINED.clear()


def test_the_bench_reports_it(monkeypatch: pytest.MonkeyPatch) -> None:
    few = ["mops-fuzz", "--messages", "200", "--seed", "3"]
    assert CliRunner().invoke(bench, few).exit_code == 0
    broken_readers.is_silent(monkeypatch)
    assert CliRunner().invoke(bench, few).exit_code == 1
