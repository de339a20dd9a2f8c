"""Runs a scenario in lock step or live, in a folder of its own; `show` prints the result."""

import tempfile
from contextlib import closing
from itertools import chain, count
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from sim.scenario.model import RunMode, Scenario
from sim.scenario.outcome import ScenarioResult, evaluate, run_once
from sim.scenario.record import Record

DATA: Final = "data"
"""Subfolder of a run's folder for the files aboard and the logs of the processes."""
RECORDING: Final = "run.mcap"
PLOT: Final = "plot.png"


def show(console: Console, scenario: Scenario, outcome: ScenarioResult, verbose: bool) -> None:
    """Print the result of a scenario; if verbose, after all its reports."""
    record = outcome.record
    console.print(f"[bold]{escape(scenario.title)}[/]")
    if verbose:
        _show_reports(console, record)
    table = Table(box=None, pad_edge=False, header_style="dim")
    for column in ("", "subject", "expected", "observed"):
        table.add_column(column, overflow="fold")
    for finding in outcome.findings:
        mark = "[green]passed[/]" if finding.passed else "[red]FAILED[/]"
        table.add_row(mark, *map(escape, (finding.subject, finding.expected, finding.observed)))
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
    """A live run failed before its end; the text gives the reason."""


def run_scenario(
    name: str, scenario: Scenario, mode: RunMode, speed: float = 1.0, out: Path | None = None
) -> ScenarioResult:
    """Run a scenario and return its result.

    Args:
        name: name of the scenario.
        scenario: scenario to run.
        mode: lock step, or link of a live run.
        speed: simulated seconds per second of a live run.
        out: parent of the run's folder, which has map, timeline, reports, the files aboard and,
            in lock step, the recording; None for a temporary folder.

    Raises:
        ConnectionError, TimeoutError: the rover of a live run cannot be reached.
        RunError: a live run failed otherwise.
        SettingsError: the world cannot be simulated.
    """
    if out is None:
        with tempfile.TemporaryDirectory(prefix="rover-scenario-") as folder:
            return _play(name, scenario, mode, speed, Path(folder))
    from sim.scenario.pictures import write_run

    run_folder = _new_folder(out, Path(name).stem)
    if mode is RunMode.LOCK_STEP:
        outcome = run_recorded(name, scenario, run_folder)
    else:
        outcome = _play(name, scenario, mode, speed, run_folder / DATA)
    write_run(run_folder, scenario, outcome.record)
    return outcome


def run_recorded(name: str, scenario: Scenario, saved: Path) -> ScenarioResult:
    """Run a scenario in lock step, as `run_once` does, and write its recording and plot.

    Args:
        name: name of the scenario, for errors.
        scenario: result of `load_scenario` for lock step.
        saved: folder of the run, with an empty subfolder `DATA`.

    Raises:
        SettingsError: the world cannot be simulated.
    """
    from adapters.recording import RunFile
    from sim.drawing import write_plot

    with closing(RunFile(saved / RECORDING)) as tape:
        outcome = run_once(name, scenario, saved / DATA, tape)
    write_plot(saved / RECORDING, saved / PLOT)
    return outcome


def _new_folder(out: Path, name: str) -> Path:
    """Create and return a folder for a run, numbered if the name is in use."""
    numbered = (f"{name}-{number}" for number in count(2))
    folder = next(out / each for each in chain([name], numbered) if not (out / each).exists())
    (folder / DATA).mkdir(parents=True)
    return folder


def _play(
    name: str, scenario: Scenario, mode: RunMode, speed: float, folder: Path
) -> ScenarioResult:
    if mode is RunMode.LOCK_STEP:
        return run_once(name, scenario, folder)
    return evaluate(scenario, _live(name, scenario, folder, mode, speed))


def _live(name: str, scenario: Scenario, folder: Path, mode: RunMode, speed: float) -> Record:
    from sim.processes import AddressError, ChildError
    from sim.scenario.live import run_live

    try:
        return run_live(scenario, folder, mode, speed)
    except (ChildError, AddressError) as error:
        raise RunError(f"{name}: {error}") from error
