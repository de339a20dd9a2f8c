"""A run in figures, and alike bit for bit whenever and wherever it is played."""

import pickle
from dataclasses import replace
from pathlib import Path

import pytest

from executive.values.geometry import Pose
from executive.values.parameters import Parameter
from executive.values.reasons import Reason
from executive.values.reports import ReportKind, Severity, Stage
from sim.scenario.changes import Override
from sim.scenario.model import RunMode
from sim.scenario.outcome import ScenarioResult, figures_of, run_once
from sim.scenario.reading import load_scenario
from sim.scenario.record import FaultChange


def play(folder: Path, name: str, *changes: str) -> ScenarioResult:
    made = [Override.parse(text) for text in changes]
    folder.mkdir(exist_ok=True)
    return run_once(name, load_scenario(name, RunMode.LOCK_STEP, made), folder)


def test_a_drive_in_figures(tmp_path: Path) -> None:
    outcome = play(tmp_path, "drive3m_turn_picture")
    figures = outcome.figures
    assert outcome.passed
    assert all(finding.passed for finding in outcome.findings)
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


JUMPED = """
title: An odometry that jumped
duration: 16
timeline:
  - {at: 0.5, inject: {odometry_jump: {by: 0.4}}}
  - {at: 1, command: {moveTo: {x: 1, y: 0}}, label: held}
  - {at: 2, command: resume}
  - {at: 2.1, command: {setTravelSpeed: {speed: 0.8}}}
  - {at: 2.5, fix: position}
  - {after: position EXECUTED, command: {moveTo: {x: 1, y: 0.5, heading: 90deg}}, label: goal}
  - {at: 12, command: {rotateTo: {heading: 0}}, label: heading}
  - {at: 13, command: stop}
expect:
  - {command: position, stages: [RECEIVED, ACCEPTED, STARTED, EXECUTED]}
  - {command: goal, ends: EXECUTED}
"""


def test_a_fix_makes_the_true_pose_the_reported_one(tmp_path: Path) -> None:
    path = tmp_path / "jumped.yaml"
    path.write_text(JUMPED)
    outcome = play(tmp_path / "run", str(path))
    figures = outcome.figures
    assert outcome.passed, outcome.findings
    assert figures.true_error_m == pytest.approx(0.0, abs=0.05)
    assert figures.pose_error_m == pytest.approx(0.4, abs=0.02)
    assert figures.pose_error_rad == pytest.approx(0.0, abs=0.01)
    assert (figures.executed_before_fix, figures.executed_after_fix) == (0.0, 0.5)
    assert figures.false_after_fault == 0


def test_a_second_fix_adds_to_the_first(tmp_path: Path) -> None:
    path = tmp_path / "twice.yaml"
    again = "  - {at: 14, inject: {gyro_bias: {rate: 1}}}\n  - {at: 14.5, clear: gyro_bias}\n"
    again += "  - {at: 15, fix: again}\n  - {at: 15.2, query: then}\n"
    path.write_text(JUMPED.replace("expect:", f"{again}expect:"))
    outcome = play(tmp_path / "run", str(path))
    (then,) = outcome.record.answers
    reported = {each.parameter: each.value for each in then.values}
    (true,) = (seen.pose for seen in outcome.record.poses if abs(seen.time_s - 15.2) < 1e-6)
    positions = (Parameter.POS_X, Parameter.POS_Y, Parameter.POS_Z, Parameter.HEAD)
    seen = (true.x_m, true.y_m, true.z_m, true.heading_rad)
    assert [reported[each] for each in positions] == pytest.approx(seen, abs=0.01)


def test_an_untrue_result_after_a_reported_fault_is_distinguished(tmp_path: Path) -> None:
    """Both commands end EXECUTED a metre off; between their ends a fault is reported."""
    record = play(tmp_path, "motion_forward").record
    (end,) = (each for each in record.reports if each.stage is Stage.EXECUTED)
    end_s = record.time_of(end)
    record.poses = [replace(seen, pose=Pose(1.0)) for seen in record.poses]
    record.faults = [FaultChange(end_s - 1, "pushed", True)]
    for reported_s, many in ((end_s - 0.5, 1), (end_s + 0.5, 0)):
        reported = replace(
            end, kind=ReportKind.EVENT, severity=Severity.WARNING, stage=None, identity=None
        )
        reported = replace(reported, utc_s=record.start_utc_s + reported_s, sequence=99)
        figures = figures_of(replace(record, reports=[*record.reports, reported]))
        assert (figures.false_executed, figures.false_after_fault) == (1, many)


def test_a_motion_interrupted_by_a_crash_reports_no_fault(tmp_path: Path) -> None:
    changes = ("inject={head_stuck, at: 2}", "crash={at: 2.5, for: 1}")
    figures = play(tmp_path, "motion_forward", *changes).figures
    assert figures.reasons == (Reason.INTERRUPTED,)
    assert figures.detection_s is None


def test_where_nothing_is_commanded_there_are_no_figures(tmp_path: Path) -> None:
    path = tmp_path / "idle.yaml"
    path.write_text("title: Idle\nduration: 1\nexpect: [{mode: IDLE}]\n")
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
