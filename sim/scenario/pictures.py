"""Map, timeline and reports of a run that was recorded, as files in a folder."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from enum import Enum
from itertools import groupby, pairwise
from math import degrees
from pathlib import Path
from typing import Final

from cattrs.preconf.json import make_converter

from executive.commands import (
    Line,
    Mode,
    Motion,
    Reference,
    Request,
    Stop,
    TakePicture,
    Turn,
    Waypoint,
)
from executive.history import CommandHistory
from executive.settings import LocomotionKind
from executive.values.geometry import Pose
from executive.values.parameters import Parameter
from executive.values.reports import Identity, Stage
from sim.drawing import (
    CommandLane,
    DriveMap,
    Incident,
    RunTimeline,
    TimeSpan,
    draw_map,
    draw_timeline,
    events_of,
    lane_of,
    write_drawing,
)
from sim.scenario.model import Cargo, Crash, Eclipse, Scenario
from sim.scenario.record import AdmittedRequest, Record, TruePose
from sim.scenario.truth import true_ends

REPORTS: Final = "reports.jsonl"
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
    path = folder / REPORTS
    with path.open("w", encoding="utf-8") as file:
        for report in record.reports:
            label = record.label(report.identity) if report.identity else None
            told = {"time_s": round(record.time_of(report), 3), "label": label}
            file.write(json.dumps(told | converter.unstructure(report)) + "\n")
    return path


def drive_of(scenario: Scenario, record: Record) -> DriveMap:
    """Return what the map of a run shows."""
    poses = record.poses or [TruePose(0.0, scenario.world.start_pose)]
    small = scenario.settings.locomotion is LocomotionKind.WHOLE_MOTION
    lives = record.lives()

    def at(request: AdmittedRequest, stage: Stage) -> Pose | None:
        life = lives.get(request.identity)
        report = None if life is None else life.at(stage)
        return None if report is None else _at(poses, record.time_of(report))

    def where(kind: type, stage: Stage) -> tuple[Pose, ...]:
        found = (at(each, stage) for each in record.requested if isinstance(each.request, kind))
        return tuple(pose for pose in found if pose is not None)

    started = ((each.request, at(each, Stage.STARTED)) for each in record.requested)
    end = poses[-1].pose
    return DriveMap(
        title=f"{scenario.title}: the drive, world “{scenario.world.name}”",
        world=scenario.world,
        planned=tuple(place for request, pose in started if pose for place in _to(request, pose)),
        driven=tuple(_odometry(record)),
        true=tuple(seen.pose for seen in poses),
        stops=where(Stop, Stage.EXECUTED),
        views=where(TakePicture, Stage.EXECUTED),
        figures=(
            f"{record.simulated_s:.1f} s",
            f"at the end x {end.x_m:z.2f} y {end.y_m:z.2f}, {degrees(end.heading_rad):z.0f}°",
        ),
        scale=SMALL_ROVER if small else 1.0,
        zones=scenario.settings.zones,
        seen=record.seen,
        incidents=tuple(
            Incident(_at(poses, time_s), words)
            for time_s, words in sorted(_incidents(scenario, record))
        ),
    )


def timeline_of(scenario: Scenario, record: Record) -> RunTimeline:
    """Return what the timeline of a run shows."""
    lives = record.lives()
    identities = list(dict.fromkeys([*(sent.identity for sent in record.sendings), *lives]))
    return RunTimeline(
        title=scenario.title,
        end_s=record.simulated_s,
        commands=tuple(_lane(record, each, lives.get(each)) for each in identities),
        faults=tuple(_faults(scenario, record)),
        events=events_of({each.sequence: each for each in record.reports}.values(), record.time_of),
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


def _at(poses: Sequence[TruePose], time_s: float) -> Pose:
    """Return where the rover truly was."""
    return min(poses, key=lambda seen: abs(seen.time_s - time_s)).pose


def _to(request: Request, pose: Pose) -> tuple[Waypoint, ...]:
    """Return where a motion goes that begins at a pose, as far as it says so."""
    places: list[Waypoint] = []
    for segment in request.segments(pose) if isinstance(request, Motion) else ():
        match segment:
            case Line(end=end):
                places.append(Waypoint(end.x_m, end.y_m))
            case Turn(end=end, reference=Reference.FRAME) if places:
                places[-1] = replace(places[-1], heading_rad=end.heading_rad)
            case _:
                pass
    return tuple(places)


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
    """Yield when something went wrong, and what."""
    untrue = {end.label: end.wrong.split(", of ")[0] for end in true_ends(record) if end.wrong}
    for span in _faults(scenario, record):
        yield span.begin_s, span.name
    for identity, life in record.lives().items():
        label, end = record.label(identity), life.end
        if end is not None and end.stage is Stage.FAILED:
            reason = f": {end.reason.name}" if end.reason else ""
            yield record.time_of(end), f"{label} FAILED{reason}"
        elif end is not None and end.stage is Stage.EXECUTED and label in untrue:
            yield record.time_of(end), f"{label} EXECUTED, but {untrue[label]}"


def _faults(scenario: Scenario, record: Record) -> Iterator[TimeSpan]:
    """Yield what was done to the rover, each until it ended or the run did."""
    end_s = record.simulated_s
    begun_s: dict[str, float] = {}
    for fault in record.faults:
        if fault.begins:
            begun_s.setdefault(fault.name, fault.time_s)
        elif fault.name in begun_s:
            yield TimeSpan(fault.name, begun_s.pop(fault.name), fault.time_s)
    for name, time_s in begun_s.items():
        yield TimeSpan(name, time_s, end_s)
    for entry in scenario.timeline:
        begin_s = record.moment(entry)
        if begin_s is None or begin_s > end_s:
            continue
        match entry:
            case Crash(crash_s=down_s):
                yield TimeSpan("executive lost", begin_s, min(end_s, begin_s + down_s))
            case Cargo(cargo_kg=mass_kg):
                yield TimeSpan(f"cargo {mass_kg:g} kg", begin_s, end_s)
            case _:
                pass


def _lane(record: Record, identity: Identity, life: CommandHistory | None) -> CommandLane:
    sent = [each for each in record.sendings if each.identity == identity]
    answers = ", ".join(dict.fromkeys(each.answer.value for each in sent))
    sent_s = [each.time_s for each in sent]
    return lane_of(life, record.time_of, record.label(identity), sent_s, answers)


def _modes(record: Record) -> Iterator[tuple[Mode, float, float]]:
    """Yield each mode, from when it was seen first to when another was."""
    runs = [(mode, next(seen).time_s) for mode, seen in groupby(record.modes, lambda s: s.mode)]
    ends_s = [*(begin_s for _, begin_s in runs[1:]), record.simulated_s]
    for (mode, begin_s), end_s in zip(runs, ends_s, strict=True):
        yield mode, begin_s, end_s
