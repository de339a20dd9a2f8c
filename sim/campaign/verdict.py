"""From the runs of a campaign to its verdict, with confidence.

Success rates are judged by exact (Clopper-Pearson) bounds. So are quantiles: that the q quantile is
below a bound says that a share q of all runs is, and how great the true share is at least follows
from how many of the runs were.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from enum import Enum, unique
from math import ceil, inf, isinf, log
from pathlib import Path
from typing import Final, assert_never

from scipy.special import betaincinv

from sim.campaign.model import Campaign, Hold, Interval, Quantile, Success, Until
from sim.campaign.runs import Runs

FILE: Final = "verdict.json"
INTERVAL_CONFIDENCE: Final = 0.95
"""Of the interval that is shown beside each share."""


@unique
class Judgement(Enum):
    """What the runs say of something that must hold."""

    HOLDS = "holds"
    FAILS = "fails"
    UNDECIDED = "undecided"
    """Neither is known with the confidence that is wanted."""
    EMPTY = "empty"
    """It is about no run, which is a mistake in the file."""


@dataclass(frozen=True, slots=True)
class Judged:
    """One thing that must hold, and what came of it.

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
    judgement: Judgement
    figure: float | None
    bound: float
    share: float
    wanted: float
    low: float
    high: float
    confidence: float
    kept: int
    runs: int
    missing: int
    text: str


@dataclass(frozen=True, slots=True)
class Verdict:
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
    judged: tuple[Judged, ...]
    notes: tuple[str, ...] = ()

    @property
    def holds(self) -> bool:
        """Whether all holds that must."""
        return all(each.judgement is Judgement.HOLDS for each in self.judged)

    @property
    def empty(self) -> bool:
        """Whether something is about no run."""
        return any(each.judgement is Judgement.EMPTY for each in self.judged)

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

    Raises:
        ValueError: there are no runs, or fewer than keep it.
    """
    tail = (1 - confidence) / 2
    return Interval(_low(kept, runs, 1 - tail), _high(kept, runs, 1 - tail))


def _low(kept: int, runs: int, confidence: float) -> float:
    """Return what a share is at least, with a confidence."""
    if not 0 <= kept <= runs or runs < 1:
        raise ValueError(f"{kept} of {runs} runs make no share")
    return 0.0 if kept == 0 else float(betaincinv(kept, runs - kept + 1, 1 - confidence))


def _high(kept: int, runs: int, confidence: float) -> float:
    return 1 - _low(runs - kept, runs, confidence)


def quantile(values: Sequence[float], share: float) -> float:
    """Return the least value that this share of the values does not exceed."""
    ordered = sorted(values)
    return ordered[max(ceil(share * len(ordered) - 1e-9), 1) - 1]


def judge(campaign: Campaign, runs: Runs) -> Verdict:
    """Return what came of a campaign with these runs, one at least."""
    holds = runs.column("holds")
    interval = clopper_pearson(sum(holds), len(holds))
    judged = tuple(_judged(hold, runs) for hold in campaign.hold)
    low, high, notes = interval.low, interval.high, tuple(_notes(campaign.runs, holds))
    return Verdict(campaign.title, len(holds), sum(holds), low, high, judged, notes)


def _notes(wanted: int | Until, holds: Sequence[bool]) -> Iterator[str]:
    """Yield how the runs are not those that were asked for."""
    runs = len(holds)
    most = wanted if isinstance(wanted, int) else wanted.most
    if runs > most:
        yield f"all {runs} runs that are there are judged, more than the {most} asked for"
    if isinstance(wanted, Until):
        interval = clopper_pearson(sum(holds), runs, wanted.confidence)
        width = interval.high - interval.low
        if width > wanted.until:
            yield (
                f"after {runs} runs the interval of the success rate is {width:.4g} wide,"
                f" with confidence {wanted.confidence:g}, and not {wanted.until:g}"
            )


def _judged(hold: Hold, runs: Runs) -> Judged:
    match hold:
        case Success():
            return _of_share(hold, runs.column("holds", hold.where))
        case Quantile():
            return _of_quantile(hold, runs.column(hold.of, hold.where))
        case _:
            assert_never(hold)


def _of_share(hold: Success, kept: Sequence[bool]) -> Judged:
    wanted = hold.success
    if not kept:
        return _empty(hold, wanted, wanted)
    share = sum(kept) / len(kept)
    return _shared(hold, share, wanted, wanted, sum(kept), len(kept), 0, f"{share:.4g}")


def _of_quantile(hold: Quantile, seen: Sequence[float | None]) -> Judged:
    values = [float(value) for value in seen if value is not None]
    upper = hold.above is None
    bound = hold.below if hold.below is not None else hold.above
    assert bound is not None
    wanted = hold.wanted
    if not seen:
        return _empty(hold, bound, wanted)
    missing = len(seen) - len(values)
    kept = sum(value < bound if upper else value > bound for value in values)
    worst = inf if upper else -inf
    figure = quantile([*values, *[worst] * missing], hold.quantile)
    text = f"{figure:.4g}" if not isinf(figure) else f"no {hold.of} in {missing} runs"
    known = None if isinf(figure) else figure
    return _shared(hold, known, bound, wanted, kept, len(seen), missing, text)


def _shared(
    hold: Hold,
    figure: float | None,
    bound: float,
    wanted: float,
    kept: int,
    runs: int,
    missing: int,
    text: str,
) -> Judged:
    """Judge by how many runs keep a bound."""
    low, high = _low(kept, runs, hold.confidence), _high(kept, runs, hold.confidence)
    if low >= wanted or (wanted == 1 and kept == runs):
        judgement = Judgement.HOLDS
    elif high < wanted or wanted == 1:
        judgement = Judgement.FAILS
    else:
        judgement = Judgement.UNDECIDED
    said = f"{text}; {kept} of {runs} runs keep it, a share of {low:.4g} .. {high:.4g}"
    if judgement is Judgement.UNDECIDED and kept == runs:
        said += f"; it takes {ceil(log(1 - hold.confidence) / log(wanted))} runs of which all do"
    return Judged(
        hold=str(hold),
        judgement=judgement,
        figure=figure,
        bound=bound,
        share=kept / runs,
        wanted=wanted,
        low=low,
        high=high,
        confidence=hold.confidence,
        kept=kept,
        runs=runs,
        missing=missing,
        text=said,
    )


def _empty(hold: Hold, bound: float, wanted: float) -> Judged:
    return Judged(
        hold=str(hold),
        judgement=Judgement.EMPTY,
        figure=None,
        bound=bound,
        share=0.0,
        wanted=wanted,
        low=0.0,
        high=1.0,
        confidence=hold.confidence,
        kept=0,
        runs=0,
        missing=0,
        text="there is no such run",
    )
