"""`evaluate`: the result of a run from its `Record`: expectations, criteria, figures, a digest."""

import hashlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import groupby
from math import degrees, inf
from pathlib import Path
from typing import Final

from executive.commands import Mode, Request, SetPositionCompensation, is_absolute
from executive.core.recording import RecordingSink
from executive.settings import SettingsError
from executive.values.reasons import Reason
from executive.values.reports import Report, ReportKind, Severity, Stage
from sim.scenario.expect_rover import STILL_M, STILL_RAD, travel
from sim.scenario.lockstep_run import run_in_lock_step
from sim.scenario.model import Scenario
from sim.scenario.record import Check, Record, SentCommand, between
from sim.scenario.truth import check_executed_truth, path_length_m, reported_error, true_ends

DIGITS: Final = 6
"""Decimal digits of seconds: stamps in UTC have no finer ones."""
BRAKING_S: Final = 1.5
"""Time from STOPPED or SAFE until standstill from any speed; chosen, not measured."""
STANDING_S: Final = 0.2
STANDING_M: Final = 0.01
"""Maximum displacement within `STANDING_S` at standstill; chosen, not measured."""
HELD_MODES: Final = frozenset({Mode.STOPPED, Mode.SAFE})


@dataclass(frozen=True, slots=True)
class RunMetrics:
    """Figures of a run; None for those that do not exist.

    Attributes:
        duration_s: time from the first RECEIVED to the last end of a command.
        true_error_m, true_error_rad: maximum true deviation from the commanded pose at EXECUTED.
        distance_m: true distance driven.
        energy_j: energy drawn from the battery.
        detection_s: time from the first fault to the first report or mode that indicates it: a
            command that FAILED, an event of a severity above INFORMATIONAL, or SAFE.
        stopping_m: true distance from the first fault to standstill after its detection.
        contacts: number of new contacts with a rock, a wall or a step.
        executed, failed: numbers of commands that ended so.
        false_executed: number of commands that ended EXECUTED untruly, or without true poses.
        reasons: reasons of the final reports that have one, in their order.
        false_after_fault: number of those that ended after the first fault was reported.
        pose_error_m, pose_error_rad: error of the reported pose when the first absolute motion
            (`moveTo`, `followPath`, `rotateTo`) was sent.
        executed_before_fix, executed_after_fix: share of the absolute motions that ended EXECUTED,
            of those sent before and after the first position compensation.
    """

    duration_s: float | None
    true_error_m: float | None
    true_error_rad: float | None
    distance_m: float
    energy_j: float | None
    detection_s: float | None
    stopping_m: float | None
    contacts: int | None
    executed: int
    failed: int
    false_executed: int
    reasons: tuple[Reason, ...]
    false_after_fault: int = 0
    pose_error_m: float | None = None
    pose_error_rad: float | None = None
    executed_before_fix: float | None = None
    executed_after_fix: float | None = None


@dataclass(frozen=True, slots=True)
class ScenarioResult:
    """Result of one run.

    Attributes:
        passed: whether all findings passed.
        digest: SHA-256 over reports, true poses, telemetry and modes; equal for bit-identical
            runs. It excludes the duration by the wall clock.
        record: complete record of the run.
    """

    passed: bool
    findings: tuple[Check, ...]
    figures: RunMetrics
    digest: str
    record: Record = field(repr=False, compare=False)


def run_once(
    name: str, scenario: Scenario, folder: Path, tape: RecordingSink | None = None
) -> ScenarioResult:
    """Run a scenario in lock step and evaluate it.

    Args:
        name: name of the scenario, for errors.
        scenario: result of `load_scenario` for lock step.
        folder: empty folder for ledger and files.
        tape: records the executive; None for no recording.

    Raises:
        SettingsError: the world cannot be simulated.
    """
    try:
        record = run_in_lock_step(scenario, folder, tape)
    except SettingsError as error:
        raise SettingsError(f"{name}: {error}") from error
    return evaluate(scenario, record)


def evaluate(scenario: Scenario, record: Record) -> ScenarioResult:
    """Return the result of a run of any mode."""
    findings = tuple(judge(scenario, record))
    passed = all(finding.passed for finding in findings)
    return ScenarioResult(passed, findings, figures_of(record), digest_of(record), record)


def judge(scenario: Scenario, record: Record) -> list[Check]:
    """Return a finding for each expectation, then one for each general criterion.

    These criteria apply to every run, regardless of the file: all entries of the timeline were
    executed, every command ends exactly once, reports are numbered without gaps, the rover is
    stationary while STOPPED or SAFE, and commands that ended EXECUTED truly succeeded.
    """
    played = Check(
        "criterion",
        f"all {len(scenario.timeline)} entries of the timeline are executed",
        f"{record.played} were",
        record.played == len(scenario.timeline),
    )
    return [
        *(expected.judge(record) for expected in scenario.expect),
        played,
        _commands_end_once(record),
        _reports_without_gap(record),
        _check_standstill(record),
        check_executed_truth(record, scenario.false_executed),
    ]


def _commands_end_once(record: Record) -> Check:
    """Check that every received command has one terminal report."""
    reports = {(report.sequence, report.identity): report for report in record.reports}.values()
    commands = {report.identity for report in reports if report.identity and report.stage}
    ends = Counter(report.identity for report in reports if report.stage and report.stage.terminal)
    wrong = [f"{command} ends {ends[command]} ×" for command in commands if ends[command] != 1]
    return Check(
        "criterion",
        "every command received ends exactly once",
        ", ".join(sorted(wrong)) or f"{len(commands)} of {len(commands)} do",
        not wrong,
    )


def _reports_without_gap(record: Record) -> Check:
    """Check that the numbers of all reports on the run's link increase by one."""
    by_link = [each.report for each in record.receipts if each.link == record.main_link]
    reports = by_link or record.reports
    numbers = sorted({report.sequence for report in reports if report.kind is not ReportKind.LINK})
    missing = sorted(set(range(numbers[0], numbers[-1])) - set(numbers)) if numbers else []
    return Check(
        "criterion",
        "reports are numbered without gaps",
        f"missing {', '.join(map(str, missing))}" if missing else f"{len(numbers)} reports",
        not missing,
    )


def _check_standstill(record: Record) -> Check:
    """Check that the rover is stationary while STOPPED or SAFE."""
    worst_m = worst_rad = 0.0
    for held, seen in groupby(record.modes, key=lambda seen: seen.mode in HELD_MODES):
        if held:
            times = [each.time_s for each in seen]
            away_m, turned_rad = travel(between(record.poses, times[0] + BRAKING_S, times[-1]))
            worst_m, worst_rad = max(worst_m, away_m), max(worst_rad, turned_rad)
    return Check(
        "criterion",
        "no motion while STOPPED or SAFE",
        f"went {worst_m:.3f} m, turned {degrees(worst_rad):.1f}°",
        worst_m <= STILL_M and worst_rad <= STILL_RAD,
    )


def figures_of(record: Record) -> RunMetrics:
    """Return the figures of a run."""
    histories = record.all_lifecycles().values()
    ends = [entry.end for entry in histories if entry.end is not None]
    begun_s = [record.time_of(entry.stages[0]) for entry in histories]
    ended_s = [record.time_of(end) for end in ends]
    true = true_ends(record)
    began_s, detection_s = _began_s(record), _detection_s(record)
    reported_s = inf if began_s is None or detection_s is None else began_s + detection_s
    sent = [(each, _request_of(record, each)) for each in record.sendings]
    # an error of the reported pose displaces them
    absolute = [each for each, request in sent if request is not None and is_absolute(request)]
    fixes_s = [each.time_s for each, of in sent if isinstance(of, SetPositionCompensation)]
    fixed_s = min(fixes_s, default=inf)
    error_m, error_rad = reported_error(record, absolute[0].time_s) if absolute else (None, None)
    return RunMetrics(
        duration_s=round(max(ended_s) - min(begun_s), DIGITS) if ended_s else None,
        true_error_m=max((end.off_m for end in true if end.off_m is not None), default=None),
        true_error_rad=max((end.off_rad for end in true if end.off_rad is not None), default=None),
        distance_m=path_length_m(record.poses),
        energy_j=record.energy_j,
        detection_s=detection_s,
        stopping_m=_stopping_m(record),
        contacts=record.contacts,
        executed=sum(end.stage is Stage.EXECUTED for end in ends),
        failed=sum(end.stage is Stage.FAILED for end in ends),
        false_executed=sum(bool(end.wrong) for end in true),
        reasons=tuple(end.reason for end in ends if isinstance(end.reason, Reason)),
        false_after_fault=sum(bool(end.wrong) and end.end_s >= reported_s for end in true),
        pose_error_m=error_m,
        pose_error_rad=error_rad,
        executed_before_fix=_executed(record, [s for s in absolute if s.time_s < fixed_s]),
        executed_after_fix=_executed(record, [s for s in absolute if s.time_s >= fixed_s]),
    )


def _request_of(record: Record, sent: SentCommand) -> Request | None:
    """Return the request of a command; None if it was not received."""
    requests = (each.request for each in record.requested if each.identity == sent.identity)
    return next(requests, None)


def _executed(record: Record, sent: Sequence[SentCommand]) -> float | None:
    """Return the share of commands that ended EXECUTED; None without commands."""
    lifecycles = [record.reports_of(each.label) for each in sent]
    done = [any(report.stage is Stage.EXECUTED for report in reports) for reports in lifecycles]
    return sum(done) / len(done) if done else None


def digest_of(record: Record) -> str:
    """Return the SHA-256 over reports, poses, values and modes in hexadecimal digits."""
    seen = (record.reports, record.poses, record.values, record.modes)
    return hashlib.sha256(repr(seen).encode()).hexdigest()


def _began_s(record: Record) -> float | None:
    return min((fault.time_s for fault in record.faults if fault.begins), default=None)


def _stopping_m(record: Record) -> float | None:
    began_s, detection_s = _began_s(record), _detection_s(record)
    if began_s is None or detection_s is None:
        return None
    poses = between(record.poses, began_s, inf)
    for index, seen in enumerate(poses):
        if seen.time_s < began_s + detection_s:
            continue
        away_m, turned_rad = travel(between(poses[index:], seen.time_s, seen.time_s + STANDING_S))
        if away_m <= STANDING_M and turned_rad <= STILL_RAD:
            return path_length_m(poses[: index + 1])
    return None


def _detection_s(record: Record) -> float | None:
    began_s = _began_s(record)
    if began_s is None:
        return None
    reported_s = [record.time_of(report) for report in record.reports if _is_fault_report(report)]
    reported_s += [seen.time_s for seen in record.modes if seen.mode is Mode.SAFE]
    after_s = (time_s - began_s for time_s in reported_s if time_s >= began_s)
    return min((round(time_s, DIGITS) for time_s in after_s), default=None)


def _is_fault_report(report: Report) -> bool:
    if report.kind is ReportKind.COMMAND:
        return report.stage is Stage.FAILED and report.reason is not Reason.INTERRUPTED
    worrying = report.severity is not Severity.INFORMATIONAL
    return report.kind is ReportKind.EVENT and worrying and report.reason is not Reason.DUPLICATE
