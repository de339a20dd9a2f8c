"""One motion that the brick carries out: segments one after the other, by its own odometry.

A segment is a line, a turn on the spot, or a velocity held, from standing to standing.
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import copysign, sqrt
from typing import Protocol, assert_never

from executive.commands import DriveFor, MoveForward, MoveTo, RotateBy, RotateTo
from executive.values.geometry import Point, Pose, wrap_rad
from sim.brick.odometry import CountOdometry, Rims
from sim.brick.settings import BrickSettings

_SYNC_PER_S = 4.0
"""How hard the wheel that is ahead of the other is held back."""
_SYNC_MOST = 0.3


class Segment(Protocol):
    """From standing to standing."""

    def rims_mps(self, rims_m: Rims, period_s: float) -> Rims | None:
        """Return the speeds of the rims for the next period; None at the end.

        Args:
            rims_m: how far the rims have rolled since the start of the segment.
            period_s: how long the speeds hold.
        """
        ...


@dataclass(slots=True)
class RollSegment:
    """Both wheels as far, ahead or against each other, at a trapezoid of speed.

    Attributes:
        left, right: +1.0 or -1.0, which way each turns.
        length_m: how far.
        speed_mps: at most how fast.
    """

    left: float
    right: float
    length_m: float
    speed_mps: float
    settings: BrickSettings
    _now_mps: float = 0.0

    def rims_mps(self, rims_m: Rims, period_s: float) -> Rims | None:
        """Return the speeds; a wheel that is ahead of the other is held back."""
        left_m, right_m = self.left * rims_m[0], self.right * rims_m[1]
        rest_m = self.length_m - (left_m + right_m) / 2
        if rest_m <= self._now_mps * period_s / 2:
            return None
        faster_mps = self._now_mps + self.settings.rim_mps2 * period_s
        braking_mps = max(self.settings.creep_mps, sqrt(2 * self.settings.rim_mps2 * rest_m))
        self._now_mps = min(self.speed_mps, faster_mps, braking_mps)
        most_mps = _SYNC_MOST * self._now_mps
        sync_mps = max(-most_mps, min(most_mps, _SYNC_PER_S * (left_m - right_m)))
        return self.left * (self._now_mps - sync_mps), self.right * (self._now_mps + sync_mps)


@dataclass(slots=True)
class HoldSegment:
    """A velocity held for a time, ramps included."""

    left_mps: float
    right_mps: float
    duration_s: float
    settings: BrickSettings
    _now: Rims = (0.0, 0.0)
    _elapsed_s: float = 0.0

    def rims_mps(self, _: Rims, period_s: float) -> Rims | None:
        """Return the speeds."""
        fastest_mps = max(abs(self._now[0]), abs(self._now[1]))
        rest_s = self.duration_s - self._elapsed_s
        braking = rest_s <= fastest_mps / self.settings.rim_mps2
        if rest_s <= 0.0 or (braking and fastest_mps == 0.0):
            return None
        self._elapsed_s += period_s
        step_mps = self.settings.rim_mps2 * period_s
        to = (0.0, 0.0) if braking else (self.left_mps, self.right_mps)
        self._now = (_toward(self._now[0], to[0], step_mps), _toward(self._now[1], to[1], step_mps))
        return self._now


def _toward(now: float, to: float, step: float) -> float:
    return max(now - step, min(now + step, to))


Motion = MoveTo | MoveForward | RotateTo | RotateBy | DriveFor
PlannedSegment = Callable[[Pose], Segment]
"""A segment, made when its turn comes, from the pose that the one before has led to."""

_STILL: Rims = (0.0, 0.0)
_SHOULD_TURN_MPS = 0.005
_NEAR_M = 0.005
"""A place that is nearer needs no driving."""


class StuckError(Exception):
    """A wheel shall turn and does not; the text says which."""


class SegmentSequence:
    """The segments of one motion, each begun when the rover stands."""

    def __init__(
        self, segments: Sequence[PlannedSegment], odometry: CountOdometry, settings: BrickSettings
    ) -> None:
        self._waiting = deque(segments)
        self._odometry = odometry
        self._settings = settings
        self._segment: Segment | None = None
        self._begun_m: Rims = _STILL
        self._watched = [(0.0, 0.0), (0.0, 0.0)]
        self._rolling_mps = _STILL

    def rims_mps(self, period_s: float) -> Rims | None:
        """Return the speeds of the rims for the next period; None when all is done and it stands.

        Raises:
            StuckError: a wheel does not turn.
        """
        rims_m = self._odometry.rims_m
        self._look_after_wheels(rims_m, period_s)
        if self._segment is None and self._odometry.standing:
            if not self._waiting:
                return None
            self._segment, self._begun_m = self._waiting.popleft()(self._odometry.pose), rims_m
        rolling_mps = None
        if self._segment is not None:
            rolled_m = (rims_m[0] - self._begun_m[0], rims_m[1] - self._begun_m[1])
            rolling_mps = self._segment.rims_mps(rolled_m, period_s)
        if rolling_mps is None:
            self._segment = None
        self._rolling_mps = rolling_mps or _STILL
        return self._rolling_mps

    def _look_after_wheels(self, rims_m: Rims, period_s: float) -> None:
        for number, side in enumerate(("left", "right")):
            seen_m, still_s = self._watched[number]
            turns = rims_m[number] != seen_m or abs(self._rolling_mps[number]) < _SHOULD_TURN_MPS
            still_s = 0.0 if turns else still_s + period_s
            self._watched[number] = (rims_m[number], still_s)
            if still_s >= self._settings.stuck_s:
                raise StuckError(f"the {side} motor is stuck")


def course(
    motion: Motion,
    speed_mps: float,
    speed_radps: float,
    track_m: float,
    odometry: CountOdometry,
    settings: BrickSettings,
) -> SegmentSequence:
    """Return the course of a motion: turn, line, turn where it leads to a place."""

    def line(distance_m: float) -> Segment:
        sign = copysign(1.0, distance_m)
        return RollSegment(sign, sign, abs(distance_m), speed_mps, settings)

    def turned(angle_rad: float) -> Segment:
        sign, rim_mps = copysign(1.0, angle_rad), speed_radps * track_m / 2
        return RollSegment(-sign, sign, abs(angle_rad) * track_m / 2, rim_mps, settings)

    def headed(heading_rad: float) -> PlannedSegment:
        return lambda pose: turned(wrap_rad(heading_rad - pose.heading_rad))

    match motion:
        case MoveForward(distance_m):
            segments: list[PlannedSegment] = [lambda _: line(distance_m)]
        case RotateBy(angle_rad):
            segments = [lambda _: turned(angle_rad)]
        case RotateTo(heading_rad):
            segments = [headed(heading_rad)]
        case MoveTo(target):
            place = Point(target.x_m, target.y_m)
            segments = [
                lambda pose: headed(pose.point.bearing_rad(place))(pose),
                lambda pose: line(pose.point.distance_m(place)),
            ]
            if odometry.pose.point.distance_m(place) < _NEAR_M:
                segments.clear()
            if target.heading_rad is not None:
                segments.append(headed(target.heading_rad))
        case DriveFor(travel_mps, rotate_radps, duration_s):
            across_mps = rotate_radps * track_m / 2
            rims = (travel_mps - across_mps, travel_mps + across_mps)
            segments = [lambda _: HoldSegment(*rims, duration_s, settings)]
        case _:
            assert_never(motion)
    return SegmentSequence(segments, odometry, settings)
