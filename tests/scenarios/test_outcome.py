"""A run in figures, and alike bit for bit whenever and wherever it is played."""

import pickle
from pathlib import Path

import pytest

from executive.reasons import Reason
from sim.scenario.changes import Change
from sim.scenario.model import PlayMode
from sim.scenario.outcome import Outcome, play_once
from sim.scenario.reading import load_scenario


def play(folder: Path, name: str, *changes: str) -> Outcome:
    made = [Change.parse(text) for text in changes]
    folder.mkdir(exist_ok=True)
    return play_once(name, load_scenario(name, PlayMode.LOCK_STEP, made), folder)


def test_a_drive_in_figures(tmp_path: Path) -> None:
    outcome = play(tmp_path, "drive3m_turn_picture")
    figures = outcome.figures
    assert outcome.holds
    assert all(finding.holds for finding in outcome.findings)
    assert figures.duration_s == pytest.approx(5.75, abs=0.3)
    assert figures.distance_m == pytest.approx(3.06, abs=0.05)
    assert figures.true_error_m == pytest.approx(0.055, abs=0.03)
    assert 0 < (figures.true_error_rad or 0) < 0.03
    # 30 W for 6.5 s, and the motors.
    assert figures.energy_j == pytest.approx(327, abs=60)
    assert (figures.executed, figures.failed, figures.false_executed) == (3, 0, 0)
    assert (figures.detection_s, figures.stopping_m, figures.reasons) == (None, None, ())


def test_detection_and_reasons_of_a_fault(tmp_path: Path) -> None:
    figures = play(tmp_path, "odometry_lost").figures
    assert figures.detection_s == pytest.approx(0.3, abs=0.06)
    assert figures.stopping_m == pytest.approx(0.4, abs=0.15)
    assert (figures.executed, figures.failed) == (3, 1)
    assert figures.reasons[0] is Reason.ODOMETRY_STALE


def test_where_nothing_is_commanded_there_are_no_figures(tmp_path: Path) -> None:
    path = tmp_path / "idle.yaml"
    path.write_text("title: Idle\nlasts: 1\nexpect: [{mode: IDLE}]\n")
    figures = play(tmp_path / "run", str(path), "inject={camera_dead, at: 0.5}").figures
    assert (figures.duration_s, figures.true_error_m, figures.true_error_rad) == (None, None, None)
    assert (figures.detection_s, figures.executed, figures.reasons) == (None, 0, ())


def test_the_digest_is_of_the_run_alone(tmp_path: Path) -> None:
    first = play(tmp_path / "first", "expired")
    again = play(tmp_path / "again", "expired", "seed=0")
    assert first.digest == again.digest
    assert first == again
    assert first.digest != play(tmp_path / "other", "expired", "seed=1").digest


def test_an_outcome_travels(tmp_path: Path) -> None:
    outcome = play(tmp_path, "expired")
    arrived = pickle.loads(pickle.dumps(outcome))
    assert arrived == outcome
    assert arrived.record.poses == outcome.record.poses
