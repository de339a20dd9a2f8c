"""What a recording holds, as the plot of a run."""

from collections import defaultdict
from itertools import pairwise
from math import cos, degrees, nan, sin
from pathlib import Path
from statistics import mean
from typing import Final

from adapters.recording import RecordingError, RunReader, Timed, read_timed
from executive.commands import Mode, declaration_of
from executive.geometry import Pose, wrap_rad
from executive.recording import (
    Call,
    Called,
    CarriedOut,
    Drove,
    Halted,
    Life,
    ModeChanged,
    Observed,
    Reported,
    Served,
    Truth,
)
from executive.reports import TERMINAL, Identity, Kind, Report, Severity, Stage
from executive.settings import LocomotionKind, Settings
from executive.state import Joints, Odometry, SecondOdometry
from executive.zones import Zones
from sim.drawing import (
    COMMANDED,
    ODOMETRY,
    SECOND,
    TRUTH,
    WHEELS,
    CommandLane,
    Incident,
    Panel,
    RunPlot,
    Series,
    Track,
    as_png,
    as_svg,
    draw_run,
)

SPEED_OVER_S: Final = 0.2
"""Between poses that a speed is taken from."""
SILENT_S: Final = 1.0
"""A line is not drawn over a longer time without figures."""
BOUND: Final = "bound"
"""The name of the figure that others are compared with."""
SMALL_ROVER: Final = 0.5
"""How large a MOCUP is beside a Jackal."""
_KINDS: Final = (
    Odometry,
    SecondOdometry,
    Joints,
    Served,
    Drove,
    Halted,
    CarriedOut,
    Reported,
    ModeChanged,
    Truth,
)
_SOURCES: Final = (ODOMETRY, SECOND, TRUTH)
Sample = tuple[float, float, float]
"""Time, travel speed in m/s, turn rate in rad/s."""


def write_plot(recording: Path, path: Path) -> None:
    """Write the plot of a recording, as SVG if the file is named so, else as PNG.

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
    """Return what the plot of a recording shows.

    Raises:
        RecordingError: the file cannot be used as a recording.
    """
    reader = _Reader()
    for each in read_timed(RunReader(recording), _KINDS):
        reader.take(each)
    return reader.plot(recording)


class _Reader:
    def __init__(self) -> None:
        self._settings: Settings | None = None
        self._gone: list[tuple[float, float]] = []
        self._last_s = 0.0
        self._end_s = 0.0
        self._ticks = 0
        self._poses: dict[str, list[tuple[float, Pose]]] = {source: [] for source in _SOURCES}
        self._commanded: list[Sample] = []
        self._told: list[Sample] = []
        self._wheels: list[Sample] = []
        self._modes: list[tuple[float, Mode]] = []
        self._served: dict[Identity, list[float]] = {}
        self._names: dict[Identity, str] = {}
        self._reports: list[tuple[float, Report]] = []

    def take(self, timed: Timed) -> None:
        time_s = timed.time_s
        self._end_s = max(self._end_s, time_s)
        match timed.item:
            case Life(settings=settings):
                if self._settings is not None:
                    self._gone.append((self._last_s, time_s))
                self._settings = settings
            case Called(call=call):
                self._ticks += call is Call.TICK
                self._last_s = time_s
            case Observed(fact=fact):
                match fact:
                    case Odometry(pose=pose, velocity=speed):
                        self._poses[ODOMETRY].append((time_s, pose))
                        self._told.append((time_s, speed.travel_mps, speed.rotate_radps))
                    case SecondOdometry(pose=pose):
                        self._poses[SECOND].append((time_s, pose))
                    case Joints():
                        self._turned(time_s, fact)
                    case _:
                        pass
            case Truth(pose=pose):
                self._poses[TRUTH].append((time_s, pose))
            case Drove(velocity=speed):
                self._commanded.append((time_s, speed.travel_mps, speed.rotate_radps))
            case Halted():
                self._commanded.append((time_s, 0.0, 0.0))
            case Served(command=command):
                self._served.setdefault(command.identity, []).append(time_s)
                self._names[command.identity] = declaration_of(type(command.request)).name
            case Reported(report=report):
                self._reports.append((time_s, report))
            case ModeChanged(mode=mode):
                self._modes.append((time_s, mode))
            case _:
                pass

    def _turned(self, time_s: float, fact: Joints) -> None:
        wheels = self._settings.sensors.joints if self._settings is not None else None
        if wheels is None or not fact.left_radps or not fact.right_radps:
            return
        left_mps = wheels.wheel_radius_m * mean(fact.left_radps)
        right_mps = wheels.wheel_radius_m * mean(fact.right_radps)
        rotate_radps = (right_mps - left_mps) / wheels.track_m
        self._wheels.append((time_s, (left_mps + right_mps) / 2, rotate_radps))

    def plot(self, recording: Path) -> RunPlot:
        settings = self._settings
        small = settings is not None and settings.locomotion is LocomotionKind.WHOLE_MOTION
        asset = settings.asset if settings is not None else "a rover"
        samples = {
            COMMANDED: self._commanded,
            WHEELS: self._wheels,
            ODOMETRY: self._told,
            SECOND: _speeds(self._poses[SECOND]),
            TRUTH: _speeds(self._poses[TRUTH]),
        }
        return RunPlot(
            title=f"{asset}: {recording.absolute().parent.name}/{recording.name}",
            end_s=self._end_s,
            figures=self._figures(),
            tracks=self._tracks(),
            commands=tuple(self._lane(each) for each in self._identities()),
            events=self._events(),
            modes=self._spans(),
            panels=(_panel("speed", "m/s", samples, 1), _panel("turn rate", "rad/s", samples, 2)),
            incidents=self._incidents(),
            gone=tuple(self._gone),
            zones=settings.zones if settings is not None else Zones(),
            scale=SMALL_ROVER if small else 1.0,
        )

    def _figures(self) -> tuple[str, ...]:
        lines = [f"{self._end_s:.1f} s, {self._ticks} ticks"]
        if self._gone:
            lines.append(f"{1 + len(self._gone)} starts of the executive")
        poses = self._poses[TRUTH] or self._poses[ODOMETRY]
        if poses:
            kept = [pose.point for _, pose in poses[:1]]
            way_m = 0.0
            for _, pose in poses:
                step_m = pose.point.distance_m(kept[-1])
                if step_m >= 0.02:
                    way_m += step_m
                    kept.append(pose.point)
            end = poses[-1][1]
            lines.append(f"{way_m:.2f} m driven")
            turned = degrees(end.heading_rad)
            lines.append(f"at the end x {end.x_m:z.2f} y {end.y_m:z.2f}, {turned:z.0f}°")
        return tuple(lines)

    def _tracks(self) -> tuple[Track, ...]:
        """Return the tracks, that of the second odometry turned to begin where the first does."""
        tracks = {source: [pose for _, pose in found] for source, found in self._poses.items()}
        if tracks[SECOND] and tracks[ODOMETRY]:
            tracks[SECOND] = _beginning(tracks[SECOND], tracks[ODOMETRY][0])
        return tuple(Track(source, tuple(poses)) for source, poses in tracks.items() if poses)

    def _identities(self) -> list[Identity]:
        reported = (report.identity for _, report in self._reports if report.kind is Kind.COMMAND)
        return list(dict.fromkeys([*self._served, *(each for each in reported if each)]))

    def _lane(self, identity: Identity) -> CommandLane:
        life = [
            (time_s, report)
            for time_s, report in self._reports
            if report.identity == identity and report.stage is not None
        ]
        end = next((each for each in life if each[1].stage in TERMINAL), None)
        _, last = end or (life[-1] if life else (0.0, None))
        when = {report.stage: time_s for time_s, report in reversed(life)}
        reason = "" if last is None or last.reason is None else last.reason.name
        return CommandLane(
            title=f"{self._names.get(identity, 'command')} {identity}",
            sent_s=tuple(self._served.get(identity, ())),
            received_s=when.get(Stage.RECEIVED),
            started_s=when.get(Stage.STARTED),
            ended_s=end[0] if end is not None else None,
            last=last.stage if last is not None else None,
            words=reason,
            figures=_told(last) if reason and last is not None else "",
        )

    def _events(self) -> tuple[tuple[str, tuple[float, ...]], ...]:
        """Return what was reported as a warning or worse beside the commands."""
        events: defaultdict[str, list[float]] = defaultdict(list)
        for time_s, report in self._reports:
            if report.kind is Kind.EVENT and report.severity is not Severity.INFORMATIONAL:
                name = report.reason.name if report.reason is not None else report.text
                events[name].append(time_s)
        return tuple((name, tuple(times_s)) for name, times_s in events.items())

    def _spans(self) -> tuple[tuple[Mode, float, float], ...]:
        """Return the modes, each until the next or until the executive was gone."""
        ends_s = [*(begin_s for begin_s, _ in self._modes[1:]), self._end_s]
        merged: list[tuple[Mode, float, float]] = []
        for (begin_s, mode), next_s in zip(self._modes, ends_s, strict=False):
            end_s = min([next_s, *(gone_s for gone_s, _ in self._gone if gone_s > begin_s)])
            if merged and merged[-1][0] is mode and merged[-1][2] == begin_s:
                begin_s = merged.pop()[1]
            merged.append((mode, begin_s, end_s))
        return tuple(merged)

    def _incidents(self) -> tuple[Incident, ...]:
        """Return where commands failed, as the first of the tracks tells."""
        poses = self._poses[TRUTH] or self._poses[ODOMETRY]
        failed = {
            report.identity: (time_s, report.reason.name)
            for time_s, report in reversed(self._reports)
            if report.stage is Stage.FAILED and report.reason is not None and poses
        }
        return tuple(
            Incident(min(poses, key=lambda each: abs(each[0] - time_s))[1], words)
            for time_s, words in failed.values()
        )


def _told(report: Report) -> str:
    """Return the figures of a report up to their bound: what was measured, and against what."""
    figures = list(report.figures)
    bounds = [at for at, each in enumerate(figures) if each.name == BOUND]
    kept = figures[: bounds[0] + 1] if bounds else []
    return ", ".join(f"{each.name} {each.value:.3g} {each.unit}".rstrip() for each in kept)


def _panel(title: str, unit: str, samples: dict[str, list[Sample]], column: int) -> Panel:
    series = []
    for source, rows in samples.items():
        times_s: list[float] = []
        values: list[float] = []
        for row in rows:
            if times_s and row[0] - times_s[-1] > SILENT_S:
                times_s.append(times_s[-1])
                values.append(nan)
            times_s.append(row[0])
            values.append(row[column])
        if rows:
            series.append(Series(source, tuple(times_s), tuple(values)))
    return Panel(title, unit, tuple(series))


def _speeds(poses: list[tuple[float, Pose]]) -> list[Sample]:
    """Return the speeds ahead and about from poses that are some time apart."""
    kept = poses[:1]
    for each in poses:
        if each[0] - kept[-1][0] >= SPEED_OVER_S - 1e-6:
            kept.append(each)
    found = []
    for (begin_s, begin), (end_s, end) in pairwise(kept):
        taken_s = end_s - begin_s
        if taken_s > SILENT_S:
            continue
        turned_rad = wrap_rad(end.heading_rad - begin.heading_rad)
        along_rad = begin.heading_rad + turned_rad / 2
        ahead_m = (end.x_m - begin.x_m) * cos(along_rad) + (end.y_m - begin.y_m) * sin(along_rad)
        found.append(((begin_s + end_s) / 2, ahead_m / taken_s, turned_rad / taken_s))
    return found


def _beginning(poses: list[Pose], start: Pose) -> list[Pose]:
    """Return poses moved and turned so that the first is the start."""
    first = poses[0]
    turn_rad = start.heading_rad - first.heading_rad
    moved = []
    for pose in poses:
        far_m = first.point.distance_m(pose.point)
        along_rad = first.point.bearing_rad(pose.point) + turn_rad
        place = Pose(start.x_m, start.y_m, heading_rad=along_rad).ahead(far_m)
        moved.append(Pose(place.x_m, place.y_m, heading_rad=pose.heading_rad + turn_rad))
    return moved
