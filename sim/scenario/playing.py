"""Plays a scenario one way or the other, in a folder of its own, and says what came of it."""

import tempfile
from collections import Counter
from collections.abc import Sequence
from itertools import groupby
from math import degrees
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from executive.commands import Mode
from executive.reports import Kind
from executive.settings import SettingsError
from sim.scenario.expect_rover import STILL_M, STILL_RAD, travel
from sim.scenario.lockstep_run import run_in_lock_step
from sim.scenario.model import PlayMode, Scenario
from sim.scenario.record import Finding, Record, between

BRAKING_S: Final = 1.5
"""After this long in STOPPED or SAFE the rover has come to rest, from whatever speed."""
HELD: Final = frozenset({Mode.STOPPED, Mode.SAFE})


def judge(scenario: Scenario, record: Record) -> list[Finding]:
    """Return a finding for each expectation, then one for each promise.

    Promises are what every run must keep, whatever the file expects: the whole timeline was
    played, every command ends exactly once, reports are numbered without gaps, and the rover
    stands while it is STOPPED or SAFE.
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


def show(
    console: Console, scenario: Scenario, record: Record, findings: Sequence[Finding], verbose: bool
) -> None:
    """Print what came of a scenario; with all reports before, if verbose."""
    console.print(f"[bold]{escape(scenario.title)}[/]")
    if verbose:
        _show_reports(console, record)
    table = Table(box=None, pad_edge=False, header_style="dim")
    for column in ("", "about", "expected", "seen"):
        table.add_column(column, overflow="fold")
    for finding in findings:
        mark = "[green]holds[/]" if finding.holds else "[red]FAILS[/]"
        table.add_row(mark, *map(escape, (finding.subject, finding.expected, finding.seen)))
    console.print(table)
    console.print(
        f"[dim]{record.simulated_s:.1f} s simulated in {record.wall_s:.2f} s:"
        f" {record.simulated_s / record.wall_s:.0f} × real time[/]\n"
    )


def summary(findings: Sequence[Finding]) -> str:
    """Return the last line."""
    return f"{sum(finding.holds for finding in findings)} of {len(findings)} expectations hold"


def _show_reports(console: Console, record: Record) -> None:
    table = Table(box=None, pad_edge=False, header_style="dim")
    table.add_column("time", justify="right")
    for column in ("number", "command", "stage", "text"):
        table.add_column(column, overflow="fold")
    labels = {sent.identity: sent.label for sent in reversed(record.sendings)}
    for report in record.reports:
        label = labels.get(report.identity, str(report.identity)) if report.identity else ""
        table.add_row(
            f"{record.time_of(report):.2f} s",
            str(report.sequence),
            escape(label),
            report.stage.name if report.stage else report.kind.name,
            escape(report.text),
        )
    console.print(table)


class PlayError(Exception):
    """A live run broke down; the text says why."""


def play(
    name: str, scenario: Scenario, mode: PlayMode, speed: float = 1.0
) -> tuple[Record, list[Finding]]:
    """Play a scenario and return what was seen, and what came of each expectation.

    Raises:
        ConnectionError, TimeoutError: the rover of a live run cannot be reached.
        PlayError: a live run broke down otherwise.
        SettingsError: the world cannot be simulated.
    """
    with tempfile.TemporaryDirectory(prefix="rover-scenario-") as folder:
        if mode is PlayMode.LOCK_STEP:
            record = _lock_step(name, scenario, Path(folder))
        else:
            record = _live(name, scenario, Path(folder), mode, speed)
        return record, judge(scenario, record)


def _lock_step(name: str, scenario: Scenario, folder: Path) -> Record:
    try:
        return run_in_lock_step(scenario, folder)
    except SettingsError as error:
        raise SettingsError(f"{name}: {error}") from error


def _live(name: str, scenario: Scenario, folder: Path, mode: PlayMode, speed: float) -> Record:
    from sim.processes import ChildError, PlaceError
    from sim.scenario.live import run_live

    try:
        return run_live(scenario, folder, mode, speed)
    except (ChildError, PlaceError) as error:
        raise PlayError(f"{name}: {error}") from error
