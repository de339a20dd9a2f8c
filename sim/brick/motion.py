"""One motion of the emulated brick: consecutive segments, controlled by its own odometry.

A segment is a line, a turn on the spot, or a held velocity, from standstill to standstill.
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import copysign, cos, radians, sin, sqrt
from typing import Final, Protocol, assert_never

from executive.commands import DriveFor, MoveForward, MoveTo, RotateBy, RotateTo
from executive.values.geometry import Point, Pose, Velocity, wrap_rad

WINDOW: Final = 5
"""Window of the speed measurement in periods; without a count in it the rover is stationary."""

Rims = tuple[float, float]
"""Figures of the left and of the right wheel's rim."""
_SYNC_PER_S = 4.0
"""Gain that slows down the wheel that leads. Chosen, not measured."""
_MAX_SYNC = 0.3


class CountOdometry:
    """Pose, speed and rim distances from counts.

    Attributes:
        rims_m: distance that each rim has rolled since the start, m.
    """

    def __init__(self, radius_m: float, track_m: float, start: Pose) -> None:
        self._count_m = radius_m * radians(1.0)
        self._track_m = track_m
        self.rims_m = (0.0, 0.0)
        self._recent: deque[tuple[float, Rims]] = deque([(0.0, self.rims_m)], WINDOW + 1)
        self.pose = start

    @property
    def velocity(self) -> Velocity:
        """Mean velocity over the window."""
        (then_s, (left0_m, right0_m)), (now_s, (left_m, right_m)) = (
            self._recent[0],
            self._recent[-1],
        )
        if now_s <= then_s:
            return Velocity(0.0, 0.0)
        left_mps = (left_m - left0_m) / (now_s - then_s)
        right_mps = (right_m - right0_m) / (now_s - then_s)
        return Velocity((left_mps + right_mps) / 2, (right_mps - left_mps) / self._track_m)

    @property
    def standing(self) -> bool:
        """Whether no count has changed for a whole window."""
        return all(rims_m == self.rims_m for _, rims_m in self._recent)

    def advance(self, now_s: float, left_deg: int, right_deg: int) -> None:
        """Process the counts of a period."""
        rims_m = (left_deg * self._count_m, right_deg * self._count_m)
        left_m, right_m = rims_m[0] - self.rims_m[0], rims_m[1] - self.rims_m[1]
        turn_rad = (right_m - left_m) / self._track_m
        ahead_m, midway_rad = (left_m + right_m) / 2, self.pose.heading_rad + turn_rad / 2
        self.pose = replace(
            self.pose,
            x_m=self.pose.x_m + ahead_m * cos(midway_rad),
            y_m=self.pose.y_m + ahead_m * sin(midway_rad),
            heading_rad=wrap_rad(self.pose.heading_rad + turn_rad),
        )
        self.rims_m = rims_m
        self._recent.append((now_s, rims_m))


class Segment(Protocol):
    """A motion from standstill to standstill."""

    def rims_mps(self, rims_m: Rims, period_s: float) -> Rims | None:
        """Return the speeds of the rims for the next period; None at the end.

        Args:
            rims_m: distance that the rims have rolled since the start of the segment, m.
            period_s: duration of the speeds, s.
        """
        ...


@dataclass(frozen=True, slots=True)
class BrickSettings:
    """One brick.

    Attributes:
        wheel_radius_m, track_m: dimensions of the rover in its program.
        track_error: bounds of the relative error of its track; the sign is drawn too.
        latency_s: bounds of the time from the last octet of a command to its reply.
        travel_mps, rotate_radps: maximum speeds that can be set.
        first_travel_mps, first_rotate_radps: speeds until they are set.
        rim_mps2: acceleration of a wheel's rim, except at a stop.
        creep_mps: speed over the last millimetres.
        stuck_s: time after which a driven wheel that does not turn counts as stuck.
        hold_s: maximum duration of a held velocity.
        host_rate: seconds of its own clock per second of its host's.
    """

    name: str = "MOCUP"
    wheel_radius_m: float = 0.0408
    track_m: float = 0.16
    track_error: tuple[float, float] = (0.01, 0.02)
    latency_s: tuple[float, float] = (0.05, 0.1)
    telemetry_s: float = 0.2
    travel_mps: float = 0.3
    rotate_radps: float = 2.0
    first_travel_mps: float = 0.1
    first_rotate_radps: float = 0.5
    rim_mps2: float = 0.4
    creep_mps: float = 0.012
    stuck_s: float = 1.0
    hold_s: float = 600.0
    host_rate: float = 1.0


@dataclass(slots=True)
class RollSegment:
    """Both wheels over the same distance, in equal or opposite directions, at a trapezoidal speed.

    Attributes:
        left, right: direction of each wheel, +1.0 or -1.0.
        length_m: distance of each rim.
        speed_mps: maximum speed.
    """

    left: float
    right: float
    length_m: float
    speed_mps: float
    settings: BrickSettings
    _now_mps: float = 0.0

    def rims_mps(self, rims_m: Rims, period_s: float) -> Rims | None:
        """Return the speeds; the wheel that leads is slowed down."""
        left_m, right_m = self.left * rims_m[0], self.right * rims_m[1]
        rest_m = self.length_m - (left_m + right_m) / 2
        if rest_m <= self._now_mps * period_s / 2:
            return None
        faster_mps = self._now_mps + self.settings.rim_mps2 * period_s
        braking_mps = max(self.settings.creep_mps, sqrt(2 * self.settings.rim_mps2 * rest_m))
        self._now_mps = min(self.speed_mps, faster_mps, braking_mps)
        max_mps = _MAX_SYNC * self._now_mps
        sync_mps = max(-max_mps, min(max_mps, _SYNC_PER_S * (left_m - right_m)))
        return self.left * (self._now_mps - sync_mps), self.right * (self._now_mps + sync_mps)


@dataclass(slots=True)
class HoldSegment:
    """A velocity held for a time, including ramps."""

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
"""Creates a segment at its start, from the pose at the end of the previous one."""

_STILL: Rims = (0.0, 0.0)
_SHOULD_TURN_MPS = 0.005
_MIN_DRIVE_M = 0.005
"""Distance to a target below which no line is driven."""


class StuckError(Exception):
    """A driven wheel does not turn; the text names it."""


class SegmentSequence:
    """The segments of one motion, each started at standstill."""

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
        """Return the rim speeds for the next period; None at standstill after the last segment.

        Raises:
            StuckError: a wheel does not turn.
        """
        rims_m = self._odometry.rims_m
        self._check_stall(rims_m, period_s)
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

    def _check_stall(self, rims_m: Rims, period_s: float) -> None:
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
    """Return the segments of a motion: turn, line, turn for a position target."""

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
            position = Point(target.x_m, target.y_m)
            segments = [
                lambda pose: headed(pose.point.bearing_rad(position))(pose),
                lambda pose: line(pose.point.distance_m(position)),
            ]
            if odometry.pose.point.distance_m(position) < _MIN_DRIVE_M:
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
