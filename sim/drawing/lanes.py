"""Common parts of drawings over time: name column, marks, legend, panels of values."""

from dataclasses import dataclass
from math import isfinite
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from executive.history.motion_tracks import TrackSource
from sim.drawing.map import TRUE
from sim.drawing.style import (
    COMMAND,
    DONE,
    DPI,
    FAINT,
    GRID,
    INK,
    MOTION,
    POINT,
    RULE,
    WARNED,
    WRONG,
)

WIDTH_PX: Final = 1240
LEFT_PX: Final = 300
"""Width of the column of names to the left of the lanes."""
RIGHT_PX: Final = 36
_INDENT_PX: Final = 24
Style = dict[str, Any]
"""Line properties of matplotlib."""


def mark(marker: str, size: float, colour: str, **style: Any) -> Style:
    """Return the style of a mark with a size in pixels."""
    return {
        "marker": marker,
        "markersize": size * POINT,
        "color": colour,
        "markeredgecolor": "white",
        "linestyle": "none",
        "zorder": 4,
        "clip_on": False,
        **style,
    }


def line(colour: str, width: float, **style: Any) -> Style:
    """Return the style of a line with a width in pixels."""
    return {"color": colour, "linewidth": width * POINT, "zorder": 3, **style}


SENT: Final = mark("o", 13, COMMAND, fillstyle="none", markeredgecolor=COMMAND, markeredgewidth=1.6)
RECEIVED: Final = mark("v", 13, COMMAND)
STARTED: Final = mark(">", 11, "white", markeredgecolor=MOTION)
ENDED: Final = mark("|", 18, MOTION, markeredgecolor=MOTION, markeredgewidth=2)
WORK: Final = line(MOTION, 12)
ENDS: Final = {
    "EXECUTED": DONE,
    "CANCELLED": WARNED,
    "REJECTED": WARNED,
    "DUPLICATE": WARNED,
    "EXPIRED": WARNED,
    "FAILED": WRONG,
}
"""Colours of the endings of a command."""
WAITING_FOR_TURN: Final = line(MOTION, 2, linestyle=(0, (2, 2)))
"""Style of a command queued aboard."""


def write_beside(axes: Axes, x_px: float, y: float, text: str, **style: Any) -> None:
    """Write to the left of the axes, at `x_px` from the left edge of the sheet."""
    across = (x_px - LEFT_PX) / (WIDTH_PX - LEFT_PX - RIGHT_PX)
    axes.text(across, y, text, transform=axes.get_yaxis_transform(), **style)


def draw_rule(axes: Axes, y: float) -> None:
    """Draw a line from the left edge of the sheet to the right edge of the axes."""
    left = (_INDENT_PX - LEFT_PX) / (WIDTH_PX - LEFT_PX - RIGHT_PX)
    axes.axhline(y, left, 1, clip_on=False, color=RULE, linewidth=0.7)


def add_legend_row(figure: Figure, top_px: float, entries: dict[str, list[Style]]) -> None:
    """Add a row of legend entries at `top_px` below the top of the sheet."""
    handles: Any = [tuple(Line2D([], [], **each) for each in it) for it in entries.values()]
    figure.legend(
        handles,
        list(entries),
        loc="upper left",
        bbox_to_anchor=(_INDENT_PX / WIDTH_PX, 1 - top_px / (DPI * figure.get_figheight())),
        ncols=len(entries),
        columnspacing=4.0,
        borderpad=0.0,
        borderaxespad=0.0,
    )


WHEEL: Final = "#b0479a"
STYLES: Final = {
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
        axes.plot(np.array(each.times_s), np.array(each.values), **STYLES[each.source])
