"""Groups the failed runs of a campaign by equal failure, and repeats the runs that are shown."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from shutil import copytree
from typing import Final

from executive.settings import SettingsError
from sim.campaign.draws import draw
from sim.campaign.model import Campaign
from sim.campaign.runs import CampaignRun, RunTable
from sim.campaign.session import folder_of, is_saved
from sim.campaign.worker import ERROR
from sim.scenario.model import RunMode
from sim.scenario.pictures import write_run
from sim.scenario.reading import load_scenario
from sim.scenario.run import DATA, run_recorded

FOLDER: Final = "worst"
"""Subfolder of a campaign with a folder for each run that the report shows."""
_EXTREMES: Final = {
    "true_error_m": "the maximum true error",
    "detection_s": "the slowest detection of a fault",
    "duration_s": "the maximum duration",
}


@dataclass(frozen=True, slots=True)
class FailureGroup:
    """Runs with the same failure.

    Attributes:
        expected: the first failed expectation.
        reasons: distinct reasons of commands that did not end EXECUTED.
        runs: number of runs.
        example: the first of them.
    """

    scenario: str
    expected: str
    reasons: str
    runs: int
    example: CampaignRun


@dataclass(frozen=True, slots=True)
class WorstRun:
    """A run that the report shows.

    Attributes:
        why: reason for its selection.
        folder: its map, timeline, reports and ledger, below the folder of the campaign.
        drawn: whether map, timeline and reports are in that folder.
        trouble: difference from the campaign as text; else empty.
    """

    run: CampaignRun
    why: str
    folder: Path
    drawn: bool
    trouble: str


def failure_groups(runs: RunTable) -> list[FailureGroup]:
    """Return the groups of failed runs, in descending order of size."""
    all_runs = runs.frame("passed", "scenario", "failed_findings", "reasons")
    failed = all_runs[~all_runs["passed"]].astype(object)
    first = failed["failed_findings"].map(_expected)
    named = failed["reasons"].map(lambda names: ", ".join(dict.fromkeys(names)))
    groups = failed.index.to_series().groupby([failed["scenario"], first, named], sort=False)
    counted = groups.agg(["size", "first"]).sort_values("size", ascending=False, kind="stable")
    examples = {run.run: run for run in runs.at(counted["first"])}
    return [
        FailureGroup(scenario, expected, reasons, many, examples[run])
        for (scenario, expected, reasons), (many, run) in counted.iterrows()
    ]


def _expected(failed_findings: Sequence[str]) -> str:
    return next(iter(failed_findings), "").partition(", observed ")[0]


def select_runs(
    runs: RunTable, groups: Sequence[FailureGroup], maximum: int
) -> list[tuple[CampaignRun, str]]:
    """Return the runs to show with the reason: one of each kind of failure, then the extremes."""
    chosen = {
        group.example.run: (
            group.example,
            "the only run with this failure"
            if group.runs == 1
            else f"the first of {group.runs} runs with this failure",
        )
        for group in groups[:maximum]
    }
    for figure, why in _EXTREMES.items():
        seen = runs.frame(figure)[figure].dropna()
        if len(seen) and len(chosen) < maximum and (number := seen.idxmax()) not in chosen:
            (run,) = runs.at([number])
            chosen[number] = (run, why)
    return list(chosen.values())


def replay(
    campaign: Campaign, chosen: Sequence[tuple[CampaignRun, str]], folder: Path
) -> Iterator[WorstRun]:
    """Repeat runs, bit for bit as in the campaign, and save their files.

    Saved files of a failed run are copied.

    Args:
        campaign: campaign of the runs.
        chosen: the runs, each with the reason.
        folder: folder of the campaign.
    """
    for run, why in chosen:
        target = folder / FOLDER / f"run-{run.run:06d}"
        saved = folder_of(folder, run.run)
        if is_saved(folder, run) and not (saved / ERROR).exists():
            copytree(saved, target)
            yield WorstRun(run, why, target, True, "")
            continue
        given = draw(campaign, run.run)
        try:
            scenario = load_scenario(given.scenario, RunMode.LOCK_STEP, given.changes)
            (target / DATA).mkdir(parents=True)
            outcome = run_recorded(given.scenario, scenario, target)
        except SettingsError as error:
            yield WorstRun(run, why, target, False, f"It cannot be executed here: {error}")
            continue
        except Exception as error:
            yield WorstRun(run, why, target, False, f"It ended with {error!r}.")
            continue
        write_run(target, scenario, outcome.record)
        alike = outcome.digest == run.digest
        trouble = "" if alike else "Its repetition here was not identical bit for bit."
        yield WorstRun(run, why, target, True, trouble)
