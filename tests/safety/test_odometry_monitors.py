"""Each monitor by its fault in the simulation, and by normal driving in which none may speak."""

from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import replace
from math import nan
from pathlib import Path

import pytest

from executive.commands import DriveFor
from executive.settings import OdometrySettings, Settings, load_settings
from executive.values.facts import Odometry
from executive.values.geometry import Pose, Velocity
from executive.values.reasons import Reason
from executive.values.reports import Report, ReportKind, Severity, Stage
from sim.scenario.changes import Override
from sim.scenario.model import RunMode
from sim.scenario.outcome import ScenarioResult, run_once
from sim.scenario.reading import load_scenario
from tests.support.kinematic import STEP_S, Bench, ignoring

BLIND = Override("settings.sensors", "{imu: null, joints: null}")


def play(
    folder: Path, scenario: str, *changes: tuple[str, str], blind: bool = True
) -> ScenarioResult:
    """Play a scenario with changes, by default without any sensor but the odometry."""
    made = [BLIND] if blind else []
    made += [Override(key, value) for key, value in changes]
    return run_once(scenario, load_scenario(scenario, RunMode.LOCK_STEP, made), folder)


def first_event(outcome: ScenarioResult) -> Report:
    """Return the first event that tells of a fault."""
    return next(
        report
        for report in outcome.record.reports
        if report.kind is ReportKind.EVENT and report.severity is not Severity.INFORMATIONAL
    )


@pytest.mark.alike
@pytest.mark.parametrize(
    ("fault", "scenario", "reason", "within_s"),
    [
        ("gyro_bias: {rate: 0.3}", "forward", Reason.OFF_COMMAND, 3.0),
        ("odometry_lost", "forward", Reason.ODOMETRY_STALE, 0.4),
        ("odometry_repeated", "forward", Reason.ODOMETRY_STALE, 0.4),
        ("odometry_late: {by: 0.14}", "forward", Reason.ODOMETRY_LATE, 0.45),
        ("odometry_late: {by: 0.26}", "forward", Reason.ODOMETRY_LATE, 0.5),
        ("odometry_frozen", "forward", Reason.ODOMETRY_INCONSISTENT, 0.3),
        ("odometry_zero_twist", "forward", Reason.ODOMETRY_INCONSISTENT, 0.4),
        ("odometry_jump: {by: 0.15}", "forward", Reason.ODOMETRY_INCONSISTENT, 0.15),
        ("odometry_drift: {rate: 0.2}", "forward", Reason.ODOMETRY_INCONSISTENT, 2.0),
        ("encoder_dead: {side: both}", "held", Reason.OFF_COMMAND, 0.6),
        ("wheels_stuck", "held", Reason.OFF_COMMAND, 0.6),
        ("left_wheels_stuck", "forward", Reason.OFF_COMMAND, 1.0),
        ("cmd_vel_lost", "held", Reason.OFF_COMMAND, 1.0),
    ],
)
def test_a_fault_ends_the_motion_with_its_reason_and_figures(
    tmp_path: Path, fault: str, scenario: str, reason: Reason, within_s: float
) -> None:
    at_s = 2.5
    inject = f"{{{fault}, at: {at_s}}}"
    outcome = play(tmp_path, f"motion_{scenario}", ("inject", inject), ("duration", "10"))
    event = first_event(outcome)
    assert event.reason is reason, event
    assert outcome.record.time_of(event) - at_s <= within_s
    (failed,) = (r for r in outcome.record.reports if r.stage is Stage.FAILED)
    assert (failed.reason, failed.text) == (event.reason, event.text)
    assert any(figure.name == "bound" for figure in failed.figures)
    assert outcome.figures.false_executed == 0


@pytest.mark.alike
@pytest.mark.parametrize(
    ("travel", "rotate", "friction"), [(0.0, 1.4, 0.45), (1.0, 0.5, 0.6), (-0.8, 0.8, 0.8)]
)
def test_a_velocity_that_is_held_leads_along_its_arc(
    tmp_path: Path, travel: float, rotate: float, friction: float
) -> None:
    """What a commanded rotation comes to depends on speed and ground, by up to 45 %."""
    values = {"travel": travel, "rotate": rotate, "duration": 4}
    changes = [(f"command.go.{name}", str(value)) for name, value in values.items()]
    outcome = play(
        tmp_path, "motion_held", *changes, ("world.friction", str(friction)), ("duration", "8")
    )
    assert outcome.figures.executed == 1
    assert outcome.figures.false_executed == 0


@pytest.mark.at_length
@pytest.mark.parametrize("late_s", [0.15, 0.2])
def test_a_velocity_that_is_held_ends_at_its_heading_though_odometry_came_late(
    tmp_path: Path, late_s: float
) -> None:
    values = {"rotate": 1.0, "duration": 5}
    changes = [(f"command.go.{name}", str(value)) for name, value in values.items()]
    late = ("inject", f"{{odometry_late: {{by: {late_s}}}, at: 6.0, for: 0.3}}")
    outcome = play(tmp_path, "motion_held", *changes, late, ("duration", "10"))
    assert outcome.figures.executed == 1
    assert outcome.figures.true_error_rad is not None
    assert outcome.figures.true_error_rad < 0.1


PUSHED_LATE = (
    ("settings.sensors.second_odometry", "{rate_hz: 2}"),
    ("inject", "{pushed: {by: 0.245}, at: 3.193}"),
    ("world.friction", "0.742"),
    ("seed", "423808"),
    ("duration", "6"),
)
"""A push after the frame that ends the motion was taken, before that frame arrives."""


@pytest.mark.at_length
def test_a_push_that_is_felt_has_the_motion_wait_for_a_frame_taken_after_it(tmp_path: Path) -> None:
    outcome = play(tmp_path, "motion_turn", *PUSHED_LATE, blind=False)
    assert [r.stage for r in outcome.record.reports if r.stage and r.stage.terminal] == [
        Stage.FAILED
    ]
    assert first_event(outcome).reason is Reason.TRAVEL_SLIP


def test_a_push_that_no_imu_felt_is_told_by_the_next_frames(tmp_path: Path) -> None:
    outcome = play(tmp_path, "motion_turn", *PUSHED_LATE)
    (executed,) = (r for r in outcome.record.reports if r.stage is Stage.EXECUTED)
    assert outcome.record.time_of(executed) > 3.193
    assert outcome.figures.false_executed == 1
    assert any(figure.name == "seen before" for figure in executed.figures)
    assert first_event(outcome).reason is Reason.SLIDE_AT_REST


@pytest.mark.at_length
@pytest.mark.parametrize("fault", ["odometry_lost", "odometry_repeated"])
def test_odometry_that_falls_behind_other_sensors_is_seen_before_it_is_stale(
    tmp_path: Path, fault: str
) -> None:
    inject = ("inject", f"{{{fault}, at: 2.5}}")
    outcome = play(tmp_path, "motion_forward", inject, ("duration", "6"), blind=False)
    event = first_event(outcome)
    assert event.reason is Reason.ODOMETRY_STALE
    assert outcome.record.time_of(event) - 2.5 <= 0.29
    assert outcome.figures.stopping_m is not None
    assert outcome.figures.stopping_m < 0.45


@pytest.mark.at_length
@pytest.mark.parametrize("blind", [True, False])
@pytest.mark.parametrize("seed", [3, 4])
def test_odometry_that_jitters_by_up_to_a_fifth_of_a_second_stops_nothing(
    tmp_path: Path, seed: int, blind: bool
) -> None:
    jitter = ("inject", "{odometry_jitter: {stall: 0.2}, at: 0.1}")
    outcome = play(tmp_path, "motion_path", jitter, ("seed", str(seed)), blind=blind)
    assert outcome.figures.executed == 1
    assert all(r.severity is Severity.INFORMATIONAL for r in outcome.record.reports)


@pytest.mark.at_length
@pytest.mark.parametrize("scenario", ["forward", "held"])
def test_a_motion_waits_for_odometry_that_is_missing_when_it_begins(
    tmp_path: Path, scenario: str
) -> None:
    lost = ("inject", "{odometry_lost: {}, at: 0.8, for: 1.0}")
    outcome = play(tmp_path, f"motion_{scenario}", lost, ("duration", "14"))
    assert outcome.figures.executed == 1
    assert outcome.figures.false_executed == 0


def test_a_motion_does_not_wait_for_ever(tmp_path: Path) -> None:
    lost = ("inject", "{odometry_lost: {}, at: 0.8}")
    outcome = play(tmp_path, "motion_forward", lost, ("duration", "8"))
    (failed,) = (r for r in outcome.record.reports if r.stage is Stage.FAILED)
    assert failed.reason is Reason.ODOMETRY_STALE
    assert outcome.record.time_of(failed) < 3.5
    assert outcome.figures.distance_m < 0.01


def test_a_side_that_sticks_in_a_turn_is_seen_by_the_way_it_lacks(tmp_path: Path) -> None:
    changes = (
        ("settings.sensors.second_odometry", "{rate_hz: 2}"),
        ("inject", "{left_wheels_stuck: {}, at: 1.497}"),
        ("seed", "426297"),
        ("world.friction", "0.6174"),
        ("duration", "5"),
    )
    outcome = play(tmp_path, "motion_goal", *changes, blind=False)
    event = first_event(outcome)
    assert event.reason is Reason.WHEELS_OFF_COMMAND
    assert outcome.record.time_of(event) - 1.497 < 0.6


class ToldBench(Bench):
    """The odometry tells what a test makes of it, in its order.

    Attributes:
        tell: returns what comes of the odometry of now, by the number of the tick.
    """

    def __init__(self, folder: Path, settings: Settings) -> None:
        self.ticks = 0
        self.tell: Callable[[Odometry, int], Sequence[Odometry]] = lambda fact, _: (fact,)
        super().__init__(folder, settings)
        self.odometry = False

    def step(self) -> None:
        self.ticks += 1
        if not self.odometry:
            next_s = self.clock.now_s() + STEP_S
            ahead = deepcopy(self.rover)
            ahead.advance(STEP_S)
            self.rover.facts += self.tell(Odometry(next_s, ahead.pose, ahead.velocity), self.ticks)
        super().step()


def seldom(every: int) -> Callable[[Odometry, int], Sequence[Odometry]]:
    return lambda fact, tick: (fact,) if tick % every == 0 else ()


def late(by: int) -> Callable[[Odometry, int], Sequence[Odometry]]:
    under_way: list[Odometry] = []

    def tell(fact: Odometry, _: int) -> Sequence[Odometry]:
        under_way.append(fact)
        return (under_way.pop(0),) if len(under_way) > by else ()

    return tell


def frozen(fact: Odometry, _: int) -> Sequence[Odometry]:
    return (Odometry(fact.stamp_s, Pose(1.0), Velocity(0.3, 0.0)),)


def not_finite(fact: Odometry, _: int) -> Sequence[Odometry]:
    return (replace(fact, pose=replace(fact.pose, y_m=nan)),)


def shrunk(fact: Odometry, _: int) -> Sequence[Odometry]:
    pose, velocity = fact.pose, fact.velocity
    return (
        Odometry(
            fact.stamp_s,
            replace(pose, x_m=0.2 * pose.x_m),
            Velocity(0.2 * velocity.travel_mps, velocity.rotate_radps),
        ),
    )


@pytest.mark.parametrize(
    ("tell", "reason"),
    [
        (seldom(3), Reason.ODOMETRY_RATE_LOW),
        (seldom(2), None),
        (late(4), Reason.ODOMETRY_LATE),
        (late(2), None),
        (frozen, Reason.ODOMETRY_FROZEN),
        (not_finite, Reason.ODOMETRY_NOT_FINITE),
        (shrunk, Reason.NO_PROGRESS),
        (lambda *_: (), Reason.ODOMETRY_STALE),
    ],
)
def test_an_executive_goes_on_only_by_odometry_that_it_can_steer_by(
    tmp_path: Path, tell: Callable[[Odometry, int], Sequence[Odometry]], reason: Reason | None
) -> None:
    settings = ignoring("off_command", "odometry_off_twist", "odometry_jumped")
    with ToldBench(tmp_path, settings) as bench:
        bench.run(1.0)
        bench.submit(DriveFor(0.5, 0.0, 6.0), 1)
        bench.run(1.0)
        bench.tell = tell
        bench.finish(1)
        assert bench.last(1).reason is reason


@pytest.mark.at_length
@pytest.mark.parametrize("rate_hz", [8.0, None])
def test_a_rover_with_odometry_at_8_hz_executes_its_motion(
    tmp_path: Path, rate_hz: float | None
) -> None:
    settings = replace(load_settings("jackal"), odometry=OdometrySettings(rate_hz))
    with ToldBench(tmp_path, settings) as bench:
        bench.tell = lambda fact, tick: (fact,) if tick % 5 in {0, 2} else ()
        bench.run(4.0)
        bench.submit(DriveFor(0.5, 0.3, 4.0), 1)
        bench.finish(1)
        assert bench.last(1).stage is Stage.EXECUTED
