"""The faults that may explain a recording, the best first."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from executive.settings import load_settings
from executive.values.geometry import Pose
from sim.fork.hypotheses import EXPLAINED, possible_faults, rank, score
from sim.fork.model import AddedFault, Change, CommandOutcome, ForkOutcome, ForkRun
from sim.rover.faults import EncoderDead, LaserDead, LinkLost, OdometryDrift, Side
from sim.scenario.record import Record, TruePose

JACKAL = load_settings("jackal")


def run(stage: str, reason: str = "", end_s: float = 6.0, drift_from_s: float = 99.0) -> ForkRun:
    """Return a run along x at 1 m/s; its odometry drifts to the left at 0.3 m/s from a time."""
    command = CommandOutcome("MOE:1", "moveForward", stage, reason, "", end_s, None)
    outcome = ForkOutcome(
        at_s=None, placing=None, seed=None, end_s=7.0, commands=(command,), pose=None, contacts=0
    )
    times_s = [tick / 20 for tick in range(140)]
    odometry = tuple(TruePose(t, Pose(t, 0.3 * max(0.0, t - drift_from_s))) for t in times_s)
    return ForkRun(outcome, Record(0.0, Path()), odometry)


RECORDED = run("FAILED", "ODOMETRY_INCONSISTENT", 3.0, drift_from_s=2.5)
UNCHANGED = run("EXECUTED")


def test_each_fault_that_the_rover_can_have_is_tried_with_each_side() -> None:
    faults = [*possible_faults(JACKAL)]
    assert {each.side for each in faults if isinstance(each, EncoderDead)} == {*Side}
    assert not [each for each in faults if isinstance(each, LaserDead | LinkLost)]
    assert len(faults) == len({repr(each) for each in faults}) > 30


def test_the_score_counts_outcome_reason_end_and_odometry() -> None:
    assert score(RECORDED, RECORDED) == 0.0
    assert score(RECORDED, run("FAILED", "ODOMETRY_INCONSISTENT", 3.25, 2.5)) == pytest.approx(0.5)
    assert score(RECORDED, run("FAILED", "OFF_COMMAND", 3.0, 2.5)) == pytest.approx(2.0)
    assert score(RECORDED, UNCHANGED) > EXPLAINED
    near, far = (run("FAILED", "ODOMETRY_INCONSISTENT", 3.0, since_s) for since_s in (2.6, 4.0))
    assert 0.0 < score(RECORDED, near) < score(RECORDED, far)


def test_a_command_that_the_fork_lacks_counts_as_another_stage() -> None:
    nothing = replace(RECORDED, outcome=replace(RECORDED.outcome, commands=()))
    assert score(RECORDED, nothing) == pytest.approx(4.0)


def test_the_best_faults_are_refined_by_their_begin_and_their_figures() -> None:
    tried: list[AddedFault] = []

    def scores(changes: Sequence[Change], at_s: float) -> list[float]:
        faults = [fault for change in changes for fault in change.faults]
        assert all(at_s <= each.begin_s <= 2.65 for each in faults)  # where the odometry departs
        tried.extend(faults)
        return [distance(each) for each in faults]

    def distance(tried: AddedFault) -> float:
        drift = tried.fault.rate_mps if isinstance(tried.fault, OdometryDrift) else 9.0
        return abs(drift - 0.17) + abs(tried.begin_s - 2.4)

    ranked = rank(RECORDED, UNCHANGED, JACKAL, scores)
    assert ranked == sorted(ranked, key=lambda each: each.score)
    assert len(tried) == len({repr(each) for each in tried})
    assert len(ranked) == len({type(each.fault) for each in tried})  # one of each kind
    best = ranked[0].fault.fault
    assert isinstance(best, OdometryDrift)
    assert best.rate_mps == pytest.approx(0.17)
    assert ranked[0].fault.begin_s == pytest.approx(2.4, abs=0.1)
    assert str(ranked[0]).startswith("odometry_drift, rate 0.17, from 2.4")


def test_equal_odometry_puts_the_fault_to_the_end_of_the_command() -> None:
    recorded = run("FAILED", "BATTERY_LOW", 3.0)
    ranked = rank(recorded, UNCHANGED, JACKAL, lambda changes, _: [1.0] * len(changes))
    begins_s = {each.fault.begin_s for each in ranked}
    assert 2.8 in begins_s
