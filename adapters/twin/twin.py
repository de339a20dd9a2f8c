"""`Twin` predicts where the next command finds a rover behind a delay, and the path it is on.

It runs ahead of the ground by the one-way delay: a command that is sent arrives at it at once. It
starts again at the last reported pose if it is too far from that, or if a command was lost or
failed. Until then the rover may be off the prediction, but it is still on the path.
"""

from bisect import bisect_left
from collections import deque
from dataclasses import dataclass
from itertools import islice
from math import inf, sqrt
from typing import Final

from adapters.twin.executive_copy import ExecutiveCopy, ReportedPose, copied_settings, pose_at
from executive.commands import Command
from executive.settings import Settings
from executive.values.geometry import Point, Pose, path_length_m
from executive.values.reports import TERMINAL, Identity, Stage

MAX_ERROR_M: Final = 0.15
"""Maximum distance between a reported pose and the prediction; beyond it the twin starts again."""
REPORT_MARGIN_S: Final = 2.0
"""Time beyond the round trip after which a command without a report counts as lost; chosen."""
MAX_ARRIVAL_ERROR_S: Final = 0.5
"""Maximum deviation from the expected time of arrival, likewise; chosen."""
DEVIATION_M: Final = 0.09
DEVIATION_RATIO: Final = 0.01
DEVIATION_S: Final = 0.2
"""Deviation at 2 sigma: constant, of the path, and of the time of the end of each command, which a
rover confirms sooner or later; fitted to missions in simulation (`rover bench predicted-poses`)."""
SLICE_TICKS: Final = 1000
MAX_POINTS: Final = 200
"""Maximum number of points of a path."""
MIN_STEP_M: Final = 0.1
"""Minimum distance between two points of a path."""
RESTART_RATIO: Final = 0.01
"""Minimum interval between restarts, as a ratio of the reported time that they simulate again: they
take some 4 % of a processor then, also in motions of hours; chosen."""
MAX_REPORTS: Final = 20_000
"""Maximum number of stored reports."""
MIN_SPEED_MPS: Final = 0.05
"""Minimum speed of a motion without a known command, e.g. of another console; chosen."""
MAX_LAG_S: Final = 10.0
"""Maximum lag between the twin and the rover where their paths are joined; chosen."""


@dataclass(frozen=True, slots=True)
class PredictedPose:
    """Where a command that is sent now finds the rover.

    Attributes:
        as_of_utc_s: time aboard of the last reported pose.
        arrival_utc_s: arrival time of the command.
        pose: predicted pose, in the frame of POS_X and POS_Y.
        deviation_m: deviation of the position at 2 sigma, while nothing unexpected happens.
        path: from the reported pose to the predicted one; the rover is on it in any case.
    """

    as_of_utc_s: float
    arrival_utc_s: float
    pose: Pose
    deviation_m: float
    path: tuple[Point, ...]


@dataclass(slots=True)
class _Sent:
    """A command that has not ended, with its reported stages.

    Attributes:
        arrival_utc_s: expected time of arrival, or that of its first report.
        fed: whether the copy has received it.
    """

    command: Command
    arrival_utc_s: float
    fed: bool = False
    received: bool = False
    lost: bool = False
    started_utc_s: float = inf


class Twin:
    """Twin of one rover over one link. All times are UTC of the ground.

    Args:
        settings: settings of the asset.
        one_way_s: delay of the link in each direction.
    """

    def __init__(self, settings: Settings, one_way_s: float) -> None:
        self.one_way_s = one_way_s
        self._settings = copied_settings(settings)
        self._copy: ExecutiveCopy | None = None
        self._sent: dict[Identity, _Sent] = {}
        self._reports: deque[ReportedPose] = deque(maxlen=MAX_REPORTS)
        self._outdated = True
        self._moved_by_others = False
        self._restart_utc_s = -inf

    def on_sent(self, command: Command, utc_s: float) -> None:
        """Add a command that is sent at this time."""
        self._sent.setdefault(command.identity, _Sent(command, utc_s + self.one_way_s))

    def on_stage(self, identity: Identity, stage: Stage, utc_s: float) -> None:
        """Receive a reported stage of a command, with its time aboard."""
        sent = self._sent.get(identity)
        if sent is None:
            return
        if not sent.received:
            self._outdated |= sent.lost or abs(utc_s - sent.arrival_utc_s) > MAX_ARRIVAL_ERROR_S
            sent.received, sent.lost, sent.arrival_utc_s = True, False, utc_s
        if stage is Stage.STARTED:
            sent.started_utc_s = utc_s
        if stage in TERMINAL:
            del self._sent[identity]
            same = self._copy is not None and self._copy.stage_of(identity) is stage
            self._outdated |= stage is not Stage.EXECUTED and not same

    def on_pose(self, reported: ReportedPose) -> None:
        """Receive a reported pose; one that is not newer than the last is ignored."""
        if self._reports and reported.utc_s <= self._reports[-1].utc_s:
            return
        before = self._reports[-1] if self._reports else reported
        self._outdated |= reported.stopped is not before.stopped
        self._reports.append(reported)
        begin_s = min((each.started_utc_s for each in self._sent.values()), default=inf)
        while len(self._reports) > 1 and self._reports[1].utc_s <= begin_s:
            self._reports.popleft()
        if self._copy is not None:
            predicted = pose_at(self._copy.track, reported.utc_s)
            self._outdated |= predicted.point.distance_m(reported.pose.point) > MAX_ERROR_M
            moved_m = reported.pose.point.distance_m(before.pose.point)
            moved_m -= predicted.point.distance_m(pose_at(self._copy.track, before.utc_s).point)
            speed_mps = moved_m / max(reported.utc_s - before.utc_s, self._settings.tick_s)
            self._moved_by_others = begin_s == inf and speed_mps > MIN_SPEED_MPS
            self._copy.forget_before(reported.utc_s - MAX_LAG_S)

    def advance(self, utc_s: float, ticks: int) -> bool:
        """Compute at most some ticks; return whether it has reached the time of arrival.

        Args:
            utc_s: present time.
            ticks: maximum number of ticks.
        """
        if not self._reports:
            return True
        for sent in self._sent.values():
            due_s = sent.arrival_utc_s + self.one_way_s + REPORT_MARGIN_S
            if not (sent.received or sent.lost) and utc_s > due_s:
                sent.lost = self._outdated = True
        until_s, copy = utc_s + self.one_way_s, self._copy
        if (
            copy is not None
            and self._reports[0].utc_s <= until_s < copy.utc_s - MAX_ARRIVAL_ERROR_S
        ):
            self._outdated = True  # the delay is shorter now, or the clock was set back
        if self._outdated or copy is None:
            again_s = RESTART_RATIO * (self._reports[-1].utc_s - self._reports[0].utc_s)
            if abs(utc_s - self._restart_utc_s) < again_s:
                return True
            self._restart_utc_s = utc_s
            copy = self._begin()
        for sent in sorted(self._sent.values(), key=lambda each: each.arrival_utc_s):
            if not (sent.lost or sent.fed) and sent.arrival_utc_s <= until_s:
                ticks = copy.advance(sent.arrival_utc_s, ticks)
                if ticks == 0:
                    return False
                sent.fed = True
                copy.submit(sent.command)
        return copy.advance(until_s, ticks) > 0

    def predict(self, utc_s: float) -> PredictedPose | None:
        """Return where a command that is sent now finds the rover.

        None before the first report, while a restart is due, which long motions put off, and while
        the rover moves without a command known here, e.g. by that of another console.
        """
        while not self.advance(utc_s, SLICE_TICKS):
            pass
        copy = self._copy
        if copy is None or self._outdated or self._moved_by_others:
            return None
        path = self._path(copy)
        as_of_s = self._reports[-1].utc_s
        late_s = DEVIATION_S * sqrt(sum(each >= as_of_s for each in copy.ends))
        late_m = late_s * copy.executive.status.travel_limit_mps
        deviation_m = DEVIATION_M + DEVIATION_RATIO * path_length_m(path) + late_m
        return PredictedPose(as_of_s, copy.utc_s, copy.pose, deviation_m, path)

    def close(self) -> None:
        """Delete its files."""
        if self._copy is not None:
            self._copy.close()

    def _begin(self) -> ExecutiveCopy:
        """Start again with the first running command, along the poses reported since."""
        self.close()
        self._copy = ExecutiveCopy(self._settings, tuple(self._reports))
        self._outdated = False
        for sent in self._sent.values():
            sent.fed = False
        return self._copy

    def _path(self, copy: ExecutiveCopy) -> tuple[Point, ...]:
        """Return the path from the reported pose, joined where the copy was nearest to it."""
        reported = self._reports[-1]
        first = min(
            (
                (pose.point.distance_m(reported.pose.point), index)
                for index, (utc_s, pose) in enumerate(copy.track)
                if abs(utc_s - reported.utc_s) <= MAX_LAG_S
            ),
            default=(0.0, max(0, bisect_left(copy.track, (reported.utc_s,)) - 1)),
        )[1]
        rest = [pose.point for _, pose in islice(copy.track, first, None)]
        step_m = max(MIN_STEP_M, path_length_m(rest) / MAX_POINTS)
        path = [reported.pose.point]
        for point in rest:
            if point.distance_m(path[-1]) >= step_m:
                path.append(point)
        return (*path, copy.pose.point)
