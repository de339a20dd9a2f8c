"""`write_run` writes the map, the timeline and the reports of a run into a folder."""

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from enum import Enum
from itertools import accumulate, groupby, pairwise
from math import degrees
from pathlib import Path
from typing import Final

from cattrs.preconf.json import make_converter

from adapters.mrs.ground import DTN_QUEUED
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
from executive.history.motion_tracks import TrackSource
from executive.settings import LocomotionKind
from executive.values.geometry import Pose
from executive.values.parameters import Parameter
from executive.values.reports import Identity, Report, Stage
from sim.drawing import (
    SHORT_S,
    SMALL_ROVER,
    CommandLane,
    DriveMap,
    Incident,
    Levels,
    Panel,
    Passage,
    ReportTimes,
    RunTimeline,
    Series,
    TimeSpan,
    draw_map,
    draw_timeline,
    events_of,
    lane_of,
    write_drawing,
)
from sim.scenario.model import Cargo, Crash, Outage, Scenario
from sim.scenario.record import Receipt, Record, TruePose
from sim.scenario.sent import RELAY, CommandTrace, sent_commands
from sim.scenario.truth import path_length_m, true_ends

REPORTS: Final = "reports.jsonl"


def write_run(folder: Path, scenario: Scenario, record: Record) -> tuple[Path, ...]:
    """Write map, timeline and reports of a run into a folder, and return the paths."""
    return (
        *write_drawing(folder, "map", draw_map(drive_of(scenario, record))),
        *write_drawing(folder, "timeline", draw_timeline(timeline_of(scenario, record))),
        _write_reports(folder, record),
    )


def _write_reports(folder: Path, record: Record) -> Path:
    """Write every received report as JSON, one per line, with names of enumeration members.

    Reports of a live run have the time of receipt and the link.
    """
    converter = make_converter()
    converter.register_unstructure_hook_func(
        lambda kind: isinstance(kind, type) and issubclass(kind, Enum), lambda value: value.name
    )
    received: Iterable[tuple[Report, Receipt | None]] = [
        (receipt.report, receipt) for receipt in record.receipts
    ] or [(report, None) for report in record.reports]
    path = folder / REPORTS
    with path.open("w", encoding="utf-8") as file:
        for report, receipt in received:
            label = record.label(report.identity) if report.identity else None
            fields = {"time_s": round(record.time_of(report), 3), "label": label}
            fields |= converter.unstructure(report)
            if receipt is not None:
                fields |= {"link": receipt.link, "received_s": round(receipt.time_s, 3)}
            file.write(json.dumps(fields) + "\n")
    return path


def drive_of(scenario: Scenario, record: Record) -> DriveMap:
    """Return the data of a run's map."""
    poses = record.poses or [TruePose(0.0, scenario.world.start_pose)]
    small = scenario.settings.locomotion is LocomotionKind.DELEGATED
    histories = record.all_lifecycles()

    def done_s(kind: type) -> Iterator[float]:
        for each in record.requested:
            lifecycle = histories.get(each.identity) if isinstance(each.request, kind) else None
            executed = None if lifecycle is None else lifecycle.report_at(Stage.EXECUTED)
            if executed is not None:
                yield record.time_of(executed)

    end = poses[-1].pose
    return DriveMap(
        title=f"{scenario.title}: the drive, world “{scenario.world.name}”",
        world=scenario.world,
        planned=planned_waypoints(record),
        driven=tuple(_odometry(record)),
        true=tuple(seen.pose for seen in poses),
        stops=tuple(_pose_at(poses, time_s) for time_s in done_s(Stop)),
        views=tuple(
            _view(record, _pose_at(poses, time_s), time_s) for time_s in done_s(TakePicture)
        ),
        figures=tuple(_figures(record, end)),
        scale=SMALL_ROVER if small else 1.0,
        zones=scenario.settings.zones,
        scanned=record.seen,
        incidents=tuple(
            Incident(_pose_at(poses, time_s), text)
            for time_s, text in sorted(_incidents(scenario, record))
        ),
    )


def timeline_of(scenario: Scenario, record: Record) -> RunTimeline:
    """Return the data of a run's timeline."""
    relayed = any(sent.link == RELAY for sent in record.sendings) and bool(record.receipts)
    histories = record.all_lifecycles()
    identities = list(dict.fromkeys([*(sent.identity for sent in record.sendings), *histories]))
    lanes = (_lane(record, each, histories.get(each)) for each in identities)
    outages = tuple(
        (begin_s, min(begin_s + entry.outage_s, record.simulated_s))
        for entry in scenario.timeline
        if isinstance(entry, Outage) and (begin_s := record.resolve_time(entry)) is not None
    )
    return RunTimeline(
        title=scenario.title,
        end_s=record.simulated_s,
        commands=tuple(map(passage_lane, sent_commands(record)) if relayed else lanes),
        faults=tuple(_faults(scenario, record)),
        events=events_of({each.sequence: each for each in record.reports}.values(), record.time_of),
        modes=tuple(_modes(record)),
        panels=(Panel("true speed", "m/s", (_true_speeds(record),)),),
        outages=outages,
        waiting=(_queue_levels(record), _aboard(record)) if relayed and outages else None,
    )


def _true_speeds(record: Record) -> Series:
    """Return the true speed over ground."""
    moved = [
        (end.time_s, path_length_m((start, end)) / (end.time_s - start.time_s))
        for start, end in pairwise(record.poses)
        if end.time_s > start.time_s
    ]
    times_s, speeds_mps = zip(*moved, strict=True) if moved else ((), ())
    return Series(TrackSource.TRUTH, times_s, speeds_mps)


def _pose_at(poses: Sequence[TruePose], time_s: float) -> Pose:
    """Return the true pose of the rover nearest in time."""
    return min(poses, key=lambda seen: abs(seen.time_s - time_s)).pose


def _waypoints_of(request: Request, pose: Pose) -> tuple[Waypoint, ...]:
    """Return the waypoints of a motion from a pose, as far as the request defines them."""
    waypoints: list[Waypoint] = []
    for segment in request.segments(pose) if isinstance(request, Motion) else ():
        match segment:
            case Line(end=end):
                waypoints.append(Waypoint(end.x_m, end.y_m))
            case Turn(end=end, reference=Reference.FRAME) if waypoints:
                waypoints[-1] = replace(waypoints[-1], heading_rad=end.heading_rad)
            case _:
                pass
    return tuple(waypoints)


def _figures(record: Record, end: Pose) -> Iterator[str]:
    yield f"driven {path_length_m(record.poses):.1f} m in {record.simulated_s:.1f} s"
    yield f"at the end x {end.x_m:z.2f} y {end.y_m:z.2f}, {degrees(end.heading_rad):z.0f}°"
    last = last_error(record)
    if last is not None:
        yield "true error at the last target:"
        yield last


def last_error(record: Record) -> str | None:
    """Return the true error of the last executed motion at its target as text, or None."""
    ends = [end for end in true_ends(record) if end.off_m is not None]
    if not ends or ends[-1].off_m is None:
        return None
    off_rad = ends[-1].off_rad
    turned = "" if off_rad is None else f", {degrees(off_rad):.1f}°"
    return f"{100 * ends[-1].off_m:.1f} cm{turned}"


def planned_waypoints(record: Record) -> tuple[Waypoint, ...]:
    """Return the waypoints of the started motions, without consecutive repeats."""
    poses, lifecycles = record.poses, record.all_lifecycles()
    waypoints: list[Waypoint] = []
    for each in record.requested:
        lifecycle = lifecycles.get(each.identity)
        started = None if lifecycle is None else lifecycle.report_at(Stage.STARTED)
        if started is not None and poses:
            waypoints += _waypoints_of(each.request, _pose_at(poses, record.time_of(started)))
    return tuple(waypoint for waypoint, _ in groupby(waypoints))


def _view(record: Record, pose: Pose, time_s: float) -> Pose:
    """Return the viewing direction of the camera by telemetry, as a pose."""
    pans = (each for each in record.values if each.parameter is Parameter.CAM_PAN)
    before = [each.value for each in pans if each.time_s <= time_s and each.value is not None]
    pan_rad = before[-1] if before else 0.0
    return replace(pose, heading_rad=pose.heading_rad + pan_rad)


def _odometry(record: Record) -> Iterator[Pose]:
    """Yield the poses of odometry, or of telemetry if there are none."""
    yield from record.odometry
    if record.odometry:
        return
    for _, batch in groupby(record.values, key=lambda value: value.time_s):
        known = {value.parameter: value.value for value in batch}
        x_m, y_m = known.get(Parameter.POS_X), known.get(Parameter.POS_Y)
        if x_m is not None and y_m is not None:
            pose = Pose(x_m, y_m)
            if pose.finite:
                yield pose


def _incidents(scenario: Scenario, record: Record) -> Iterator[tuple[float, str]]:
    """Yield time and text of each fault, failure and untrue EXECUTED."""
    untrue = {end.label: end.wrong.split(", of ")[0] for end in true_ends(record) if end.wrong}
    for span in _faults(scenario, record):
        yield span.begin_s, span.name
    for identity, entry in record.all_lifecycles().items():
        label, end = record.label(identity), entry.end
        if end is not None and end.stage is Stage.FAILED:
            reason = f": {end.reason.name}" if end.reason else ""
            yield record.time_of(end), f"{label} FAILED{reason}"
        elif end is not None and end.stage is Stage.EXECUTED and label in untrue:
            yield record.time_of(end), f"{label} EXECUTED, but {untrue[label]}"


def _faults(scenario: Scenario, record: Record) -> Iterator[TimeSpan]:
    """Yield faults, crashes and cargo, each until its end or the end of the run."""
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
        begin_s = record.resolve_time(entry)
        if begin_s is None or begin_s > end_s:
            continue
        match entry:
            case Crash(crash_s=down_s):
                yield TimeSpan("executive lost", begin_s, min(end_s, begin_s + down_s))
            case Cargo(cargo_kg=mass_kg):
                yield TimeSpan(f"cargo {mass_kg:g} kg", begin_s, end_s)
            case _:
                pass


def _lane(record: Record, identity: Identity, entry: CommandHistory | None) -> CommandLane:
    sent = [each for each in record.sendings if each.identity == identity]
    answers = ", ".join(dict.fromkeys(each.answer.value for each in sent))
    sent_s = [each.time_s for each in sent]
    return lane_of(entry, record.time_of, record.label(identity), sent_s, answers)


def passage_lane(sent: CommandTrace) -> CommandLane:
    """Return the lane of a command between ground, orbiter and rover."""
    sending, lost = sent.sending, sent.expiry

    def report_times(receipt: Receipt | None) -> ReportTimes | None:
        if receipt is None:
            return None  # the rover answers a repeat with its earlier report
        return ReportTimes(max(receipt.made_s, sending.time_s), receipt.time_s)

    passage = Passage(
        sent.link == RELAY,
        sent.ending,
        sending.time_s,
        sending.answered_s if sent.stored else None,
        report_times(sent.at(Stage.RECEIVED)),
        report_times(sent.at(Stage.STARTED)),
        None if lost else report_times(sent.ended),
        lost.time_s if lost else None,
        sent.again,
    )
    title = f"again: {sent.title}" if sent.again else sent.title
    return CommandLane(title, (sending.time_s,), last=sent.stage, passage=passage)


def _queue_levels(record: Record) -> Levels:
    """Return the number of bundles queued at the orbiter at each change."""
    seen = [
        (each.time_s, int(each.values.get(DTN_QUEUED, 0)))
        for each in record.statuses
        if each.link == RELAY
    ]
    return tuple(later for earlier, later in pairwise(seen) if later[1] != earlier[1])


def _aboard(record: Record) -> Levels:
    """Return the number of reports queued aboard at each change."""
    changes: list[tuple[float, int]] = []
    for each in record.receipts:
        if each.link == RELAY and each.report.sequence and each.time_s - each.made_s > SHORT_S:
            changes += [(each.made_s, 1), (each.time_s, -1)]
    changes.sort()
    waiting = accumulate(change for _, change in changes)
    return tuple((time_s, number) for (time_s, _), number in zip(changes, waiting, strict=True))


def queue_figures(record: Record) -> Iterator[tuple[str, str]]:
    """Yield names and figures of queued items: their number and the maximum waiting time."""
    stored_s = []
    for sent in sent_commands(record):
        left = sent.expiry or sent.at(Stage.RECEIVED)
        if sent.stored and left is not None:
            left_s = left.time_s if sent.expiry else left.made_s
            stored_s.append(left_s - sent.sending.time_s)
    aboard_s = [each.time_s - each.made_s for each in record.receipts if each.link == RELAY]
    names = ("commands queued at the orbiter", "reports queued aboard")
    for name, waits_s in zip(names, (stored_s, aboard_s), strict=True):
        long_s = [wait_s for wait_s in waits_s if wait_s > SHORT_S]
        figure = f"{len(long_s)} of {len(waits_s)}"
        yield name, figure + (f", for up to {max(long_s):.1f} s" if long_s else "")


def _modes(record: Record) -> Iterator[tuple[Mode, float, float]]:
    """Yield each mode with its begin and end, from first sample to first sample of the next."""
    runs = [(mode, next(seen).time_s) for mode, seen in groupby(record.modes, lambda s: s.mode)]
    ends_s = [*(begin_s for _, begin_s in runs[1:]), record.simulated_s]
    for (mode, begin_s), end_s in zip(runs, ends_s, strict=True):
        yield mode, begin_s, end_s
