"""Values over time on one scale, by source."""

from dataclasses import dataclass
from math import isfinite
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from executive.history import TrackSource
from sim.drawing.lanes import line, write_beside
from sim.drawing.map import TRUE
from sim.drawing.style import DONE, FAINT, GRID, INK, MOTION, POINT

WHEEL: Final = "#b0479a"
LOOKS: Final = {
    TrackSource.TRUTH: line(TRUE, 5, zorder=2),
    TrackSource.COMMANDED: line(INK, 1.2, drawstyle="steps-post"),
    TrackSource.SECOND: line(DONE, 1.5),
    TrackSource.ODOMETRY: line(MOTION, 1.8),
    TrackSource.WHEELS: line(WHEEL, 0.9),
}
"""Line styles of the sources of a track or a speed, the lowest layer first."""
_MIN_AXIS_SPAN: Final = {"m/s": 0.1, "rad/s": 0.1}
"""Minimum span of an axis, for a stationary rover."""


@dataclass(frozen=True, slots=True)
class Series:
    """Values over time; NaN is a gap in the line."""

    source: TrackSource
    times_s: tuple[float, ...]
    values: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Panel:
    """Series on one scale."""

    title: str
    unit: str
    series: tuple[Series, ...]


def draw_panel(axes: Axes, panel: Panel) -> None:
    """Draw series on one scale, which contains zero."""
    values = [value for each in panel.series for value in each.values if isfinite(value)]
    low = min(0.0, min(values, default=0.0))
    high = max(_MIN_AXIS_SPAN.get(panel.unit, 0.0), max(values, default=0.0))
    margin = 0.12 * (high - low)
    axes.set_ylim(low - margin, high + margin)
    axes.yaxis.set_major_locator(MaxNLocator(4))
    axes.tick_params(axis="y", length=0, labelcolor=FAINT, labelsize=10 * POINT)
    axes.grid(axis="y", color=GRID)
    axes.axhline(0, color=FAINT, linewidth=0.8 * POINT)
    middle = (low + high) / 2
    write_beside(axes, 46, middle, f"{panel.title}, {panel.unit}", color=INK, fontweight="bold")
    for each in panel.series:
        axes.plot(np.array(each.times_s), np.array(each.values), **LOOKS[each.source])
