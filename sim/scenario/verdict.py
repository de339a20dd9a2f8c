"""What came of a run, by its record alone: each expectation, and the promises of every run."""

from collections import Counter
from itertools import groupby
from math import degrees
from typing import Final

from executive.commands import Mode
from executive.reports import Kind
from sim.scenario.expect_rover import STILL_M, STILL_RAD, travel
from sim.scenario.model import Scenario
from sim.scenario.record import Finding, Record, between
from sim.scenario.truth import what_was_executed_is_true

BRAKING_S: Final = 1.5
"""After this long in STOPPED or SAFE the rover has come to rest, from whatever speed."""
HELD: Final = frozenset({Mode.STOPPED, Mode.SAFE})


def judge(scenario: Scenario, record: Record) -> list[Finding]:
    """Return a finding for each expectation, then one for each promise.

    Promises are what every run must keep, whatever the file expects: the whole timeline was
    played, every command ends exactly once, reports are numbered without gaps, the rover
    stands while it is STOPPED or SAFE, and what ended EXECUTED is true.
    """
    played = Finding(
        "promise",
        f"all {len(scenario.timeline)} entries of the timeline are played",
        f"{record.played} were",
        record.played == len(scenario.timeline),
    )
    return [
        *(expected.judge(record) for expected in scenario.expect),
        played,
        _commands_end_once(record),
        _reports_without_gap(record),
        _stands_while_held(record),
        what_was_executed_is_true(record, scenario.false_executed),
    ]


def _commands_end_once(record: Record) -> Finding:
    """Hold every command that was received to one terminal report."""
    reports = {report.sequence: report for report in record.reports}.values()
    lives = {report.identity for report in reports if report.identity}
    ends = Counter(report.identity for report in reports if report.stage and report.stage.terminal)
    wrong = [f"{life} ends {ends[life]} ×" for life in lives if ends[life] != 1]
    return Finding(
        "promise",
        "every command received ends exactly once",
        ", ".join(sorted(wrong)) or f"{len(lives)} of {len(lives)} do",
        not wrong,
    )


def _reports_without_gap(record: Record) -> Finding:
    """Hold the numbers of all reports to one more each."""
    numbers = sorted({r.sequence for r in record.reports if r.kind is not Kind.LINK})
    missing = sorted(set(range(numbers[0], numbers[-1])) - set(numbers)) if numbers else []
    return Finding(
        "promise",
        "reports are numbered without gaps",
        f"missing {', '.join(map(str, missing))}" if missing else f"{len(numbers)} reports",
        not missing,
    )


def _stands_while_held(record: Record) -> Finding:
    """Hold the rover to stand while it is STOPPED or SAFE."""
    worst_m = worst_rad = 0.0
    for held, seen in groupby(record.modes, key=lambda seen: seen.mode in HELD):
        if held:
            times = [each.time_s for each in seen]
            away_m, turned_rad = travel(between(record.poses, times[0] + BRAKING_S, times[-1]))
            worst_m, worst_rad = max(worst_m, away_m), max(worst_rad, turned_rad)
    return Finding(
        "promise",
        "no motion while STOPPED or SAFE",
        f"went {worst_m:.3f} m, turned {degrees(worst_rad):.1f}°",
        worst_m <= STILL_M and worst_rad <= STILL_RAD,
    )
