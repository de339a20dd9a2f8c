"""Explanations of commands whose answer and start waited for the ledger's disk."""

from contextlib import closing
from pathlib import Path

import pytest

from adapters.explanation import explain_command, explanation_lines
from adapters.mrs.spec.histories import history_of, wire_history
from adapters.recording import RunFile
from adapters.recording.timed_items import read_history
from executive.commands import MoveForward, SetTravelSpeed
from executive.history import RunHistory
from executive.history.history_builder import HistoryBuilder
from tests.core.test_ledger_writer import SlowDisk, submitted
from tests.support.kinematic import Bench
from trees import leaf_paths


def explained(history: RunHistory, command: int) -> str:
    explanation = explain_command(history, str(command))
    return "\n".join(explanation_lines(explanation, lambda utc_s: f"{utc_s:.2f}"))


def test_the_wait_for_the_disk_is_explained(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with closing(RunFile(path)) as tape, Bench(tmp_path, tape=tape) as bench:
        disk = SlowDisk(bench)
        disk.commit_s = 0.6
        submitted(bench, MoveForward(0.2), 1)
        submitted(bench, SetTravelSpeed(99.0), 2)
        bench.run(1.3)
        disk.commit_s = 0.0
        bench.finish(1)
        submitted(bench, MoveForward(0.2), 1)
        bench.run(0.2)
        bench.execute(MoveForward(0.2), 3)
    history, _ = read_history(path)
    for each in (history, history_of(wire_history(history))):
        assert "waited 0.60 s for the disk" in explained(each, 1)
        assert explained(each, 1).count("waited") == 1
        assert "waited 1.20 s for the disk" in explained(each, 2)
        assert "the disk" not in explained(each, 3)


def test_a_command_that_waits_for_the_disk_is_known(tmp_path: Path) -> None:
    history = HistoryBuilder(leaf_paths)
    with Bench(tmp_path, tape=history) as bench:
        bench.execute(MoveForward(0.2), 1)
        SlowDisk(bench).commit_s = 9.0
        submitted(bench, SetTravelSpeed(0.2), 2)
        bench.run(1.0)
        assert "waits for the disk" in explained(history.history(), 2)
        waiting, wait_s = bench.executive.commit_backlog
    assert waiting > 0
    assert wait_s == pytest.approx(1.0, abs=0.06)
