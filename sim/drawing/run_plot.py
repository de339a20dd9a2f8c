"""`write_plot` draws a recording: its map, then commands, events, modes, speeds over time."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import cos, degrees, nan, sin
from pathlib import Path
from typing import Any, Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from adapters.recording import RecordingError, RunReader, read_timed
from executive.commands import Mode
from executive.history import RunHistory
from executive.history.history_builder import KINDS, HistoryBuilder
from executive.history.motion_tracks import (
    TRACK_KINDS,
    MotionTracks,
    PoseAt,
    TrackSource,
    VelocityAt,
)
from executive.obstacles.zones import Zones
from executive.settings import LocomotionKind
from executive.values.geometry import Pose, Velocity, wrap_rad
from executive.values.reports import Report, Severity, Stage
from sim.drawing.lanes import LEFT_PX, RIGHT_PX, STYLES, WIDTH_PX, Panel, Series
from sim.drawing.map import (
    SMALL_ROVER,
    SOIL,
    Incident,
    draw_incidents,
    draw_rover,
    draw_zones,
    thinned,
)
from sim.drawing.style import FAINT, INK, POINT, as_png, as_svg, styled_figure
from sim.drawing.timeline import (
    CommandLane,
    RunTimeline,
    draw_rows,
    events_of,
    grid_position,
    lane_of,
    panel_heights_px,
)

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


SPEED_OVER_S: Final = 0.2
"""Minimum time between the poses of a speed."""
SILENT_S: Final = 1.0
"""Maximum time between values that a line connects."""
BOUND: Final = "bound"
"""Name of the figure that is the bound in a report."""


def write_plot(recording: Path, path: Path) -> None:
    """Write the plot of a recording, as SVG for the suffix `.svg`, else as PNG.

    Raises:
        RecordingError: the file cannot be used as a recording.
        OSError: the picture cannot be written.
    """
    try:
        figure = draw_run(plot_of(recording))
        drawn = as_svg(figure).encode() if path.suffix == ".svg" else as_png(figure)
    except (OverflowError, ValueError) as error:
        raise RecordingError(f"{recording}: holds figures that cannot be drawn: {error}") from error
    path.write_bytes(drawn)


def plot_of(recording: Path) -> RunPlot:
    """Return the data of a recording's plot.

    Raises:
        RecordingError: the file cannot be used as a recording.
    """
    history, tracks = HistoryBuilder(lambda _: frozenset()), MotionTracks()
    began_utc_s = end_utc_s = 0.0
    for each in read_timed(RunReader(recording), (*KINDS, *TRACK_KINDS)):
        began_utc_s = began_utc_s or each.utc_s
        end_utc_s = max(end_utc_s, each.utc_s)
        history.put(each.item)
        tracks.put(each.item)
    title = f"{recording.absolute().parent.name}/{recording.name}"
    return _Plot(history.history(), tracks, began_utc_s, end_utc_s).plot(title)


class _Plot:
    """Builder of a plot; its times are seconds since the beginning of the recording."""

    def __init__(
        self, history: RunHistory, tracks: MotionTracks, began_utc_s: float, end_utc_s: float
    ) -> None:
        self._history, self._tracks = history, tracks
        self._began_utc_s, self._end_s = began_utc_s, end_utc_s - began_utc_s
        self._track = tracks.poses[TrackSource.TRUTH] or tracks.poses[TrackSource.ODOMETRY]
        self._absences = [
            (self._since(begin_s), self._since(end_s)) for begin_s, end_s in history.absences
        ]

    def plot(self, name: str) -> RunPlot:
        settings = self._tracks.settings
        small = settings is not None and settings.locomotion is LocomotionKind.DELEGATED
        asset = settings.asset if settings is not None else "a rover"
        velocities = self._tracks.velocities | {
            source: _speeds(self._tracks.poses[source])
            for source in (TrackSource.SECOND, TrackSource.TRUTH)
        }
        worrying = (
            each for each in self._history.reports if each.severity is not Severity.INFORMATIONAL
        )
        panels = [
            self._panel("speed", "m/s", velocities),
            self._panel("turn rate", "rad/s", velocities),
        ]
        timeline = RunTimeline(
            title=f"{asset}: {name}",
            end_s=self._end_s,
            commands=tuple(self._lanes()),
            events=events_of(worrying, self._time_of),
            modes=self._modes(),
            panels=tuple(panel for panel in panels if panel.series),
            absences=tuple(self._absences),
        )
        return RunPlot(
            timeline=timeline,
            figures=self._figures(),
            tracks=self._drawn(),
            incidents=self._incidents(),
            zones=settings.zones if settings is not None else Zones(),
            scale=SMALL_ROVER if small else 1.0,
        )

    def _since(self, utc_s: float) -> float:
        return utc_s - self._began_utc_s

    def _time_of(self, report: Report) -> float:
        return self._since(report.utc_s)

    def _figures(self) -> tuple[str, ...]:
        lines = [f"{self._end_s:.1f} s"]
        if self._absences:
            lines.append(f"{1 + len(self._absences)} starts of the executive")
        poses = [each.pose for each in self._track]
        if poses:
            last, path_m = poses[0].point, 0.0
            for pose in poses:
                step_m = pose.point.distance_m(last)
                if step_m >= 0.02:
                    path_m += step_m
                    last = pose.point
            end = poses[-1]
            lines.append(f"{path_m:.2f} m driven")
            turned = degrees(end.heading_rad)
            lines.append(f"at the end x {end.x_m:z.2f} y {end.y_m:z.2f}, {turned:z.0f}°")
        return tuple(lines)

    def _drawn(self) -> tuple[Track, ...]:
        """Return the tracks; the second odometry is moved to start at odometry's first pose."""
        tracks = {
            source: [each.pose for each in found] for source, found in self._tracks.poses.items()
        }
        second, odometry = tracks[TrackSource.SECOND], tracks[TrackSource.ODOMETRY]
        if second and odometry:
            tracks[TrackSource.SECOND] = _beginning(second, odometry[0])
        return tuple(Track(source, tuple(poses)) for source, poses in tracks.items() if poses)

    def _lanes(self) -> Iterator[CommandLane]:
        histories, received = self._history.command_histories(), self._history.received
        names = {each.identity: each.name for each in received}
        for identity in dict.fromkeys([*names, *histories]):
            sent_s = [self._since(each.utc_s) for each in received if each.identity == identity]
            entry = histories.get(identity)
            title = f"{names.get(identity, 'command')} {identity}"
            lane = lane_of(entry, self._time_of, title, sent_s)
            last = None if entry is None else entry.end or entry.stages[-1]
            yield replace(lane, figures=_measured(last) if last and last.reason else "")

    def _modes(self) -> tuple[tuple[Mode, float, float], ...]:
        """Return the modes, each until the next or the end of the executive's process."""
        modes = [(self._since(each.utc_s), each.mode) for each in self._history.situations]
        ends_s = [*(begin_s for begin_s, _ in modes[1:]), self._end_s]
        merged: list[tuple[Mode, float, float]] = []
        for (begin_s, mode), next_s in zip(modes, ends_s, strict=False):
            end_s = min(
                [next_s, *(absent_s for absent_s, _ in self._absences if absent_s > begin_s)]
            )
            if merged and merged[-1][0] is mode and merged[-1][2] == begin_s:
                begin_s = merged.pop()[1]
            merged.append((mode, begin_s, end_s))
        return tuple(merged)

    def _incidents(self) -> tuple[Incident, ...]:
        """Return the failed commands with the rover's pose on the reference track."""
        ends = (entry.end for entry in self._history.command_histories().values())
        return tuple(
            Incident(_nearest(self._track, end.utc_s), end.reason.name)
            for end in ends
            if end and end.stage is Stage.FAILED and end.reason is not None and self._track
        )

    def _panel(
        self, title: str, unit: str, velocities: dict[TrackSource, list[VelocityAt]]
    ) -> Panel:
        series = []
        for source, samples in velocities.items():
            times_s: list[float] = []
            values: list[float] = []
            for each in samples:
                time_s, velocity = self._since(each.utc_s), each.velocity
                if times_s and time_s - times_s[-1] > SILENT_S:
                    times_s.append(times_s[-1])
                    values.append(nan)
                times_s.append(time_s)
                values.append(velocity.travel_mps if unit == "m/s" else velocity.rotate_radps)
            if samples:
                series.append(Series(source, tuple(times_s), tuple(values)))
        return Panel(title, unit, tuple(series))


def _nearest(track: Sequence[PoseAt], utc_s: float) -> Pose:
    return min(track, key=lambda each: abs(each.utc_s - utc_s)).pose


def _measured(report: Report) -> str:
    """Return the text of a report's measured figures and their bound; empty without a bound."""
    figures = list(report.figures)
    bounds = [at for at, each in enumerate(figures) if each.name == BOUND]
    shown = figures[: bounds[0] + 1] if bounds else []
    return ", ".join(f"{each.name} {each.value:.3g} {each.unit}".rstrip() for each in shown)


def _speeds(poses: Sequence[PoseAt]) -> list[VelocityAt]:
    """Return forward speed and turn rate from poses at least `SPEED_OVER_S` apart."""
    samples = list(poses[:1])
    for each in poses:
        if each.utc_s - samples[-1].utc_s >= SPEED_OVER_S - 1e-6:
            samples.append(each)
    found = []
    for one, other in pairwise(samples):
        begin, end, taken_s = one.pose, other.pose, other.utc_s - one.utc_s
        if taken_s > SILENT_S:
            continue
        turned_rad = wrap_rad(end.heading_rad - begin.heading_rad)
        along_rad = begin.heading_rad + turned_rad / 2
        ahead_m = (end.x_m - begin.x_m) * cos(along_rad) + (end.y_m - begin.y_m) * sin(along_rad)
        velocity = Velocity(ahead_m / taken_s, turned_rad / taken_s)
        found.append(VelocityAt((one.utc_s + other.utc_s) / 2, velocity))
    return found


def _beginning(poses: list[Pose], start: Pose) -> list[Pose]:
    """Return the poses moved and turned so that the first one is the start."""
    first = poses[0]
    turn_rad = start.heading_rad - first.heading_rad
    moved = []
    for pose in poses:
        far_m = first.point.distance_m(pose.point)
        along_rad = first.point.bearing_rad(pose.point) + turn_rad
        end = Pose(start.x_m, start.y_m, heading_rad=along_rad).ahead(far_m)
        moved.append(Pose(end.x_m, end.y_m, heading_rad=pose.heading_rad + turn_rad))
    return moved
