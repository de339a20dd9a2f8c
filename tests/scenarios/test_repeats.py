"""The same file gives the same run, bit for bit."""

from dataclasses import replace
from pathlib import Path

from sim.scenario.lockstep_run import run_in_lock_step
from sim.scenario.reading import load_scenario
from sim.scenario.record import Record


def play(folder: Path) -> Record:
    return run_in_lock_step(load_scenario("drive3m_turn_picture"), folder)


def test_two_runs_are_alike_bit_for_bit(tmp_path: Path) -> None:
    first, second = play(tmp_path / "first"), play(tmp_path / "second")
    assert first.reports == second.reports
    assert first.poses == second.poses
    assert first.values == second.values
    (picture,), (again,) = first.files.glob("pictures/*.jpg"), second.files.glob("pictures/*.jpg")
    assert picture.read_bytes() == again.read_bytes()
    assert len(first.poses) == 130
    assert first.poses[0].pose != first.poses[-1].pose


def test_another_seed_is_another_run(tmp_path: Path) -> None:
    scenario = replace(load_scenario("drive3m_turn_picture"), seed=1)
    assert run_in_lock_step(scenario, tmp_path / "third").poses != play(tmp_path / "fourth").poses
