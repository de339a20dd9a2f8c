"""Which runs failed alike, and which runs of a campaign are worth a look, played once more."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from shutil import copytree
from typing import Final

from executive.settings import SettingsError
from sim.campaign.draws import draw
from sim.campaign.model import Campaign
from sim.campaign.runs import CampaignRun, RunTable
from sim.campaign.session import folder_of, is_kept
from sim.campaign.worker import ERROR
from sim.scenario.model import RunMode
from sim.scenario.pictures import write_run
from sim.scenario.playing import DATA, play_recorded
from sim.scenario.reading import load_scenario

FOLDER: Final = "worst"
"""Below the folder of a campaign: a folder for each run that the report shows."""
_EXTREMES: Final = {
    "true_error_m": "the greatest true error",
    "detection_s": "the slowest detection of a fault",
    "duration_s": "the longest duration",
}


@dataclass(frozen=True, slots=True)
class FailureGroup:
    """Runs that failed alike.

    Attributes:
        expected: the first expectation that did not hold.
        reasons: of commands that did not end EXECUTED, each once.
        runs: how many there are.
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
        why: it is shown.
        folder: its map, timeline, reports and ledger, below the folder of the campaign.
        drawn: whether map, timeline and reports are in that folder.
        trouble: what was not as in the campaign, in words; else empty.
    """

    run: CampaignRun
    why: str
    folder: Path
    drawn: bool
    trouble: str


def failure_groups(runs: RunTable) -> list[FailureGroup]:
    """Return the runs that failed, grouped, the most frequent first."""
    all_runs = runs.frame("holds", "scenario", "failed_findings", "reasons")
    failed = all_runs[~all_runs["holds"]].astype(object)
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
    return next(iter(failed_findings), "").partition(", seen ")[0]


def choose(
    runs: RunTable, groups: Sequence[FailureGroup], most: int
) -> list[tuple[CampaignRun, str]]:
    """Return runs to show, and why: one of each kind of failure, then the extremes."""
    chosen = {
        group.example.run: (
            group.example,
            "the only run that failed so"
            if group.runs == 1
            else f"the first of {group.runs} runs that failed so",
        )
        for group in groups[:most]
    }
    for figure, why in _EXTREMES.items():
        seen = runs.frame(figure)[figure].dropna()
        if len(seen) and len(chosen) < most and (number := seen.idxmax()) not in chosen:
            (run,) = runs.at([number])
            chosen[number] = (run, why)
    return list(chosen.values())


def replay(
    campaign: Campaign, chosen: Sequence[tuple[CampaignRun, str]], folder: Path
) -> Iterator[WorstRun]:
    """Play runs once more, bit for bit as in the campaign, and keep what they leave.

    What a failed run left that is kept already is copied.

    Args:
        campaign: that they are of.
        chosen: the runs, and why.
        folder: of the campaign.
    """
    for run, why in chosen:
        place = folder / FOLDER / f"run-{run.run:06d}"
        kept = folder_of(folder, run.run)
        if is_kept(folder, run) and not (kept / ERROR).exists():
            copytree(kept, place)
            yield WorstRun(run, why, place, True, "")
            continue
        given = draw(campaign, run.run)
        try:
            scenario = load_scenario(given.scenario, RunMode.LOCK_STEP, given.changes)
            (place / DATA).mkdir(parents=True)
            outcome = play_recorded(given.scenario, scenario, place)
        except SettingsError as error:
            yield WorstRun(run, why, place, False, f"It cannot be played here: {error}")
            continue
        except Exception as error:
            yield WorstRun(run, why, place, False, f"It ended with {error!r}.")
            continue
        write_run(place, scenario, outcome.record)
        alike = outcome.digest == run.digest
        trouble = "" if alike else "Played once more here, it was not alike bit for bit."
        yield WorstRun(run, why, place, True, trouble)
