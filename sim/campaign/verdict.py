"""`judge`: the verdict on the runs of a campaign, with confidence intervals.

Success rates are judged by exact (Clopper-Pearson) bounds. So are quantiles: "the q quantile is
below a bound" means that a share q of all runs is below it. The lower bound of that true share
follows from the number of such runs.
"""

import json
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from enum import Enum, unique
from math import ceil, inf, isfinite, log
from pathlib import Path
from typing import TYPE_CHECKING, Final, assert_never

from sim.campaign.model import Campaign, Criterion, Interval, Quantile, Success, Until
from sim.campaign.runs import RunTable

if TYPE_CHECKING:
    from pandas import Series

FILE: Final = "verdict.json"
INTERVAL_CONFIDENCE: Final = 0.95
"""Confidence of the interval displayed with each share."""


@unique
class CriterionStatus(Enum):
    """Judgement on a criterion."""

    PASSED = "passed"
    FAILED = "failed"
    UNDECIDED = "undecided"
    """Neither is established with the required confidence."""
    EMPTY = "empty"
    """It matches no run, which is an error in the file."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CriterionResult:
    """One criterion and its result; without runs it is EMPTY.

    Attributes:
        figure: observed success rate or quantile; None if too many runs lack the figure, or there
            are no runs.
        share: share of the runs that meet the bound: for success rates, the figure itself.
        required: required share.
        low, high: bounds of the true share, each with the required confidence.
        passed, runs: number of runs that meet the bound, and of all matching runs.
        missing: number of matching runs without the figure.
    """

    criterion: str
    judgement: CriterionStatus = CriterionStatus.EMPTY
    figure: float | None = None
    bound: float
    share: float = 0.0
    required: float
    low: float = 0.0
    high: float = 1.0
    confidence: float
    passed: int = 0
    runs: int = 0
    missing: int = 0
    text: str = "no run matches"


@dataclass(frozen=True, slots=True)
class CampaignVerdict:
    """Result of a campaign.

    Attributes:
        runs, succeeded: number of runs, and of those that met all expectations of their scenario.
        low, high: bounds of the true success rate, with confidence 0.95.
        judged: result of each criterion, in the order of the file. A share of 1 only means that
            all existing runs meet the bound: no number of runs proves it for all possible ones.
        notes: deviations from the request that are no failures.
    """

    title: str
    runs: int
    succeeded: int
    low: float
    high: float
    judged: tuple[CriterionResult, ...]
    notes: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether all criteria are met."""
        return all(each.judgement is CriterionStatus.PASSED for each in self.judged)

    @property
    def empty(self) -> bool:
        """Whether a criterion matches no run."""
        return any(each.judgement is CriterionStatus.EMPTY for each in self.judged)

    def write(self, folder: Path) -> None:
        """Write it as JSON."""
        content = asdict(self) | {"passed": self.passed}
        for each in content["judged"]:
            each["judgement"] = each["judgement"].value
        text = json.dumps(content, indent=1, ensure_ascii=False) + "\n"
        (folder / FILE).write_text(text, encoding="utf-8")


def clopper_pearson(passed: int, runs: int, confidence: float = INTERVAL_CONFIDENCE) -> Interval:
    """Return the exact interval of a share, from the number of runs that meet it.

    The true share is beyond each end with half of the complement of the confidence.
    """
    from scipy.stats import binomtest  # slow to import

    found = binomtest(passed, runs).proportion_ci(confidence, method="exact")
    return Interval(float(found.low), float(found.high))


def quantile(values: Iterable[float], share: float) -> float:
    """Return the minimum value that this share of the values does not exceed."""
    ordered = sorted(values)
    return ordered[max(ceil(share * len(ordered) - 1e-9), 1) - 1]


def judge(campaign: Campaign, runs: RunTable) -> CampaignVerdict:
    """Return the result of a campaign with these runs, at least one."""
    passed = runs.frame("passed")["passed"]
    many, succeeded = len(passed), int(passed.sum())
    interval = clopper_pearson(succeeded, many)
    judged = tuple(_judge(criterion, runs) for criterion in campaign.criteria)
    notes = tuple(_notes(campaign.runs, many, succeeded))
    return CampaignVerdict(
        campaign.title, many, succeeded, interval.low, interval.high, judged, notes
    )


def _notes(wanted: int | Until, runs: int, succeeded: int) -> Iterator[str]:
    """Yield the differences between the runs and the request."""
    bound = wanted if isinstance(wanted, int) else wanted.max
    if runs > bound:
        yield f"all {runs} existing runs are judged, more than the {bound} requested"
    if isinstance(wanted, Until):
        interval = clopper_pearson(succeeded, runs, wanted.confidence)
        width = interval.high - interval.low
        if width > wanted.until:
            yield (
                f"after {runs} runs the interval of the success rate is {width:.4g} wide,"
                f" with confidence {wanted.confidence:g}, and not {wanted.until:g}"
            )


def _judge(criterion: Criterion, runs: RunTable) -> CriterionResult:
    """Judge by the number of runs that meet a bound; one without the figure does not."""
    key = criterion.of if isinstance(criterion, Quantile) else "passed"
    seen = runs.frame(key, where=criterion.where)[key]
    judged = CriterionResult(
        criterion=str(criterion),
        bound=criterion.bound,
        required=criterion.required_share,
        confidence=criterion.confidence,
    )
    if seen.empty:
        return judged
    which, figure = _meets_bound(criterion, seen)
    passed, many, missing = int(which.sum()), len(seen), int(seen.isna().sum())
    # Each end alone has the required confidence, so that both together have less.
    interval = clopper_pearson(passed, many, 2 * criterion.confidence - 1)
    judgement = _judgement(criterion.required_share, interval, all_passed=passed == many)
    text = f"{figure:.4g}" if isfinite(figure) else f"no {key} in {missing} runs"
    text += f"; {passed} of {many} runs meet it"
    text += f", a share of {interval.low:.4g} .. {interval.high:.4g}"
    if judgement is CriterionStatus.UNDECIDED and passed == many:
        needed = ceil(log(1 - criterion.confidence) / log(criterion.required_share))
        text += f"; {needed} runs are needed if all meet it"
    return replace(
        judged,
        judgement=judgement,
        figure=figure if isfinite(figure) else None,
        share=passed / many,
        low=interval.low,
        high=interval.high,
        passed=passed,
        runs=many,
        missing=missing,
        text=text,
    )


def _meets_bound(criterion: Criterion, seen: "Series") -> tuple["Series", float]:
    """Return the runs that meet a bound, and the figure: infinite if too many have none."""
    match criterion:
        case Success():
            return seen, float(seen.mean())
        case Quantile(above=None):
            return seen < criterion.bound, quantile(
                seen.astype(float).fillna(inf), criterion.quantile
            )
        case Quantile():
            return seen > criterion.bound, quantile(
                seen.astype(float).fillna(-inf), criterion.quantile
            )
        case _:
            assert_never(criterion)


def _judgement(wanted: float, interval: Interval, *, all_passed: bool) -> CriterionStatus:
    if interval.low >= wanted or (wanted == 1 and all_passed):
        return CriterionStatus.PASSED
    failed = interval.high < wanted or wanted == 1
    return CriterionStatus.FAILED if failed else CriterionStatus.UNDECIDED
