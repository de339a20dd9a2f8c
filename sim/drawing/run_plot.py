"""The plot of a recorded run: its map, and along time commands, events, modes and speeds."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import isfinite
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from executive.commands import Mode
from executive.history import TrackSource
from executive.obstacles.zones import Zones
from executive.values.geometry import Pose
from sim.drawing.lanes import LEFT_PX, RIGHT_PX, WIDTH_PX, line, write_beside
from sim.drawing.map import SOIL, TRUE, Incident, draw_incidents, draw_rover, draw_zones, thinned
from sim.drawing.style import DONE, FAINT, GRID, INK, MOTION, POINT, sheet
from sim.drawing.timeline import (
    EVENT,
    LANE_PX,
    ROW_PX,
    CommandLane,
    draw_commands,
    draw_modes,
    name_row,
)

WHEEL, GONE = "#b0479a", "#dde1ed"
_LOOKS: Final = {
    TrackSource.TRUTH: line(TRUE, 5, zorder=2),
    TrackSource.COMMANDED: line(INK, 1.2, drawstyle="steps-post"),
    TrackSource.SECOND: line(DONE, 1.5),
    TrackSource.ODOMETRY: line(MOTION, 1.8),
    TrackSource.WHEELS: line(WHEEL, 0.9),
}
"""The sources of a track or a speed, the lowest first."""
_TOP, _MAP, _BESIDE_MAP, _GAP, _PANEL, _BOTTOM = 56, 380, 62, 14, 150, 52
_LEAST: Final = {"m/s": 0.1, "rad/s": 0.1}
"""A rover that stands has a scale, too."""
_AROUND_M: Final = 0.6
"""Ground that is shown around what was driven."""


@dataclass(frozen=True, slots=True)
class Series:
    """A figure over time, NaN where the line has a gap."""

    source: TrackSource
    times_s: tuple[float, ...]
    values: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Panel:
    """What is drawn on one scale."""

    title: str
    unit: str
    series: tuple[Series, ...]


@dataclass(frozen=True, slots=True)
class Track:
    """Where the rover was, as a source tells."""

    source: TrackSource
    poses: tuple[Pose, ...]


@dataclass(frozen=True, slots=True)
class RunPlot:
    """What the plot of a run shows; times in seconds since its beginning.

    Attributes:
        end_s: how long it lasted.
        figures: lines of text beside the map.
        tracks: in one frame.
        incidents: what went wrong where.
        gone: when there was no executive.
        events: name of each kind of event that the rover reported, and when.
        modes: from when to when the rover was in which.
        scale: the rover's size beside the Jackal's.
    """

    title: str
    end_s: float
    figures: tuple[str, ...]
    tracks: tuple[Track, ...]
    commands: tuple[CommandLane, ...]
    events: tuple[tuple[str, tuple[float, ...]], ...]
    modes: tuple[tuple[Mode, float, float], ...]
    panels: tuple[Panel, ...]
    incidents: tuple[Incident, ...] = ()
    gone: tuple[tuple[float, float], ...] = ()
    zones: Zones = field(default_factory=Zones)
    scale: float = 1.0


def draw_run(plot: RunPlot) -> Figure:
    """Return the plot of a run: the map above, then a row for each command, event and the modes."""
    rows_px = max(1, len(plot.commands)) * LANE_PX + 2 * _GAP + (len(plot.events) + 1) * ROW_PX
    panels = [panel for panel in plot.panels if panel.series]
    heights = [_MAP, _BESIDE_MAP, rows_px, *(_PANEL for _ in panels)]
    height = _TOP + sum(heights) + _BOTTOM
    with sheet(WIDTH_PX, height, plot.title) as figure:
        grid = figure.add_gridspec(
            len(heights),
            left=LEFT_PX / WIDTH_PX,
            right=1 - RIGHT_PX / WIDTH_PX,
            bottom=_BOTTOM / height,
            top=1 - _TOP / height,
            hspace=0,
            height_ratios=heights,
        )
        ground = figure.add_subplot(grid[0], facecolor=SOIL)
        rows = figure.add_subplot(grid[2])
        scales = [figure.add_subplot(grid[3 + at], sharex=rows) for at in range(len(panels))]
        _draw_map(ground, plot)
        _draw_rows(rows, plot, rows_px)
        for axes, panel in zip(scales, panels, strict=True):
            _draw_panel(axes, panel)
        for axes in (rows, *scales):
            axes.spines[["left", "top", "right"]].set_visible(False)
            axes.grid(axis="x", color=GRID, zorder=0.5)
            axes.set_axisbelow(True)
            for gone in plot.gone:
                axes.axvspan(*gone, color=GONE, linewidth=0, zorder=0.2)
        for gone in plot.gone:
            rows.text(sum(gone) / 2, -6, "no executive", color=FAINT, ha="center")
        for axes in (rows, *scales)[:-1]:
            axes.spines.bottom.set_visible(False)
            axes.tick_params(axis="x", bottom=False, labelbottom=False)
        (rows, *scales)[-1].set_xlabel("seconds after the start")
        _add_words(figure, ground, plot, height)
    return figure


def _draw_map(axes: Axes, plot: RunPlot) -> None:
    """Draw the tracks to scale, with some ground around them."""
    points = [pose.point for track in plot.tracks for pose in track.poses]
    (west_m, east_m), (south_m, north_m) = (
        _around([each.x_m for each in points], plot.scale),
        _around([each.y_m for each in points], plot.scale),
    )
    across_px = WIDTH_PX - LEFT_PX - RIGHT_PX
    wide_m = max(east_m - west_m, (north_m - south_m) * across_px / _MAP)
    middle_m = (west_m + east_m) / 2, (south_m + north_m) / 2
    half_m = wide_m / 2, wide_m * _MAP / across_px / 2
    axes.set(
        xlim=(middle_m[0] - half_m[0], middle_m[0] + half_m[0]),
        ylim=(middle_m[1] - half_m[1], middle_m[1] + half_m[1]),
        xlabel="x in m",
        ylabel="y in m",
    )
    axes.tick_params(labelsize=10 * POINT)
    axes.autoscale(False)
    draw_zones(axes, plot.zones)
    order = list(_LOOKS)
    for track in sorted(plot.tracks, key=lambda each: order.index(each.source)):
        places = thinned([pose.point for pose in track.poses])
        style = {**_LOOKS[track.source], "drawstyle": "default"}
        axes.plot([each.x_m for each in places], [each.y_m for each in places], **style)
    shown = next((track for track in plot.tracks if track.poses), None)
    if shown is None:
        centre: Any = {"transform": axes.transAxes, "ha": "center", "color": FAINT}
        axes.text(0.5, 0.5, "no odometry was heard", **centre)
        return
    for pose, colour in ((shown.poses[0], FAINT), (shown.poses[-1], INK)):
        draw_rover(axes, pose, plot.scale, colour)
    draw_incidents(axes, plot.incidents)


def _around(places_m: Sequence[float], scale: float) -> tuple[float, float]:
    """Return from where to where a map reaches that shows all places."""
    low_m, high_m = min(places_m, default=0.0), max(places_m, default=0.0)
    return low_m - scale * _AROUND_M, high_m + scale * _AROUND_M


def _draw_rows(axes: Axes, plot: RunPlot, rows_px: float) -> None:
    axes.set(xlim=(0, max(plot.end_s, 0.2)), ylim=(rows_px, 0))
    axes.yaxis.set_visible(False)
    top = draw_commands(axes, plot.commands) + _GAP
    for name, times_s in plot.events:
        name_row(axes, top, name, EVENT["color"])
        axes.plot(times_s, [top + ROW_PX / 2] * len(times_s), **EVENT)
        top += ROW_PX
    draw_modes(axes, plot.modes, top)


def _draw_panel(axes: Axes, panel: Panel) -> None:
    """Draw figures over time on one scale, which holds zero."""
    values = [value for each in panel.series for value in each.values if isfinite(value)]
    low = min(0.0, min(values, default=0.0))
    high = max(_LEAST.get(panel.unit, 0.0), max(values, default=0.0))
    margin = 0.12 * (high - low)
    axes.set_ylim(low - margin, high + margin)
    axes.yaxis.set_major_locator(MaxNLocator(4))
    axes.tick_params(axis="y", length=0, labelcolor=FAINT, labelsize=10 * POINT)
    axes.grid(axis="y", color=GRID)
    axes.axhline(0, color=FAINT, linewidth=0.8 * POINT)
    middle = (low + high) / 2
    write_beside(axes, 46, middle, f"{panel.title}, {panel.unit}", color=INK, fontweight="bold")
    for each in panel.series:
        axes.plot(np.array(each.times_s), np.array(each.values), **_LOOKS[each.source])


def _add_words(figure: Figure, ground: Axes, plot: RunPlot, height: float) -> None:
    """Say beside the map what the colours mean, and the figures of the run."""
    sources = {each.source for panel in plot.panels for each in panel.series}
    sources |= {track.source for track in plot.tracks}
    entries = [source for source in reversed(_LOOKS) if source in sources]
    handles = [ground.plot([], [], **_LOOKS[source])[0] for source in entries]
    left, top = 46 / WIDTH_PX, 1 - _TOP / height
    figure.text(left, top, "\n".join(plot.figures), va="top", linespacing=1.7)
    below = top - (24 * len(plot.figures) + 14) / height
    figure.legend(
        handles,
        [source.value for source in entries],
        loc="upper left",
        bbox_to_anchor=(left, below),
        borderaxespad=0.0,
        borderpad=0.0,
        handlelength=3,
        labelspacing=0.8,
    )
