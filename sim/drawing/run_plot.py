"""`draw_run`: plot of a recorded run: its map, then commands, events, modes, speeds over time."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from executive.history.motion_tracks import TrackSource
from executive.obstacles.zones import Zones
from executive.values.geometry import Pose
from sim.drawing.lanes import LEFT_PX, RIGHT_PX, STYLES, WIDTH_PX
from sim.drawing.map import SOIL, Incident, draw_incidents, draw_rover, draw_zones, thinned
from sim.drawing.style import FAINT, INK, POINT, styled_figure
from sim.drawing.timeline import RunTimeline, draw_rows, grid_position, panel_heights_px

_TOP, _MAP, _BESIDE_MAP, _BOTTOM = 56, 380, 62, 52
_AROUND_M: Final = 0.6
"""Margin around the driven tracks."""


@dataclass(frozen=True, slots=True)
class Track:
    """Poses of the rover by one source."""

    source: TrackSource
    poses: tuple[Pose, ...]


@dataclass(frozen=True, slots=True)
class RunPlot:
    """Data of a run's plot; times in seconds since its beginning.

    Attributes:
        figures: lines of text beside the map.
        tracks: tracks in one frame.
        incidents: faults and failures.
        scale: size of the rover relative to the Jackal.
    """

    timeline: RunTimeline
    figures: tuple[str, ...]
    tracks: tuple[Track, ...]
    incidents: tuple[Incident, ...] = ()
    zones: Zones = field(default_factory=Zones)
    scale: float = 1.0


def draw_run(plot: RunPlot) -> Figure:
    """Return the plot of a run: the map, and below it the timeline."""
    heights = [_MAP, _BESIDE_MAP, *panel_heights_px(plot.timeline)]
    height = _TOP + sum(heights) + _BOTTOM
    with styled_figure(WIDTH_PX, height, plot.timeline.title) as figure:
        grid = figure.add_gridspec(len(heights), **grid_position(heights, _TOP, _BOTTOM))
        ground = figure.add_subplot(grid[0], facecolor=SOIL)
        first = figure.add_subplot(grid[2])
        others = [figure.add_subplot(grid[at], sharex=first) for at in range(3, len(heights))]
        _draw_map(ground, plot)
        draw_rows([first, *others], plot.timeline)
        _add_captions(figure, ground, plot, height)
    return figure


def _draw_map(axes: Axes, plot: RunPlot) -> None:
    """Draw the tracks to scale, with a margin."""
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
    order = list(STYLES)
    for track in sorted(plot.tracks, key=lambda each: order.index(each.source)):
        shape = thinned([pose.point for pose in track.poses])
        style = {**STYLES[track.source], "drawstyle": "default"}
        axes.plot([each.x_m for each in shape], [each.y_m for each in shape], **style)
    shown = next((track for track in plot.tracks if track.poses), None)
    if shown is None:
        centre: Any = {"transform": axes.transAxes, "ha": "center", "color": FAINT}
        axes.text(0.5, 0.5, "no odometry received", **centre)
        return
    for pose, colour in ((shown.poses[0], FAINT), (shown.poses[-1], INK)):
        draw_rover(axes, pose, plot.scale, colour)
    draw_incidents(axes, plot.incidents)


def _around(positions_m: Sequence[float], scale: float) -> tuple[float, float]:
    """Return the bounds of a map that contains all positions, in m."""
    low_m, high_m = min(positions_m, default=0.0), max(positions_m, default=0.0)
    return low_m - scale * _AROUND_M, high_m + scale * _AROUND_M


def _add_captions(figure: Figure, ground: Axes, plot: RunPlot, height: float) -> None:
    """Add the figures of the run and the legend of the colours beside the map."""
    sources = {each.source for panel in plot.timeline.panels for each in panel.series}
    sources |= {track.source for track in plot.tracks}
    entries = [source for source in reversed(STYLES) if source in sources]
    handles = [ground.plot([], [], **STYLES[source])[0] for source in entries]
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
