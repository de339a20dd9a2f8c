"""The drawing of a controller's runs: where it drove, and how long beside the best known times."""

from pathlib import Path
from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sim.drawing import (
    DONE,
    FAINT,
    GRID,
    INK,
    MOTION,
    WRONG,
    line,
    mark,
    styled_figure,
    write_drawing,
)
from tests.benchmarks.locomotion import LIMIT_S, Measured, Run

WIDTH_PX: Final = 1240
_TOP, _BOTTOM, _LEFT, _RIGHT, _GAP, _ROW = 90, 60, 70, 40, 110, 24
_MIN_PX: Final = 420


def draw(measured: Measured, folder: Path) -> Path:
    """Write the drawing of a controller as SVG and PNG, and return the path of the PNG."""
    return write_drawing(folder, f"locomotion-{measured.name}", drawing(measured))[1]


def drawing(measured: Measured) -> Figure:
    """Return the drawing of a controller: a map of its true paths, and a row for each goal."""
    runs = measured.runs
    height_px = max(_MIN_PX, len(runs) * _ROW) + _TOP + _BOTTOM
    done = sum(run.reached for run in runs)
    title = f"{measured.name}: {done} of {len(runs)} goals, {measured.sum_ratio:.3f} of best known"
    with styled_figure(WIDTH_PX, height_px, title) as figure:
        half_px = (WIDTH_PX - _LEFT - _RIGHT - _GAP) / 2
        bottom, high = _BOTTOM / height_px, 1 - (_TOP + _BOTTOM) / height_px
        left = figure.add_axes((_LEFT / WIDTH_PX, bottom, half_px / WIDTH_PX, high))
        beside = (_LEFT + half_px + _GAP) / WIDTH_PX
        right = figure.add_axes((beside, bottom, half_px / WIDTH_PX, high))
        _draw_paths(left, runs)
        _draw_times(right, runs)
    return figure


def _draw_paths(axes: Axes, runs: tuple[Run, ...]) -> None:
    for run in runs:
        colour = MOTION if run.reached else WRONG
        x_m = [point.x_m for point in run.path]
        y_m = [point.y_m for point in run.path]
        axes.plot(x_m, y_m, **line(colour, 1.6))
        axes.plot([run.goal.x_m], [run.goal.y_m], **mark("o", 8, colour))
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(color=GRID)
    axes.set_xlabel("x (m), true path")
    axes.set_ylabel("y (m)")


def _draw_times(axes: Axes, runs: tuple[Run, ...]) -> None:
    for row, run in enumerate(runs):
        best_s = run.goal.best_known_time_s
        axes.barh(row, run.time_s / best_s, 0.6, color=DONE if run.reached else WRONG, zorder=2)
        axes.plot([run.bound_s / best_s], [row], **mark("|", 14, INK, markeredgecolor=INK))
        if not run.done:
            axes.text(0.1, row, f"not done in {LIMIT_S:g} s", va="center", color="white", zorder=5)
    axes.axvline(1.0, color=FAINT, linewidth=1.0, zorder=3)
    axes.set_yticks(range(len(runs)), [run.goal.id for run in runs])
    axes.invert_yaxis()
    axes.set_xlim(
        0.0, max(3.0, *(run.time_s / run.goal.best_known_time_s for run in runs if run.done))
    )
    axes.grid(axis="x", color=GRID, zorder=0)
    axes.set_xlabel("time / best known time;  | certified lower bound")
