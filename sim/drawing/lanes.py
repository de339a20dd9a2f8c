"""Common parts of drawings over time: the column of names, the marks of a command."""

from typing import Any, Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from sim.drawing.style import COMMAND, DONE, DPI, MOTION, POINT, RULE, WARNED, WRONG

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
