"""Whether the rover truly was where a command that ended EXECUTED was to bring it.

The true pose must be within `NEAR_M` and `NEAR_PER_M` of the way to the target of what was
commanded, and within `NEAR_RAD`; after a turn on the spot, within `NEAR_M` of where it began; and
no stop may end EXECUTED while the rover goes faster than `STANDING_MPS`.
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

NEAR_M: Final = 0.15
NEAR_PER_M: Final = 0.05
NEAR_RAD: Final = 0.1
STANDING_MPS: Final = 0.05
STANDING_RADPS: Final = 0.1
SPEED_OVER_S: Final = 0.05
"""The time before and after a moment over which its true speed is taken."""
UNSEEN_S: Final = 0.5
"""A moment is known if there is a true pose that is no farther from it."""


@dataclass(frozen=True, slots=True)
class TrueEnd:
    """How far the rover truly was from what a command asked for when that ended EXECUTED.

    Attributes:
        label: of the command; its identity, if a plan gave it.
        off_m, off_rad: from the commanded pose; None where none is commanded.
        wrong: what is not as it was to be, or cannot be seen; empty if all is.
        seen: whether there are true poses of the command's time.
        end_s: when it ended.
    """

    label: str
    end_s: float
    off_m: float | None = None
    off_rad: float | None = None
    wrong: str = ""
    seen: bool = True


@dataclass(frozen=True, slots=True)
class _Target:
    """The pose that a command asks for, in the frame of the world.

    Attributes:
        heading_rad: None where none is asked for.
        way_m: from where the rover begins.
        near_m: how near is near enough, but for `NEAR_PER_M` of the way.
    """

    place: Point
    heading_rad: float | None
    way_m: float
    near_m: float = NEAR_M


def true_ends(record: Record) -> list[TrueEnd]:
    """Return how true the end of each motion and of each stop is that ended EXECUTED."""
    requests = {each.identity: each.request for each in record.requested}
    ends = []
    for identity, life in record.lives().items():
        executed = life.at(Stage.EXECUTED)
        if executed is None:
            continue
        if identity in requests:
            ends.append(_true_end(record, life, executed, requests[identity]))
        elif identity.source.startswith(SOURCE_PREFIX):
            wrong, end_s = "asked for what is not known", record.time_of(executed)
            ends.append(TrueEnd(str(identity), end_s, wrong=wrong, seen=False))
    return [end for end in ends if end is not None]


def what_was_executed_is_true(record: Record, false_executed: Sequence[str]) -> Check:
    """Hold every command that ended EXECUTED to what it asked for.

    Args:
        record: of the run.
        false_executed: labels of those that must fail to hold it.
    """
    ends = true_ends(record)
    looked_at = {end.label for end in ends}
    broken = {end.label for end in ends if end.wrong and end.seen}
    unseen = [end for end in ends if not end.seen]
    amiss = [
        *(f"{end.label} {end.wrong}" for end in ends if end.wrong),
        *(
            f"{label} is true" if label in looked_at else f"{label} did not end EXECUTED"
            for label in false_executed
            if label not in broken
        ),
    ]
    worst_m = max((end.off_m for end in ends if end.off_m is not None), default=0.0)
    count = len(ends)
    held = f"{count} of {count} are, at most {worst_m:.3f} m off" if ends else "nothing did"
    but = f", but for {', '.join(false_executed)}" if false_executed else ""
    return Check(
        "promise",
        f"what ended EXECUTED is true{but}",
        "; ".join(amiss) or held,
        broken == set(false_executed) and not unseen,
    )


def look_up_requests(record: Record, ledger: Path) -> None:
    """Add what the commands ask for that the ground did not send, from the ledger aboard.

    Raises:
        executive.record.LedgerError: it cannot be read.
    """
    known = {each.identity for each in record.requested}
    unknown = [identity for identity in record.lives() if identity not in known]
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


def undelayed_s(heard_s: Sequence[float], stamps_s: Sequence[float]) -> list[float]:
    """Return when samples were made that were heard with delays: their stamps, on our clock.

    The clocks differ by what the sample shows that was delayed least. A clock of samples that loses
    time makes that difference greater from then on, so that only later samples tell it.

    Args:
        heard_s: when each was heard, on our clock, in order.
        stamps_s: when each was made, on the clock of whoever made it.
    """
    apart_s = [heard - stamp for heard, stamp in zip(heard_s, stamps_s, strict=True)]
    least_s = [*accumulate(reversed(apart_s), min)][::-1]
    return [stamp + least for stamp, least in zip(stamps_s, least_s, strict=True)]


def way_m(poses: Iterable[TruePose]) -> float:
    """Return the length of the way through poses."""
    return sum(one.pose.point.distance_m(other.pose.point) for one, other in pairwise(poses))


def _true_end(
    record: Record, life: CommandHistory, executed: Report, request: Request
) -> TrueEnd | None:
    label, poses, end_s = record.label(life.identity), record.poses, record.time_of(executed)
    if isinstance(request, Stop):
        return _stopped(poses, label, end_s)
    if not isinstance(request, Motion):
        return None
    first = _index(poses, record.time_of(life.at(Stage.STARTED) or executed))
    last = _index(poses, end_s)
    if first is None or last is None:
        return _unseen(label, end_s)
    target = _target(request, _start(poses, first, last, request))
    end = poses[last].pose
    off_m = end.point.distance_m(target.place)
    near_m = target.near_m + NEAR_PER_M * target.way_m
    wrong = [f"{off_m:.3f} m off, of {near_m:.3f} m allowed"] if off_m > near_m else []
    off_rad = None
    if target.heading_rad is not None:
        off_rad = abs(wrap_rad(end.heading_rad - target.heading_rad))
        if off_rad > NEAR_RAD:
            wrong.append(f"{degrees(off_rad):.1f}° off, of {degrees(NEAR_RAD):.1f}° allowed")
    return TrueEnd(label, end_s, off_m, off_rad, " and ".join(wrong))


def _target(request: Motion, start: Pose) -> _Target:
    """Return the pose that a motion commands, of a rover that begins at a pose."""
    segments = request.segments(start)
    end, way_m = segments[-1].end, sum(abs(each.by_m) for each in segments)
    turns = [each.reference for each in segments if isinstance(each, Turn)]
    lines = [each.tolerance_m or NEAR_M for each in segments if isinstance(each, Line)]
    heading_rad = None if turns[-1:] == [Reference.NEXT_LINE] else end.heading_rad
    return _Target(end.point, heading_rad, way_m, max([NEAR_M, *lines[-1:]]))


def _stopped(poses: Sequence[TruePose], label: str, end_s: float) -> TrueEnd:
    at = _index(poses, end_s)
    if at is None:
        return _unseen(label, end_s)
    first, last = _index(poses, end_s - SPEED_OVER_S), _index(poses, end_s + SPEED_OVER_S)
    before = poses[max(0, at - 1 if first is None else min(first, at - 1))]
    after = poses[min(len(poses) - 1, at + 1 if last is None else max(last, at + 1))]
    if not 0 < after.time_s - before.time_s <= 2 * UNSEEN_S:
        return _unseen(label, end_s)
    speed_mps = _speed_mps(before, poses[at], after)
    wrong = f"ended at {speed_mps:.2f} m/s" if speed_mps > STANDING_MPS else ""
    return TrueEnd(label, end_s, wrong=wrong)


def _speed_mps(before: TruePose, now: TruePose, after: TruePose) -> float:
    """Return the speed at a moment of a rover that brakes evenly, or until it stands.

    The ways before and after it give mean speeds, which are those at half of their times: the
    speed is in between. Where that would have the rover go backwards in the end, it came to rest
    on the way `w` after: of the speed `v`, the mean `m` before that and its time `t`,
    `w = v**2 / (2 * a)` and `a = 2 * (m - v) / t`.
    """
    until_s, from_s = now.time_s - before.time_s, after.time_s - now.time_s
    until_m, from_m = way_m((before, now)), way_m((now, after))
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
    """Return how far the pose that telemetry last told was from the true one: place and heading."""
    told = {each.parameter: each for each in record.values if each.time_s <= time_s + ALMOST_S}
    values = [told.get(each) for each in (Parameter.POS_X, Parameter.POS_Y, Parameter.HEAD)]
    x, y, heading = (None if each is None else each.value for each in values)
    at = None if values[0] is None else _index(record.poses, values[0].time_s)
    if x is None or y is None or heading is None or at is None:
        return None, None
    true = record.poses[at].pose
    return true.point.distance_m(Point(x, y)), abs(wrap_rad(true.heading_rad - heading))


def _unseen(label: str, end_s: float) -> TrueEnd:
    return TrueEnd(label, end_s, wrong=f"ended at {end_s:.2f} s: no true pose is known", seen=False)


def _index(poses: Sequence[TruePose], time_s: float) -> int | None:
    """Return which pose was the last until a time; None if none was seen about then."""
    until = bisect_right(poses, time_s + ALMOST_S, key=lambda seen: seen.time_s)
    index = max(0, until - 1)
    seen = index < len(poses) and abs(poses[index].time_s - time_s) <= UNSEEN_S
    return index if seen else None


def _start(poses: Sequence[TruePose], first: int, last: int, request: Motion) -> Pose:
    """Return from where a motion begins: a leg where the rover first stands, a held one at once."""
    if isinstance(request.segments(Pose())[0], Arc):
        return poses[first].pose
    for before, seen in pairwise(poses[max(0, first - 1) : last + 1]):
        took_s = seen.time_s - before.time_s
        turned_rad = abs(wrap_rad(seen.pose.heading_rad - before.pose.heading_rad))
        slow = way_m((before, seen)) <= STANDING_MPS * took_s
        if slow and turned_rad <= STANDING_RADPS * took_s:
            return seen.pose
    return poses[first].pose
