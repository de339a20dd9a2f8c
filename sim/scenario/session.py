"""`ScenarioBatch` runs the scenarios of a command line, each as often as requested.

Results are text lines, one JSON document and JUnit XML.
"""

import json
import shlex
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO, Final

import click
from rich.console import Console

from executive.settings import SettingsError, names_in
from sim.scenario.changes import Override
from sim.scenario.junit import CaseStatus, JunitCase, JunitSuite, write_junit
from sim.scenario.model import RunMode, Scenario
from sim.scenario.outcome import RunMetrics, ScenarioResult
from sim.scenario.reading import load_scenario, scenario_folder
from sim.scenario.record import Check
from sim.scenario.run import RunError, run_scenario, show

FAILED: Final = 1
BAD_FILE: Final = 2
UNREACHABLE: Final = 3


@dataclass(frozen=True, slots=True)
class ScenarioRun:
    """Result of a run without its record.

    Attributes:
        name: name given by the user.
        changes: overrides of the file, without the seed.
        digest: None for a live run, which is not repeatable bit for bit.
        simulated_s, wall_s: duration in simulated and in wall-clock time.
    """

    name: str
    title: str
    mode: RunMode
    seed: int
    changes: tuple[Override, ...]
    findings: tuple[Check, ...]
    figures: RunMetrics
    digest: str | None
    simulated_s: float
    wall_s: float

    @classmethod
    def of(
        cls,
        name: str,
        scenario: Scenario,
        mode: RunMode,
        changes: tuple[Override, ...],
        outcome: ScenarioResult,
    ) -> "ScenarioRun":
        """Return the run of a scenario with its result, without the large record."""
        return cls(
            name,
            scenario.title,
            mode,
            scenario.seed,
            changes,
            outcome.findings,
            outcome.figures,
            outcome.digest if mode is RunMode.LOCK_STEP else None,
            outcome.record.simulated_s,
            outcome.record.wall_s,
        )

    @property
    def passed(self) -> bool:
        """Whether all findings passed."""
        return all(finding.passed for finding in self.findings)

    @property
    def command(self) -> str:
        """Command line that repeats the run, in lock step bit for bit."""
        arguments = ["rover", "scenario", self.name]
        for change in self.changes:
            arguments += ["--set", str(change)]
        arguments += ["--seed", str(self.seed)]
        match self.mode:
            case RunMode.DIRECT:
                arguments += ["--live"]
            case RunMode.RELAY:
                arguments += ["--live", "--link", "relay"]
            case _:
                pass
        return shlex.join(arguments)


@dataclass(frozen=True, slots=True)
class ScenarioError:
    """A scenario that could not be run, with the reason."""

    name: str
    text: str


def document(runs: Sequence[ScenarioRun], broken: Sequence[ScenarioError]) -> str:
    """Return the JSON document of `--json`; values are SI, with units in the names."""
    made = {
        "passed": not broken and all(run.passed for run in runs),
        "runs": [_plain(run) for run in runs],
        "errors": [{"scenario": each.name, "text": each.text} for each in broken],
    }
    return json.dumps(made, indent=2, ensure_ascii=False)


def write_results(
    file: BinaryIO, runs: Sequence[ScenarioRun], broken: Sequence[ScenarioError]
) -> None:
    """Write JUnit XML: a suite for each run and each error, a case for each finding."""
    suites = [
        JunitSuite(each.name, [JunitCase("run", each.text, CaseStatus.ERROR)]) for each in broken
    ]
    write_junit(file, "rover scenario", [*map(_suite, runs), *suites])


def summary(runs: Sequence[ScenarioRun]) -> str:
    """Return the last line of the text output."""
    findings = [finding for run in runs for finding in run.findings]
    return f"{sum(finding.passed for finding in findings)} of {len(findings)} expectations are met"


def repeats(runs: Sequence[ScenarioRun]) -> list[str]:
    """Return lines with the number of runs that passed, for one scenario with several seeds."""
    seeds = [run.seed for run in runs]
    failing = [run for run in runs if not run.passed]
    passing = f"{len(runs) - len(failing)} of {len(runs)} runs passed"
    lines = [f"{runs[0].name}: {passing}, seeds {seeds[0]} to {seeds[-1]}"]
    for run in failing:
        found = [each for each in run.findings if not each.passed]
        lines.append(f"  {run.command}")
        lines += [
            f"    {each.subject}: {each.expected}; observed: {each.observed}" for each in found
        ]
    return lines


def _plain(run: ScenarioRun) -> dict[str, Any]:
    return {
        "scenario": run.name,
        "title": run.title,
        "mode": run.mode.name,
        "seed": run.seed,
        "changes": [str(change) for change in run.changes],
        "command": run.command,
        "passed": run.passed,
        "findings": [asdict(finding) for finding in run.findings],
        "figures": asdict(run.figures) | {"reasons": [each.name for each in run.figures.reasons]},
        "digest": run.digest,
        "simulated_s": round(run.simulated_s, 3),
        "wall_s": round(run.wall_s, 3),
    }


def _suite(run: ScenarioRun) -> JunitSuite:
    cases = [
        JunitCase(
            f"{finding.subject}: {finding.expected}",
            finding.observed,
            None if finding.passed else CaseStatus.FAILURE,
        )
        for finding in run.findings
    ]
    properties = {"seed": str(run.seed), "command": run.command}
    name = f"{run.name} seed {run.seed}"
    return JunitSuite(name, cases, run.wall_s, properties)


class ScenarioBatch:
    """Scenarios of one call of `rover scenario`.

    Args:
        seed: seed of the first run; None for the file's.
        repeat: number of runs of each scenario, each with the next seed.
        out: parent of the runs' folders; None for temporary folders.

    Attributes:
        status: exit status: 0, or the first that applies of 2, a file cannot be used; 3, a
            rover could not be reached; 1, an expectation is not met.
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
        failed = {FAILED for run in self._runs if not run.passed}
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
