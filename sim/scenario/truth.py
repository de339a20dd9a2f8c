"""`check_executed_truth`: compares the true pose with the target of each EXECUTED command.

The position tolerance is `POSITION_TOLERANCE_M` plus `POSITION_TOLERANCE_PER_M` times the commanded
distance; the heading tolerance is `HEADING_TOLERANCE_RAD`. A turn on the spot must end within
`POSITION_TOLERANCE_M` of its start. A stop must not end EXECUTED while the rover is faster than
`STANDING_MPS`. The bounds are chosen, not measured.
"""

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from math import degrees, sqrt
from pathlib import Path
from typing import Final

from executive.commands import Arc, Line, Motion, Reference, Request, Stop, Turn
from executive.commands.intake import SOURCE_PREFIX
from executive.history import CommandHistory
from executive.record import Ledger, Synchronous
from executive.values.geometry import Point, Pose, wrap_rad
from executive.values.parameters import Parameter
from executive.values.reports import Report, Stage
from sim.scenario.record import ALMOST_S, AdmittedRequest, Check, Record, TruePose

POSITION_TOLERANCE_M: Final = 0.15
POSITION_TOLERANCE_PER_M: Final = 0.05
HEADING_TOLERANCE_RAD: Final = 0.1
STANDING_MPS: Final = 0.05
STANDING_RADPS: Final = 0.1
SPEED_OVER_S: Final = 0.05
"""Time before and after an instant over which its true speed is estimated."""
MAX_SAMPLE_GAP_S: Final = 0.5
"""Maximum time between an instant and its true pose."""


@dataclass(frozen=True, slots=True)
class TrueEnd:
    """True deviation of the rover from a command's target when it ended EXECUTED.

    Attributes:
        label: label of the command; its identity, if a plan sent it.
        off_m, off_rad: deviation from the commanded pose; None if none is commanded.
        wrong: text of the violated tolerances or of missing data; empty if the end is true.
        observed: whether there are true poses of the command's time.
        end_s: scenario time of its end.
    """

    label: str
    end_s: float
    off_m: float | None = None
    off_rad: float | None = None
    wrong: str = ""
    observed: bool = True


@dataclass(frozen=True, slots=True)
class _Target:
    """Commanded pose in the world frame.

    Attributes:
        heading_rad: None if none is commanded.
        distance_m: commanded distance from the start.
        near_m: position tolerance without the share `POSITION_TOLERANCE_PER_M` of the distance.
    """

    point: Point
    heading_rad: float | None
    distance_m: float
    near_m: float = POSITION_TOLERANCE_M


def true_ends(record: Record) -> list[TrueEnd]:
    """Return the true end of each motion and stop that ended EXECUTED."""
    requests = {each.identity: each.request for each in record.requested}
    ends = []
    for identity, entry in record.all_lifecycles().items():
        executed = entry.report_at(Stage.EXECUTED)
        if executed is None:
            continue
        if identity in requests:
            ends.append(_true_end(record, entry, executed, requests[identity]))
        elif identity.source.startswith(SOURCE_PREFIX):
            wrong, end_s = "has an unknown request", record.time_of(executed)
            ends.append(TrueEnd(str(identity), end_s, wrong=wrong, observed=False))
    return [end for end in ends if end is not None]


def check_executed_truth(record: Record, false_executed: Sequence[str]) -> Check:
    """Check every command that ended EXECUTED against its target.

    Args:
        record: record of the run.
        false_executed: labels of the commands that must violate the check.
    """
    ends = true_ends(record)
    checked = {end.label for end in ends}
    broken = {end.label for end in ends if end.wrong and end.observed}
    unobserved = [end for end in ends if not end.observed]
    violations = [
        *(f"{end.label} {end.wrong}" for end in ends if end.wrong),
        *(
            f"{label} is true" if label in checked else f"{label} did not end EXECUTED"
            for label in false_executed
            if label not in broken
        ),
    ]
    worst_m = max((end.off_m for end in ends if end.off_m is not None), default=0.0)
    count = len(ends)
    held = f"{count} of {count} are, at most {worst_m:.3f} m off" if ends else "nothing did"
    exceptions = f", except {', '.join(false_executed)}" if false_executed else ""
    return Check(
        "criterion",
        f"every EXECUTED is true{exceptions}",
        "; ".join(violations) or held,
        broken == set(false_executed) and not unobserved,
    )


def load_requests(record: Record, ledger: Path) -> None:
    """Add the requests of commands that the ground did not send, from the ledger aboard.

    Raises:
        executive.record.LedgerError: the ledger cannot be read.
    """
    known = {each.identity for each in record.requested}
    unknown = [identity for identity in record.all_lifecycles() if identity not in known]
    if not unknown:
        return
    aboard = Ledger(ledger, Synchronous.NORMAL)
    try:
        for identity in unknown:
            request = aboard.request(identity)
            if request is not None:
                record.requested.append(AdmittedRequest(identity, request))
    finally:
        aboard.abandon()


def undelayed_s(received_s: Sequence[float], stamps_s: Sequence[float]) -> list[float]:
    """Return the stamps of delayed samples on the local clock.

    The clock offset is the difference of the least delayed sample. If the sender's clock loses
    time, the offset grows from then on, so the minimum is taken over later samples only.

    Args:
        received_s: times of receipt on the local clock, in order.
        stamps_s: creation times on the sender's clock.
    """
    delays_s = [received - stamp for received, stamp in zip(received_s, stamps_s, strict=True)]
    offsets_s = [*accumulate(reversed(delays_s), min)][::-1]
    return [stamp + offset for stamp, offset in zip(stamps_s, offsets_s, strict=True)]


def path_length_m(poses: Iterable[TruePose]) -> float:
    """Return the length of the path through poses, in m."""
    return sum(one.pose.point.distance_m(other.pose.point) for one, other in pairwise(poses))


def _true_end(
    record: Record, entry: CommandHistory, executed: Report, request: Request
) -> TrueEnd | None:
    label, poses, end_s = record.label(entry.identity), record.poses, record.time_of(executed)
    if isinstance(request, Stop):
        return _stopped(poses, label, end_s)
    if not isinstance(request, Motion):
        return None
    first = _index(poses, record.time_of(entry.report_at(Stage.STARTED) or executed))
    last = _index(poses, end_s)
    if first is None or last is None:
        return _without_pose(label, end_s)
    target = _target(request, _start(poses, first, last, request))
    end = poses[last].pose
    off_m = end.point.distance_m(target.point)
    near_m = target.near_m + POSITION_TOLERANCE_PER_M * target.distance_m
    wrong = [f"{off_m:.3f} m off, of {near_m:.3f} m allowed"] if off_m > near_m else []
    off_rad = None
    if target.heading_rad is not None:
        off_rad = abs(wrap_rad(end.heading_rad - target.heading_rad))
        if off_rad > HEADING_TOLERANCE_RAD:
            wrong.append(
                f"{degrees(off_rad):.1f}° off, of {degrees(HEADING_TOLERANCE_RAD):.1f}° allowed"
            )
    return TrueEnd(label, end_s, off_m, off_rad, " and ".join(wrong))


def _target(request: Motion, start: Pose) -> _Target:
    """Return the target of a motion from a start pose."""
    segments = request.segments(start)
    end, distance_m = segments[-1].end, sum(abs(each.by_m) for each in segments)
    turns = [each.reference for each in segments if isinstance(each, Turn)]
    lines = [
        each.tolerance_m or POSITION_TOLERANCE_M for each in segments if isinstance(each, Line)
    ]
    heading_rad = None if turns[-1:] == [Reference.NEXT_LINE] else end.heading_rad
    return _Target(end.point, heading_rad, distance_m, max([POSITION_TOLERANCE_M, *lines[-1:]]))


def _stopped(poses: Sequence[TruePose], label: str, end_s: float) -> TrueEnd:
    at = _index(poses, end_s)
    if at is None:
        return _without_pose(label, end_s)
    first, last = _index(poses, end_s - SPEED_OVER_S), _index(poses, end_s + SPEED_OVER_S)
    before = poses[max(0, at - 1 if first is None else min(first, at - 1))]
    after = poses[min(len(poses) - 1, at + 1 if last is None else max(last, at + 1))]
    if not 0 < after.time_s - before.time_s <= 2 * MAX_SAMPLE_GAP_S:
        return _without_pose(label, end_s)
    speed_mps = _speed_mps(before, poses[at], after)
    wrong = f"ended at {speed_mps:.2f} m/s" if speed_mps > STANDING_MPS else ""
    return TrueEnd(label, end_s, wrong=wrong)


def _speed_mps(before: TruePose, now: TruePose, after: TruePose) -> float:
    """Return the speed at an instant, for constant deceleration or braking to standstill.

    The distances before and after it give mean speeds, valid at the middle of their intervals; the
    speed is interpolated. If that gives a reverse motion at the end, the rover stopped within
    the distance `w` after: with the speed `v`, the mean speed `m` before and its interval `t`,
    `w = v**2 / (2 * a)` and `a = 2 * (m - v) / t`.
    """
    until_s, from_s = now.time_s - before.time_s, after.time_s - now.time_s
    until_m, from_m = path_length_m((before, now)), path_length_m((now, after))
    if not until_s or not from_s:
        return (until_m + from_m) / (until_s + from_s)
    before_mps, after_mps = until_m / until_s, from_m / from_s
    slowing_mps2 = 2 * (before_mps - after_mps) / (until_s + from_s)
    speed_mps = before_mps - slowing_mps2 * until_s / 2
    if speed_mps >= slowing_mps2 * from_s:
        return speed_mps
    rest_mps = from_m / until_s
    return 2 * (sqrt(rest_mps * (rest_mps + before_mps)) - rest_mps)


def reported_error(record: Record, time_s: float) -> tuple[float | None, float | None]:
    """Return the error of the last pose in telemetry: position in m, heading in rad."""
    last = {each.parameter: each for each in record.values if each.time_s <= time_s + ALMOST_S}
    values = [last.get(each) for each in (Parameter.POS_X, Parameter.POS_Y, Parameter.HEAD)]
    x, y, heading = (None if each is None else each.value for each in values)
    at = None if values[0] is None else _index(record.poses, values[0].time_s)
    if x is None or y is None or heading is None or at is None:
        return None, None
    true = record.poses[at].pose
    return true.point.distance_m(Point(x, y)), abs(wrap_rad(true.heading_rad - heading))


def _without_pose(label: str, end_s: float) -> TrueEnd:
    return TrueEnd(
        label, end_s, wrong=f"ended at {end_s:.2f} s: no true pose is known", observed=False
    )


def _index(poses: Sequence[TruePose], time_s: float) -> int | None:
    """Return the index of the last pose up to a time.

    None without a pose within `MAX_SAMPLE_GAP_S`.
    """
    until = bisect_right(poses, time_s + ALMOST_S, key=lambda seen: seen.time_s)
    index = max(0, until - 1)
    seen = index < len(poses) and abs(poses[index].time_s - time_s) <= MAX_SAMPLE_GAP_S
    return index if seen else None


def _start(poses: Sequence[TruePose], first: int, last: int, request: Motion) -> Pose:
    """Return the start pose of a motion: its first standstill, or its first pose for an arc."""
    if isinstance(request.segments(Pose())[0], Arc):
        return poses[first].pose
    for before, seen in pairwise(poses[max(0, first - 1) : last + 1]):
        took_s = seen.time_s - before.time_s
        turned_rad = abs(wrap_rad(seen.pose.heading_rad - before.pose.heading_rad))
        slow = path_length_m((before, seen)) <= STANDING_MPS * took_s
        if slow and turned_rad <= STANDING_RADPS * took_s:
            return seen.pose
    return poses[first].pose
