"""From the runs of a campaign to its verdict, with confidence.

Success rates are judged by exact (Clopper-Pearson) bounds. So are quantiles: that the q quantile is
below a bound says that a share q of all runs is, and how great the true share is at least follows
from how many of the runs were.
"""

import json
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from enum import Enum, unique
from math import ceil, inf, isfinite, log
from pathlib import Path
from typing import TYPE_CHECKING, Final, assert_never

from scipy.stats import binomtest

from sim.campaign.model import Campaign, Hold, Interval, Quantile, Success, Until
from sim.campaign.runs import RunTable

if TYPE_CHECKING:
    from pandas import Series

FILE: Final = "verdict.json"
INTERVAL_CONFIDENCE: Final = 0.95
"""Of the interval that is shown beside each share."""


@unique
class CriterionStatus(Enum):
    """What the runs say of something that must hold."""

    HOLDS = "holds"
    FAILS = "fails"
    UNDECIDED = "undecided"
    """Neither is known with the confidence that is wanted."""
    EMPTY = "empty"
    """It is about no run, which is a mistake in the file."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CriterionResult:
    """One thing that must hold, and what came of it; without runs it is about none.

    Attributes:
        hold: in words.
        judgement: what the runs say.
        figure: the share that succeeded, or the quantile seen; None where too many runs have no
            such figure, or there are no runs.
        bound: which the figure has to keep.
        share: of the runs, which keep the bound: for success rates, the figure itself.
        wanted: the share that has to.
        low, high: bounds of the true share, each with the confidence that is wanted.
        confidence: which is wanted.
        kept, runs: how many runs keep the bound, of how many it is about.
        missing: in how many of those there is no such figure.
        text: the outcome in words.
    """

    hold: str
    judgement: CriterionStatus = CriterionStatus.EMPTY
    figure: float | None = None
    bound: float
    share: float = 0.0
    wanted: float
    low: float = 0.0
    high: float = 1.0
    confidence: float
    kept: int = 0
    runs: int = 0
    missing: int = 0
    text: str = "there is no such run"


@dataclass(frozen=True, slots=True)
class CampaignVerdict:
    """What came of a campaign.

    Attributes:
        runs, succeeded: how many, and how many of them met all that their scenarios expect.
        low, high: of the true success rate, with confidence 0.95.
        judged: each thing that must hold, in the order of the file. A share of 1 says no more than
            that all runs there are keep the bound: no number of runs shows it of all that could be.
        notes: what is not as it was asked for, though it is no failure.
    """

    title: str
    runs: int
    succeeded: int
    low: float
    high: float
    judged: tuple[CriterionResult, ...]
    notes: tuple[str, ...] = ()

    @property
    def holds(self) -> bool:
        """Whether all holds that must."""
        return all(each.judgement is CriterionStatus.HOLDS for each in self.judged)

    @property
    def empty(self) -> bool:
        """Whether something is about no run."""
        return any(each.judgement is CriterionStatus.EMPTY for each in self.judged)

    def write(self, folder: Path) -> None:
        """Write it as JSON."""
        told = asdict(self) | {"holds": self.holds}
        for each in told["judged"]:
            each["judgement"] = each["judgement"].value
        text = json.dumps(told, indent=1, ensure_ascii=False) + "\n"
        (folder / FILE).write_text(text, encoding="utf-8")


def clopper_pearson(kept: int, runs: int, confidence: float = INTERVAL_CONFIDENCE) -> Interval:
    """Return the exact interval of a share, from how many of how many runs keep it.

    Each end is passed with half of what is missing to the confidence.
    """
    found = binomtest(kept, runs).proportion_ci(confidence, method="exact")
    return Interval(float(found.low), float(found.high))


def quantile(values: Iterable[float], share: float) -> float:
    """Return the least value that this share of the values does not exceed."""
    ordered = sorted(values)
    return ordered[max(ceil(share * len(ordered) - 1e-9), 1) - 1]


def judge(campaign: Campaign, runs: RunTable) -> CampaignVerdict:
    """Return what came of a campaign with these runs, one at least."""
    holds = runs.frame("holds")["holds"]
    many, succeeded = len(holds), int(holds.sum())
    interval = clopper_pearson(succeeded, many)
    judged = tuple(_judged(hold, runs) for hold in campaign.hold)
    notes = tuple(_notes(campaign.runs, many, succeeded))
    return CampaignVerdict(
        campaign.title, many, succeeded, interval.low, interval.high, judged, notes
    )


def _notes(wanted: int | Until, runs: int, succeeded: int) -> Iterator[str]:
    """Yield how the runs are not those that were asked for."""
    most = wanted if isinstance(wanted, int) else wanted.most
    if runs > most:
        yield f"all {runs} runs that are there are judged, more than the {most} asked for"
    if isinstance(wanted, Until):
        interval = clopper_pearson(succeeded, runs, wanted.confidence)
        width = interval.high - interval.low
        if width > wanted.until:
            yield (
                f"after {runs} runs the interval of the success rate is {width:.4g} wide,"
                f" with confidence {wanted.confidence:g}, and not {wanted.until:g}"
            )


def _judged(hold: Hold, runs: RunTable) -> CriterionResult:
    """Judge by how many runs keep a bound; one that has no such figure does not."""
    key = hold.of if isinstance(hold, Quantile) else "holds"
    seen = runs.frame(key, where=hold.where)[key]
    judged = CriterionResult(
        hold=str(hold), bound=hold.bound, wanted=hold.wanted, confidence=hold.confidence
    )
    if seen.empty:
        return judged
    which, figure = _kept(hold, seen)
    kept, many, missing = int(which.sum()), len(seen), int(seen.isna().sum())
    # Each end alone has the confidence that is wanted, so that both have less.
    interval = clopper_pearson(kept, many, 2 * hold.confidence - 1)
    judgement = _judgement(hold.wanted, interval, all_keep=kept == many)
    text = f"{figure:.4g}" if isfinite(figure) else f"no {key} in {missing} runs"
    text += f"; {kept} of {many} runs keep it"
    text += f", a share of {interval.low:.4g} .. {interval.high:.4g}"
    if judgement is CriterionStatus.UNDECIDED and kept == many:
        needed = ceil(log(1 - hold.confidence) / log(hold.wanted))
        text += f"; it takes {needed} runs of which all do"
    return replace(
        judged,
        judgement=judgement,
        figure=figure if isfinite(figure) else None,
        share=kept / many,
        low=interval.low,
        high=interval.high,
        kept=kept,
        runs=many,
        missing=missing,
        text=text,
    )


def _kept(hold: Hold, seen: "Series") -> tuple["Series", float]:
    """Return which runs keep a bound, and the figure: infinite where too many have none."""
    match hold:
        case Success():
            return seen, float(seen.mean())
        case Quantile(above=None):
            return seen < hold.bound, quantile(seen.astype(float).fillna(inf), hold.quantile)
        case Quantile():
            return seen > hold.bound, quantile(seen.astype(float).fillna(-inf), hold.quantile)
        case _:
            assert_never(hold)


def _judgement(wanted: float, interval: Interval, *, all_keep: bool) -> CriterionStatus:
    if interval.low >= wanted or (wanted == 1 and all_keep):
        return CriterionStatus.HOLDS
    fails = interval.high < wanted or wanted == 1
    return CriterionStatus.FAILS if fails else CriterionStatus.UNDECIDED
