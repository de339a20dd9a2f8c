"""Map, timeline and reports of a run that was recorded, as files in a folder."""

import json
from collections.abc import Iterator, Sequence
from enum import Enum
from itertools import groupby, pairwise
from math import degrees, inf
from pathlib import Path
from typing import Final

from cattrs.preconf.json import make_converter

from executive.commands import (
    FollowPath,
    Mode,
    MoveForward,
    MoveTo,
    Request,
    Stop,
    TakePicture,
    Waypoint,
)
from executive.geometry import Pose
from executive.reports import Kind, Stage
from executive.settings import LocomotionKind
from executive.state import Parameter
from sim.drawing import (
    CommandLane,
    Drive,
    Incident,
    RunTimeline,
    Span,
    draw_map,
    draw_timeline,
    write_drawing,
)
from sim.rover.faults import fault_declaration
from sim.scenario.model import Cargo, Clear, Crash, Eclipse, Inject, Scenario, Send
from sim.scenario.record import Record, TruePose

SMALL_ROVER: Final = 0.5
"""How large a MOCUP is beside a Jackal."""


def write_run(folder: Path, scenario: Scenario, record: Record) -> tuple[Path, ...]:
    """Write map, timeline and reports of a run into a folder, and return the files."""
    return (
        *write_drawing(folder, "map", draw_map(drive_of(scenario, record))),
        *write_drawing(folder, "timeline", draw_timeline(timeline_of(scenario, record))),
        _write_reports(folder, record),
    )


def _write_reports(folder: Path, record: Record) -> Path:
    """Write every report that was heard as JSON, one a line, names instead of numbers."""
    converter = make_converter()
    converter.register_unstructure_hook_func(
        lambda kind: isinstance(kind, type) and issubclass(kind, Enum), lambda value: value.name
    )
    labels = {sent.identity: sent.label for sent in reversed(record.sendings)}
    path = folder / "reports.jsonl"
    with path.open("w", encoding="utf-8") as file:
        for report in record.reports:
            label = labels.get(report.identity) if report.identity else None
            told = {"time_s": round(record.time_of(report), 3), "label": label}
            file.write(json.dumps(told | converter.unstructure(report)) + "\n")
    return path


def drive_of(scenario: Scenario, record: Record) -> Drive:
    """Return what the map of a run shows."""
    poses = record.poses or [TruePose(0.0, scenario.world.start_pose)]
    small = scenario.settings.locomotion is LocomotionKind.WHOLE_MOTION
    started = [
        (send.command, _at(poses, time_s))
        for send in _sends(scenario)
        if (time_s := _time_of(record, send.name, Stage.STARTED)) is not None
    ]
    executed = [
        (send.command, _at(poses, time_s))
        for send in _sends(scenario)
        if (time_s := _time_of(record, send.name, Stage.EXECUTED)) is not None
    ]
    end = poses[-1].pose
    return Drive(
        title=f"{scenario.title}: the drive, world “{scenario.world.name}”",
        world=scenario.world,
        planned=tuple(place for command, pose in started for place in _planned(command, pose)),
        driven=tuple(_odometry(record)),
        true=tuple(seen.pose for seen in poses),
        stops=tuple(pose for command, pose in executed if isinstance(command, Stop)),
        views=tuple(pose for command, pose in executed if isinstance(command, TakePicture)),
        figures=(
            f"{record.simulated_s:.1f} s",
            f"at the end x {end.x_m:z.2f} y {end.y_m:z.2f}, {degrees(end.heading_rad):z.0f}°",
        ),
        scale=SMALL_ROVER if small else 1.0,
        incidents=tuple(
            Incident(_at(poses, time_s), words)
            for time_s, words in sorted(_incidents(scenario, record))
        ),
    )


def timeline_of(scenario: Scenario, record: Record) -> RunTimeline:
    """Return what the timeline of a run shows."""
    events: dict[str, list[float]] = {}
    for report in {report.sequence: report for report in record.reports}.values():
        if report.kind is Kind.EVENT:
            name = report.reason.name if report.reason else report.text
            events.setdefault(name, []).append(record.time_of(report))
    labels = list(dict.fromkeys(sent.label for sent in record.sendings))
    return RunTimeline(
        title=scenario.title,
        end_s=record.simulated_s,
        commands=tuple(_lane(record, label) for label in labels),
        faults=tuple(_faults(scenario, record)),
        events=tuple((name, tuple(times_s)) for name, times_s in events.items()),
        modes=tuple(_modes(record)),
        speeds=tuple(
            (end.time_s, start.pose.point.distance_m(end.pose.point) / (end.time_s - start.time_s))
            for start, end in pairwise(record.poses)
            if end.time_s > start.time_s
        ),
        eclipses=tuple(
            (begin_s, min(begin_s + entry.eclipse_s, record.simulated_s))
            for entry in scenario.timeline
            if isinstance(entry, Eclipse) and (begin_s := record.moment(entry)) is not None
        ),
    )


def _sends(scenario: Scenario) -> list[Send]:
    return [entry for entry in scenario.timeline if isinstance(entry, Send)]


def _time_of(record: Record, label: str, stage: Stage) -> float | None:
    """Return when a command first reached a stage."""
    life = record.life(label)
    return next((record.time_of(report) for report in life if report.stage is stage), None)


def _at(poses: Sequence[TruePose], time_s: float) -> Pose:
    """Return where the rover truly was."""
    return min(poses, key=lambda seen: abs(seen.time_s - time_s)).pose


def _planned(command: Request, pose: Pose) -> tuple[Waypoint, ...]:
    """Return where a motion goes that begins at a pose, as far as it says so."""
    match command:
        case MoveTo(target):
            return (target,)
        case FollowPath(waypoints):
            return waypoints
        case MoveForward(distance_m):
            there = pose.ahead(distance_m)
            return (Waypoint(there.x_m, there.y_m),)
        case _:
            return ()


def _odometry(record: Record) -> Iterator[Pose]:
    """Yield where telemetry said that the rover was."""
    for _, batch in groupby(record.values, key=lambda value: value.time_s):
        known = {value.parameter: value.value for value in batch}
        x_m, y_m = known.get(Parameter.POS_X), known.get(Parameter.POS_Y)
        if x_m is not None and y_m is not None:
            pose = Pose(x_m, y_m)
            if pose.finite:
                yield pose


def _incidents(scenario: Scenario, record: Record) -> Iterator[tuple[float, str]]:
    for span in _faults(scenario, record):
        yield span.begin_s, span.name
    for label in dict.fromkeys(sent.label for sent in record.sendings):
        failed_s = _time_of(record, label, Stage.FAILED)
        if failed_s is not None:
            reason = record.life(label)[-1].reason
            yield failed_s, f"{label} FAILED{f': {reason.name}' if reason else ''}"


def _faults(scenario: Scenario, record: Record) -> Iterator[Span]:
    """Yield what was done to the rover, each until it was cleared or the run ended."""
    end_s = record.simulated_s
    for entry in scenario.timeline:
        begin_s = record.moment(entry)
        if begin_s is None or begin_s > end_s:
            continue
        match entry:
            case Inject(inject=fault):
                cleared_s = (
                    record.moment(other)
                    for other in scenario.timeline
                    if isinstance(other, Clear) and other.clear is type(fault)
                )
                ends_s = (time_s for time_s in cleared_s if time_s and time_s >= begin_s)
                name = fault_declaration(type(fault)).name
                yield Span(name, begin_s, min(end_s, min(ends_s, default=inf)))
            case Crash(crash_s=down_s):
                yield Span("executive lost", begin_s, min(end_s, begin_s + down_s))
            case Cargo(cargo_kg=mass_kg):
                yield Span(f"cargo {mass_kg:g} kg", begin_s, end_s)
            case _:
                pass


def _lane(record: Record, label: str) -> CommandLane:
    life = record.life(label)
    last = life[-1] if life else None
    answers = [sent.answer.value for sent in record.sendings if sent.label == label]
    words = ", ".join(dict.fromkeys(answers)) if last is None else ""
    if last is not None and last.reason is not None:
        words = last.reason.name
    ended = last is not None and last.stage is not None and last.stage.terminal
    return CommandLane(
        title=label,
        sent_s=tuple(sent.time_s for sent in record.sendings if sent.label == label),
        received_s=_time_of(record, label, Stage.RECEIVED),
        started_s=_time_of(record, label, Stage.STARTED),
        ended_s=record.time_of(last) if last is not None and ended else None,
        last=last.stage if last is not None else None,
        words=words,
    )


def _modes(record: Record) -> Iterator[tuple[Mode, float, float]]:
    """Yield each mode, from when it was seen first to when another was."""
    runs = [(mode, next(seen).time_s) for mode, seen in groupby(record.modes, lambda s: s.mode)]
    ends_s = [*(begin_s for _, begin_s in runs[1:]), record.simulated_s]
    for (mode, begin_s), end_s in zip(runs, ends_s, strict=True):
        yield mode, begin_s, end_s
