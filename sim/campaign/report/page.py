"""`write_report`: the report of a campaign, one self-contained HTML page without network access."""

import json
import shutil
from base64 import b64encode
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from shutil import copytree
from typing import Any, Final

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from pandas import Series

from executive.settings import SettingsError
from executive.values.reports import Stage
from sim.campaign.draws import INJECT, ValueKind, VariedQuantity, draw, quantities
from sim.campaign.model import Campaign, Criterion, Quantile, Success
from sim.campaign.report.charts import (
    bounds_near,
    by_number,
    by_value,
    draw_against_number,
    draw_distribution,
    draw_shares,
)
from sim.campaign.runs import CampaignRun, RunTable, keys_of
from sim.campaign.session import folder_of, is_saved
from sim.campaign.verdict import CampaignVerdict, CriterionResult, CriterionStatus
from sim.campaign.worker import ERROR
from sim.drawing import as_svg
from sim.scenario.model import RunMode
from sim.scenario.pictures import REPORTS, write_run
from sim.scenario.reading import load_scenario
from sim.scenario.run import DATA, run_recorded

NAME: Final = "report.html"
RELATIVE_TOLERANCE: Final = 1e-9
"""Relative difference below which figures count as equal."""
MAX_WORST_RUNS: Final = 8
MAX_GROUPS: Final = 25
BAD: Final = [Stage.FAILED.name, Stage.REJECTED.name, Stage.EXPIRED.name, Stage.CANCELLED.name]
MAX_ROWS: Final = 30
"""Maximum number of rows of a chart of shares, lowest shares first."""
_UNITS: Final = {"s": "s", "m": "m", "rad": "rad", "j": "J"}


@dataclass(frozen=True, slots=True)
class CriterionRow:
    """A criterion, formatted for display."""

    judged: CriterionResult
    observed: str
    share: str


@dataclass(frozen=True, slots=True)
class Chart:
    """A drawing with its heading, or a text if there is nothing to draw."""

    title: str
    text: str
    svg: Markup | None = None


@dataclass(frozen=True, slots=True)
class Distribution:
    """Distribution of a figure over all runs that have it, with quantiles as text."""

    chart: Chart
    runs: int
    missing: int
    quantiles: tuple[str, ...]


def write_report(
    folder: Path, campaign: Campaign, runs: RunTable, verdict: CampaignVerdict
) -> Path:
    """Write `report.html`, and the files of its displayed runs below `worst`; return the page.

    The displayed runs are repeated: one of each kind of failure, and the extremes.

    Raises:
        SettingsError: the data set cannot be read.
    """
    shutil.rmtree(folder / FOLDER, ignore_errors=True)
    groups = failure_groups(runs)
    worst = replay(campaign, select_runs(runs, groups, MAX_WORST_RUNS), folder)
    environment = Environment(
        loader=PackageLoader("sim.campaign.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"percent": _percent, "picture": _picture}
    environment.filters |= {"varied": _drawn_values, "reports": _reports}
    page = environment.get_template("page.html").render(
        campaign=campaign,
        verdict=verdict,
        judgement=judgement_of(verdict),
        criteria=tuple(map(_criterion_row, campaign.criteria, verdict.judged)),
        false_executed=_false_executed(runs),
        against=tuple(_against(campaign, runs)),
        distributions=tuple(_distributions(campaign, runs)),
        groups=groups[:MAX_GROUPS],
        more_groups=_rest(groups[MAX_GROUPS:]),
        shown=list(worst),
        folder=FOLDER,
        bad=BAD,
    )
    path = folder / NAME
    path.write_text(page, encoding="utf-8")
    return path


def judgement_of(verdict: CampaignVerdict) -> CriterionStatus:
    """Return the judgement on a whole campaign: the worst of its criteria."""
    order = (CriterionStatus.EMPTY, CriterionStatus.FAILED, CriterionStatus.UNDECIDED)
    found = {each.judgement for each in verdict.judged}
    return next((worst for worst in order if worst in found), CriterionStatus.PASSED)


def _criterion_row(criterion: Criterion, judged: CriterionResult) -> CriterionRow:
    """Return the row of a criterion on the page."""
    if judged.judgement is CriterionStatus.EMPTY:
        return CriterionRow(judged, judged.text, "")
    observed = f"none in {judged.missing} runs" if judged.figure is None else f"{judged.figure:.4g}"
    if isinstance(criterion, Success):
        observed = _percent(judged.share)
    low, high = _percent(judged.low), _percent(judged.high)
    confidence = _percent(judged.confidence)
    share = f"{_percent(judged.share)}; the true share is at least {low}, at most {high}"
    return CriterionRow(judged, observed, f"{share}, each with {confidence} confidence")


def _percent(share: float) -> str:
    """Return a share in percent, with enough digits to distinguish it from 0 and 100 %."""
    text = f"{100 * share:.4g}"
    near = share < 1 and text == "100"
    return f"{'> 99.99' if near else text}\N{NO-BREAK SPACE}%"


def _false_executed(runs: RunTable) -> tuple[int, int]:
    """Return the number of commands that falsely ended EXECUTED, and of runs with one."""
    seen = runs.frame("false_executed")["false_executed"]
    return int(seen.sum()), int((seen > 0).sum())


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


def _rest(groups: Sequence[FailureGroup]) -> str:
    many = sum(group.runs for group in groups)
    return f"{many} more runs failed, with {len(groups)} other kinds of failure." if groups else ""


def _against(campaign: Campaign, runs: RunTable) -> Iterator[Chart]:
    """Yield success over each scenario, and each varied quantity except the seed.

    A parameter has a chart for each fault that has it, as its meaning differs.
    """
    everywhere = (
        h.success for h in campaign.criteria if isinstance(h, Success) and not h.where.terms
    )
    wanted = max(everywhere, default=None)
    varied = quantities(campaign)
    if len(campaign.scenarios) > 1:
        varied = (VariedQuantity("scenario", ValueKind.TEXT), *varied)
    all_runs = runs.frame("passed", *(each.name for each in varied))
    for quantity in varied:
        name, values = quantity.name, all_runs[quantity.name]
        if name == "seed":
            continue
        faults = []
        if name.startswith(f"{INJECT}.") and name not in (f"{INJECT}.at", f"{INJECT}.for"):
            faults = sorted(all_runs[INJECT][values.notna()].unique())
        for fault in faults:
            own = values.where(all_runs[INJECT] == fault)
            yield _chart(f"{name} of {fault}", quantity.kind, own, all_runs["passed"], wanted)
        if not faults:
            yield _chart(name, quantity.kind, values, all_runs["passed"], wanted)


def _chart(
    name: str, kind: ValueKind, values: Series, passed: Series, wanted: float | None
) -> Chart:
    """Return success over a quantity, in the runs that have a value of it."""
    having = values.count()
    if not having:
        return Chart(name, "No run has a value of it.")
    text = f"{having} of {len(values)} runs have it. " if having < len(values) else ""
    if kind is not ValueKind.TEXT:
        drawn = draw_against_number(name, by_number(values, passed), wanted)
        return Chart(name, text, Markup(as_svg(drawn)))
    shares = by_value(values, passed)
    left = len(shares) - MAX_ROWS
    text += f"The {left} values with higher success rates are left out." if left > 0 else ""
    return Chart(name, text, Markup(as_svg(draw_shares(shares[:MAX_ROWS], wanted))))


def _distributions(campaign: Campaign, runs: RunTable) -> Iterator[Distribution]:
    """Yield the distribution of each figure that has a unit or is used by a quantile."""
    varied = {each.name for each in quantities(campaign)}
    judged = {each.of for each in campaign.criteria if isinstance(each, Quantile)}
    for key, number in keys_of(campaign).items():
        name = _title(key)
        if not number or key in varied or ("," not in name and key not in judged):
            continue
        all_runs = runs.frame("passed", key)
        known = all_runs.dropna()
        missing = len(all_runs) - len(known)
        if known.empty:
            yield Distribution(Chart(name, "No run has this figure."), 0, missing, ())
            continue
        seen = known[key].to_numpy(float)
        quantiles = np.quantile(seen, (0.0, 0.5, 0.95, 0.99, 1.0), method="inverted_cdf")
        if np.ptp(seen) <= RELATIVE_TOLERANCE * np.abs(seen).max():
            chart = Chart(name, f"It is {seen[0]:.4g} in each run that has it.")
        else:
            bounds = [h.bound for h in campaign.criteria if isinstance(h, Quantile) and h.of == key]
            passed = known["passed"].to_numpy(bool)
            figure = draw_distribution(name, seen[passed], seen[~passed], bounds)
            near = bounds_near(seen.min(), seen.max(), bounds)
            beyond = ", ".join(f"{bound:g}" for bound in bounds if bound not in near)
            text = f"Beyond the chart: the bound {beyond}." if beyond else ""
            chart = Chart(name, text, Markup(as_svg(figure)))
        texts = tuple(f"{value:.4g}" for value in quantiles)
        yield Distribution(chart, len(seen), missing, texts)


def _title(key: str) -> str:
    """Return the display name of a figure: `true_error_m` is `true error, m`."""
    name, _, unit = key.rpartition("_")
    if name and unit in _UNITS:
        return f"{name.replace('_', ' ')}, {_UNITS[unit]}"
    return key.replace("_", " ")


def _drawn_values(run: CampaignRun) -> str:
    return ", ".join(
        f"{name} {value:.6g}" if isinstance(value, float) else f"{name} {value}"
        for name, value in run.varied.items()
        if value is not None
    )


def _reports(folder: Path) -> list[Any]:
    """Return the reports of a run, as in their file."""
    return list(map(json.loads, (folder / REPORTS).read_text(encoding="utf-8").splitlines()))


def _picture(path: Path) -> str:
    return f"data:image/png;base64,{b64encode(path.read_bytes()).decode()}"
