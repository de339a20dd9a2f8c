"""Plays a scenario one way or the other, in a folder of its own, and says what came of it."""

import tempfile
from contextlib import closing
from itertools import chain, count
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from sim.scenario.model import RunMode, Scenario
from sim.scenario.outcome import ScenarioResult, outcome_of, play_once
from sim.scenario.record import Record

DATA: Final = "data"
"""What a run leaves aboard, and what its processes logged, below the folder that is kept of it."""
RECORDING: Final = "run.mcap"
PLOT: Final = "plot.png"


def show(console: Console, scenario: Scenario, outcome: ScenarioResult, verbose: bool) -> None:
    """Print what came of a scenario; with all reports before, if verbose."""
    record = outcome.record
    console.print(f"[bold]{escape(scenario.title)}[/]")
    if verbose:
        _show_reports(console, record)
    table = Table(box=None, pad_edge=False, header_style="dim")
    for column in ("", "about", "expected", "seen"):
        table.add_column(column, overflow="fold")
    for finding in outcome.findings:
        mark = "[green]holds[/]" if finding.holds else "[red]FAILS[/]"
        table.add_row(mark, *map(escape, (finding.subject, finding.expected, finding.seen)))
    console.print(table)
    console.print(
        f"[dim]{record.simulated_s:.1f} s simulated in {record.wall_s:.2f} s:"
        f" {record.simulated_s / record.wall_s:.0f} × real time[/]\n"
    )


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


class RunError(Exception):
    """A live run broke down; the text says why."""


def play(
    name: str, scenario: Scenario, mode: RunMode, speed: float = 1.0, out: Path | None = None
) -> ScenarioResult:
    """Play a scenario and return what came of it.

    Args:
        name: of the scenario.
        scenario: to play.
        mode: how.
        speed: simulated seconds per second of a live run.
        out: below which the run gets a folder of its own, with map, timeline, reports, all that
            it left aboard and, of a run in lock step, the recording; None keeps nothing.

    Raises:
        ConnectionError, TimeoutError: the rover of a live run cannot be reached.
        PlayError: a live run broke down otherwise.
        SettingsError: the world cannot be simulated.
    """
    if out is None:
        with tempfile.TemporaryDirectory(prefix="rover-scenario-") as folder:
            return _play(name, scenario, mode, speed, Path(folder))
    from sim.scenario.pictures import write_run

    kept = _new_folder(out, Path(name).stem)
    if mode is RunMode.LOCK_STEP:
        outcome = play_recorded(name, scenario, kept)
    else:
        outcome = _play(name, scenario, mode, speed, kept / DATA)
    write_run(kept, scenario, outcome.record)
    return outcome


def play_recorded(name: str, scenario: Scenario, kept: Path) -> ScenarioResult:
    """Play a scenario in lock step, as `play_once` does, and keep its recording and plot.

    Args:
        name: of the scenario, for errors.
        scenario: that `load_scenario` read for the lock step.
        kept: the folder; in it the empty one that it leaves aboard in.

    Raises:
        SettingsError: the world cannot be simulated.
    """
    from adapters.recording import RunFile
    from sim.plot import write_plot

    with closing(RunFile(kept / RECORDING)) as tape:
        outcome = play_once(name, scenario, kept / DATA, tape)
    write_plot(kept / RECORDING, kept / PLOT)
    return outcome


def _new_folder(out: Path, name: str) -> Path:
    """Make and return a folder for a run, with a number where the name is taken."""
    numbered = (f"{name}-{number}" for number in count(2))
    folder = next(out / each for each in chain([name], numbered) if not (out / each).exists())
    (folder / DATA).mkdir(parents=True)
    return folder


def _play(
    name: str, scenario: Scenario, mode: RunMode, speed: float, folder: Path
) -> ScenarioResult:
    if mode is RunMode.LOCK_STEP:
        return play_once(name, scenario, folder)
    return outcome_of(scenario, _live(name, scenario, folder, mode, speed))


def _live(name: str, scenario: Scenario, folder: Path, mode: RunMode, speed: float) -> Record:
    from sim.processes import AddressError, ChildError
    from sim.scenario.live import run_live

    try:
        return run_live(scenario, folder, mode, speed)
    except (ChildError, AddressError) as error:
        raise RunError(f"{name}: {error}") from error
