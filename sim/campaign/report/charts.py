"""Charts for the report of a campaign: success shares with intervals, and distributions."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise, starmap
from math import ceil, sqrt
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, PercentFormatter
from pandas import Series

from sim.campaign.model import Interval
from sim.campaign.verdict import clopper_pearson
from sim.drawing import DONE, FAINT, GRID, INK, MOTION, POINT, WRONG, line, mark, styled_figure

WIDTH_PX: Final = 460
MAX_VALUES: Final = 12
"""Maximum number of distinct values without bins; bins are also used for few runs per value."""
FEW: Final = 5
BINS: Final = 10
_LEFT, _RIGHT, _TOP, _BOTTOM = 64, 18, 16, 48
_HEIGHT, _ROW = 270, 26
_MAX_LABEL_LENGTH: Final = 26
_STEPS: Final = (0.01, 0.02, 0.05, 0.1, 0.25)
"""Steps between the ticks of an axis of shares."""
_BAND: Final = "#bcd7ea"


@dataclass(frozen=True, slots=True)
class Share:
    """Success rate of some runs.

    Attributes:
        name: description of the runs.
        low, high: interval of the quantity; equal for a single value.
    """

    name: str
    passed: int
    runs: int
    low: float = 0.0
    high: float = 0.0

    @property
    def share(self) -> float:
        """The observed share."""
        return self.passed / self.runs

    @property
    def interval(self) -> Interval:
        """Interval of the true share with a confidence of 95 %."""
        return clopper_pearson(self.passed, self.runs)


def by_value(values: Series, passed: Series) -> list[Share]:
    """Return the share of each value in ascending order; runs without a value are left out."""
    counted = _successes_by_group(values.dropna().astype(str), passed)
    return sorted(starmap(Share, counted), key=lambda each: (each.share, each.name))


def by_number(values: Series, passed: Series) -> list[Share]:
    """Return the share of each number, or in bins with equal numbers of runs; NA is left out."""
    numbers = values.dropna().astype(float)
    distinct = np.unique(numbers)
    if len(distinct) <= max(1, min(MAX_VALUES, len(numbers) / FEW)):
        bins = [(value, value) for value in distinct.tolist()]
        bin_of = np.searchsorted(distinct, numbers)
    else:
        many = min(BINS, max(1, round(sqrt(len(numbers)) / 2)))
        edges = np.unique(np.quantile(numbers, np.linspace(0, 1, many + 1)))
        bins = list(pairwise(edges.tolist()))
        bin_of = np.clip(np.searchsorted(edges, numbers, side="right") - 1, 0, len(bins) - 1)
    shares = []
    for index, succeeded, runs in _successes_by_group(Series(bin_of, numbers.index), passed):
        low, high = bins[index]
        name = f"{low:.4g}" if low == high else f"{low:.4g} … {high:.4g}"
        shares.append(Share(name, succeeded, runs, low, high))
    return shares


def _successes_by_group(groups: Series, passed: Series) -> Iterator[tuple[Any, int, int]]:
    """Yield each group in order, with its number of successful runs and of all runs."""
    for group, each in passed[groups.index].groupby(groups):
        yield group, int(each.sum()), len(each)


def draw_against_number(name: str, shares: Sequence[Share], wanted: float | None) -> Figure:
    """Return success over a number: share, and the band of its interval."""
    with _chart(_HEIGHT) as (figure, axes):
        lows = [each.low for each in shares]
        apart = float(np.diff(lows).min()) if len(lows) > 1 else max(1.0, abs(lows[0]))
        for each in shares:
            half = 0.3 * apart if each.low == each.high else 0.0
            begin, end = each.low - half, each.high + half
            interval = each.interval
            height = interval.high - interval.low
            axes.bar(begin, height, end - begin, interval.low, align="edge", color=_BAND, zorder=2)
            axes.plot([begin, end], [each.share] * 2, **line(MOTION, 2))
            axes.plot((begin + end) / 2, each.share, **mark("o", 7, MOTION))
        low = min(each.interval.low for each in shares)
        axes.set_ylim(max(-0.02, low - 0.1 * (1 - low)), 1 + 0.02 * (1 - low))
        axes.yaxis.set_major_formatter(PercentFormatter(1.0))
        axes.set_xlabel(name)
        if all(each.low == each.high for each in shares):
            axes.set_xticks(lows, [each.name for each in shares])
        if wanted is not None:
            axes.axhline(wanted, color=INK, linewidth=POINT, linestyle=(0, (4, 4)), zorder=4)
    return figure


def draw_shares(shares: Sequence[Share], wanted: float | None) -> Figure:
    """Return a row for each share: its interval, and its number of runs."""
    widest = max(len(each.name) for each in shares)
    left = min(220, 24 + ceil(7.5 * widest))
    with _chart(_TOP + _BOTTOM + _ROW * len(shares), left, 84) as (figure, axes):
        for row, each in enumerate(shares):
            interval = each.interval
            axes.plot([interval.low, interval.high], [row, row], **line(_BAND, 9))
            axes.plot(each.share, row, **mark("o", 8, MOTION))
            axes.annotate(
                f"{each.passed} of {each.runs}",
                (1, row),
                xycoords=("axes fraction", "data"),
                xytext=(6, 0),
                textcoords="offset points",
                va="center_baseline",
                color=FAINT,
                fontsize=11 * POINT,
            )
        low = min(each.interval.low for each in shares)
        axes.set(xlim=(max(-0.02, low - 0.05), 1.02), ylim=(len(shares) - 0.5, -0.5))
        axes.set_yticks(range(len(shares)), [_cut(each.name) for each in shares])
        axes.tick_params(axis="y", length=0)
        step = next(each for each in _STEPS if (1 - low) / each <= 4)
        axes.set_xticks([1 - step * number for number in range(int((1 - low) / step) + 1)])
        axes.xaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
        if wanted is not None:
            axes.axvline(wanted, color=INK, linewidth=POINT, linestyle=(0, (4, 4)), zorder=4)
    return figure


def draw_distribution(
    name: str, passed: Sequence[float], failed: Sequence[float], bounds: Sequence[float]
) -> Figure:
    """Return the histogram of a figure, in successful and in failed runs.

    Args:
        name: name of the figure, with its unit.
        passed: the values in successful runs.
        failed: the values in failed runs; together they have at least two different ones.
        bounds: bounds of its quantiles; distant ones are left out.
    """
    with _chart(_HEIGHT) as (figure, axes):
        edges = np.histogram_bin_edges([*passed, *failed], bins=30)
        axes.hist([passed, failed], edges.tolist(), stacked=True, color=[DONE, WRONG], zorder=2)
        for bound in bounds_near(edges[0], edges[-1], bounds):
            axes.axvline(bound, color=INK, linewidth=POINT, linestyle=(0, (4, 4)), zorder=4)
        axes.yaxis.set_major_locator(MaxNLocator(4, integer=True))
        axes.set(xlabel=name, ylabel="runs")
    return figure


def bounds_near(low: float, high: float, bounds: Sequence[float]) -> list[float]:
    """Return the bounds no further from a span than its length."""
    return [each for each in bounds if 2 * low - high <= each <= 2 * high - low]


@contextmanager
def _chart(
    height: float, left: float = _LEFT, right: float = _RIGHT
) -> Iterator[tuple[Figure, Axes]]:
    """Yield a sheet of the report's width, and its axes."""
    with styled_figure(WIDTH_PX, height, "") as figure:
        across, upright = WIDTH_PX - left - right, height - _TOP - _BOTTOM
        box = (left / WIDTH_PX, _BOTTOM / height, across / WIDTH_PX, upright / height)
        axes = figure.add_axes(box)
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(color=GRID, zorder=0.5)
        axes.set_axisbelow(True)
        yield figure, axes


def _cut(name: str) -> str:
    return name if len(name) <= _MAX_LABEL_LENGTH else f"{name[: _MAX_LABEL_LENGTH - 1]}…"
