"""The reference of `rover bench pairs`, and the verdict "slower"."""

import subprocess
from pathlib import Path

import pytest

from tests.benchmarks import pairs
from tests.benchmarks.pairs import Measured, last_commit, median_interval

PROBE = """
import json, time
import work
began_s = time.process_time()
for _ in range(work.TIMES):
    sum(range(1000))
print(json.dumps({"sums, ms": 1e3 * (time.process_time() - began_s)}))
"""


@pytest.fixture
def history(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two commits of a tree, the second with five times the work; the file of measurements."""
    tree = tmp_path / "tree"
    tree.mkdir()

    def git(*arguments: str) -> None:
        user = ("-c", "user.name=x", "-c", "user.email=x@example.org", "-c", "commit.gpgsign=false")
        subprocess.run(["git", *user, *arguments], cwd=tree, check=True, capture_output=True)

    git("init", "-q")
    for times in (300, 1500):
        (tree / "work.py").write_text(f"TIMES = {times}\n")
        git("add", "-A")
        git("commit", "-q", "-m", str(times))
    (tmp_path / "probe.py").write_text(PROBE)
    monkeypatch.setattr(pairs, "CHECKOUT", tree)
    monkeypatch.setattr(pairs, "PROBES", tmp_path / "probe.py")
    return tmp_path / "runs" / "history.jsonl"


def test_what_became_slower_misses_its_goal_and_is_recorded(history: Path) -> None:
    lines: list[str] = []
    took, ratio = pairs.measure(None, 3, lines.append, history)
    assert took.name == "sums"
    assert ratio.met is False
    assert 2.0 < ratio.value < 12.0
    assert "this tree and" in lines[0]
    again = pairs.measure("HEAD", 3, lines.append, history)[1]
    assert 0.3 < again.value < 3.0
    assert len(history.read_text().splitlines()) == 2
    with pytest.raises(ChildProcessError, match="nowhere"):
        pairs.measure("nowhere", 1, lines.append, history)


def test_the_last_other_commit_of_this_machine_is_compared_with(tmp_path: Path) -> None:
    path = tmp_path / "history.jsonl"
    assert last_commit(path, "mine", "c") is None
    for machine, commit in (("mine", "a"), ("mine", "b"), ("other", "d"), ("mine", "c")):
        pairs.append(path, Measured("2026-01-01T00:00:00Z", machine, commit, {}))
    assert last_commit(path, "mine", "c") == "b"
    assert last_commit(path, "third", "c") is None


def test_the_interval_of_a_median_leaves_out_single_outliers() -> None:
    assert median_interval([1.0, 1.1, 0.9]) == (0.9, 1.1)
    assert median_interval([*[1.0] * 12, 5.0]) == (1.0, 1.0)
