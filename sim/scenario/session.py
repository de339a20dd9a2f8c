"""Runs the scenarios of a command line, each as often as requested, and collects the results."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO, Final

import click
from rich.console import Console

from executive.settings import SettingsError, names_in
from sim.scenario.changes import Override
from sim.scenario.model import RunMode, Scenario
from sim.scenario.reading import load_scenario, scenario_folder
from sim.scenario.results import (
    ScenarioError,
    ScenarioRun,
    document,
    repeats,
    summary,
    write_results,
)
from sim.scenario.run import RunError, run_scenario, show

FAILED: Final = 1
BAD_FILE: Final = 2
UNREACHABLE: Final = 3


class ScenarioBatch:
    """Scenarios of one call of `rover scenario`.

    Args:
        seed: seed of the first run; None for the file's.
        repeat: number of runs of each scenario, each with the next seed.
        out: parent of the runs' folders; None for temporary folders.

    Attributes:
        status: exit status: 0, or the first that applies of 2, a file cannot be used; 3, a
            rover could not be reached; 1, an expectation does not hold.
    """

    def __init__(
        self,
        console: Console,
        mode: RunMode,
        speed: float,
        seed: int | None,
        changes: Sequence[Override],
        repeat: int,
        verbose: bool,
        out: Path | None,
    ) -> None:
        self._console, self._mode, self._speed = console, mode, speed
        self._seed, self._changes, self._repeat = seed, tuple(changes), repeat
        self._verbose, self._out = verbose, out
        self._usable: list[tuple[str, Scenario]] = []
        self._runs: list[ScenarioRun] = []
        self._broken: list[ScenarioError] = []
        self._troubles: set[int] = set()

    @property
    def status(self) -> int:
        """Exit status."""
        failed = {FAILED for run in self._runs if not run.holds}
        troubles = self._troubles | failed
        return next((each for each in (BAD_FILE, UNREACHABLE, FAILED) if each in troubles), 0)

    def read(self, name: str) -> None:
        """Read a scenario; print an error if it cannot be used, and continue with the others."""
        try:
            scenario = load_scenario(name, self._mode, self._changes)
        except SettingsError as error:
            self._break(name, str(error), BAD_FILE)
            return
        if self._seed is not None:
            scenario = replace(scenario, seed=self._seed)
        self._usable.append((name, scenario))

    def play(self) -> None:
        """Run the scenarios that were read, and print the results."""
        for name, scenario in self._usable:
            runs = []
            for seed in range(scenario.seed, scenario.seed + self._repeat):
                run = self._play(name, replace(scenario, seed=seed))
                if run is None:
                    break
                runs.append(run)
            self._runs += runs
            if runs and self._repeat > 1:
                self._print(repeats(runs))
        if self._runs and self._repeat == 1:
            self._print([summary(self._runs)])
        if self._runs and self._out is not None:
            self._print([f"maps, timelines, reports and ledgers are in {self._out}"])

    def document(self) -> str:
        """Return all results as one JSON document."""
        return document(self._runs, self._broken)

    def write_junit(self, file: BinaryIO) -> None:
        """Write all results as JUnit XML."""
        write_results(file, self._runs, self._broken)

    def _play(self, name: str, scenario: Scenario) -> ScenarioRun | None:
        out = self._out
        if out is not None and self._repeat > 1:
            out /= f"seed-{scenario.seed}"
        try:
            outcome = run_scenario(name, scenario, self._mode, self._speed, out)
        except SettingsError as error:
            self._break(name, str(error), BAD_FILE)
            return None
        except RunError as error:
            self._break(name, str(error), FAILED)
            return None
        except (ConnectionError, TimeoutError) as error:
            self._break(name, f"{name}: cannot reach the rover: {error}", UNREACHABLE)
            return None
        if self._repeat == 1 or self._verbose:
            show(self._console, scenario, outcome, self._verbose)
        return ScenarioRun.of(name, scenario, self._mode, self._changes, outcome)

    def _break(self, name: str, text: str, trouble: int) -> None:
        click.echo(f"Error: {text}", err=True)
        self._broken.append(ScenarioError(name, text))
        self._troubles.add(trouble)

    def _print(self, lines: Sequence[str]) -> None:
        if not self._console.quiet:
            click.echo("\n".join(lines))


def list_scenarios(console: Console) -> int:
    """Print name and title of each scenario in config/scenarios; return the exit status."""
    status = 0
    for name in names_in(scenario_folder()):
        try:
            console.print(f"{name:<24}{load_scenario(name).title}", markup=False)
        except SettingsError as error:
            click.echo(f"Error: {error}", err=True)
            status = BAD_FILE
    return status
