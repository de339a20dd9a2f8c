"""Each monitor by its fault in the simulation, and by normal driving in which none may speak."""

from pathlib import Path

import pytest

from executive.reasons import Reason
from executive.reports import Kind, Report, Severity, Stage
from sim.scenario.changes import Change
from sim.scenario.model import PlayMode
from sim.scenario.outcome import Outcome, play_once
from sim.scenario.reading import load_scenario

BLIND = Change("settings.sensors", "{imu: null, joints: null}")


def play(folder: Path, scenario: str, *changes: tuple[str, str]) -> Outcome:
    """Play a scenario with changes."""
    made = [BLIND, *(Change(key, value) for key, value in changes)]
    return play_once(scenario, load_scenario(scenario, PlayMode.LOCK_STEP, made), folder)


def first_event(outcome: Outcome) -> Report:
    """Return the first event that tells of a fault."""
    return next(
        report
        for report in outcome.record.reports
        if report.kind is Kind.EVENT and report.severity is not Severity.INFORMATIONAL
    )


@pytest.mark.parametrize(
    ("fault", "scenario", "reason", "within_s"),
    [
        ("odometry_lost", "forward", Reason.ODOMETRY_STALE, 0.4),
        ("odometry_repeated", "forward", Reason.ODOMETRY_STALE, 0.4),
        ("odometry_late: {by: 0.2}", "forward", Reason.ODOMETRY_LATE, 0.7),
        ("odometry_frozen", "forward", Reason.ODOMETRY_INCONSISTENT, 0.3),
        ("odometry_zero_twist", "forward", Reason.ODOMETRY_INCONSISTENT, 0.4),
        ("odometry_jump: {by: 0.15}", "forward", Reason.ODOMETRY_INCONSISTENT, 0.15),
        ("odometry_drift: {rate: 0.2}", "forward", Reason.ODOMETRY_INCONSISTENT, 2.0),
        ("encoder_dead: {side: both}", "held", Reason.OFF_COMMAND, 0.6),
        ("wheels_stuck", "held", Reason.OFF_COMMAND, 0.6),
        ("left_stuck", "forward", Reason.OFF_COMMAND, 1.0),
        ("cmd_vel_cut", "held", Reason.OFF_COMMAND, 1.0),
        ("gyro_bias: {rate: 0.3}", "forward", Reason.OFF_COMMAND, 3.0),
    ],
)
def test_a_fault_ends_the_motion_with_its_reason_and_figures(
    tmp_path: Path, fault: str, scenario: str, reason: Reason, within_s: float
) -> None:
    at_s = 2.5
    inject = f"{{{fault}, at: {at_s}}}"
    outcome = play(tmp_path, f"motion_{scenario}", ("inject", inject), ("lasts", "10"))
    event = first_event(outcome)
    assert event.reason is reason, event
    assert outcome.record.time_of(event) - at_s <= within_s
    (failed,) = (r for r in outcome.record.reports if r.stage is Stage.FAILED)
    assert (failed.reason, failed.text) == (event.reason, event.text)
    assert any(figure.name == "bound" for figure in failed.figures)
    assert outcome.figures.false_executed == 0


@pytest.mark.parametrize(
    ("travel", "rotate", "friction"), [(1.0, 0.5, 0.6), (-0.8, 0.8, 0.8), (0.0, 1.4, 0.45)]
)
def test_a_velocity_that_is_held_leads_along_its_arc(
    tmp_path: Path, travel: float, rotate: float, friction: float
) -> None:
    """What a commanded rotation comes to depends on speed and ground, by up to 45 %."""
    values = {"travel": travel, "rotate": rotate, "duration": 4}
    changes = [(f"command.go.{name}", str(value)) for name, value in values.items()]
    outcome = play(
        tmp_path, "motion_held", *changes, ("world.friction", str(friction)), ("lasts", "8")
    )
    assert outcome.figures.executed == 1
    assert outcome.figures.false_executed == 0


def test_a_push_after_the_last_frame_is_told_by_the_next_ones(tmp_path: Path) -> None:
    changes = (
        ("settings.sensors.second_odometry", "{rate_hz: 2}"),
        ("inject", "{pushed: {by: 0.245}, at: 3.193}"),
        ("world.friction", "0.742"),
        ("seed", "423808"),
        ("lasts", "6"),
    )
    outcome = play(tmp_path, "motion_turn", *changes)
    (executed,) = (r for r in outcome.record.reports if r.stage is Stage.EXECUTED)
    assert outcome.record.time_of(executed) > 3.193
    assert outcome.figures.false_executed == 0
    assert any(figure.name == "seen before" for figure in executed.figures)
    assert first_event(outcome).reason is Reason.SLIDES
