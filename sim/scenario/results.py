"""Results of several runs: one JSON document, JUnit XML, text lines."""

import json
import shlex
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, BinaryIO

from sim.scenario.changes import Override
from sim.scenario.junit import CaseStatus, JunitCase, JunitSuite, write_junit
from sim.scenario.model import RunMode, Scenario
from sim.scenario.outcome import RunMetrics, ScenarioResult
from sim.scenario.record import Check


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
    def holds(self) -> bool:
        """Whether all findings hold."""
        return all(finding.holds for finding in self.findings)

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
        "holds": not broken and all(run.holds for run in runs),
        "runs": [_plain(run) for run in runs],
        "errors": [{"scenario": each.name, "text": each.text} for each in broken],
    }
    return json.dumps(made, indent=2, ensure_ascii=False)


def write_results(
    file: BinaryIO, runs: Sequence[ScenarioRun], broken: Sequence[ScenarioError]
) -> None:
    """Write JUnit XML: a suite for each run and each error, a case for each finding."""
    suites = [
        JunitSuite(each.name, [JunitCase("play", each.text, CaseStatus.ERROR)]) for each in broken
    ]
    write_junit(file, "rover scenario", [*map(_suite, runs), *suites])


def summary(runs: Sequence[ScenarioRun]) -> str:
    """Return the last line of the text output."""
    findings = [finding for run in runs for finding in run.findings]
    return f"{sum(finding.holds for finding in findings)} of {len(findings)} expectations hold"


def repeats(runs: Sequence[ScenarioRun]) -> list[str]:
    """Return lines with the number of runs that hold, for one scenario with several seeds."""
    seeds = [run.seed for run in runs]
    failing = [run for run in runs if not run.holds]
    holding = f"{len(runs) - len(failing)} of {len(runs)} runs hold"
    lines = [f"{runs[0].name}: {holding}, seeds {seeds[0]} to {seeds[-1]}"]
    for run in failing:
        found = [each for each in run.findings if not each.holds]
        lines.append(f"  {run.command}")
        lines += [f"    {each.subject}: {each.expected}; observed: {each.seen}" for each in found]
    return lines


def _plain(run: ScenarioRun) -> dict[str, Any]:
    return {
        "scenario": run.name,
        "title": run.title,
        "mode": run.mode.name,
        "seed": run.seed,
        "changes": [str(change) for change in run.changes],
        "command": run.command,
        "holds": run.holds,
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
            finding.seen,
            None if finding.holds else CaseStatus.FAILURE,
        )
        for finding in run.findings
    ]
    properties = {"seed": str(run.seed), "command": run.command}
    name = f"{run.name} seed {run.seed}"
    return JunitSuite(name, cases, run.wall_s, properties)
