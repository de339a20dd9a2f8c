"""`StandstillDetector`: whether the rover is at standstill, by each source of motion.

A source that was received once is required, also while it is stale. Positions are compared over a
window besides the velocities: an odometry may have lost its twist, and a twist alone may be zero
for a moment.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, hypot, inf, isfinite, sin
from typing import Final

from executive.values.clock import Clock
from executive.values.facts import Imu, Joints, Odometry, SecondOdometry
from executive.values.geometry import GRAVITY_MPS2, Pose, Velocity, wrap_rad
from executive.values.quantities import quantity_text
from executive.values.reasons import Figure

WINDOW_S: Final = 0.2
"""Minimum duration of standstill by each fast source."""
STANDING_TRAVEL_MPS: Final = 0.03
STANDING_ROTATE_RADPS: Final = 0.06
STANDING_DISTANCE_M: Final = 0.01
STANDING_TURN_RAD: Final = 0.02
"""Maximum motion of the pose within the window."""
STANDING_WHEEL_RADPS: Final = 0.5
"""Maximum wheel rate; a rim of 0.1 m then moves at 0.05 m/s."""
FRAME_DISTANCE_M: Final = 0.03
FRAME_TURN_RAD: Final = 0.02
"""Maximum motion between two frames of the second odometry: more than its noise."""
PUSH_MPS2: Final = 1.5
"""Level acceleration that shows a push while the wheels are stationary: more than noise."""
BRAKING_END_S: Final = 0.06
"""Time from the last motion in the odometry until braking no longer shows in the acceleration."""
PUSH_S: Final = 0.1
"""Duration of a push, and maximum time offset between odometry and inertial sensors."""
SOURCE_TIMEOUT_S: Final = 0.5
FRAME_TIMEOUT_S: Final = 3.0


@dataclass(frozen=True, slots=True)
class SourceMotion:
    """The motion of the rover by one source.

    Attributes:
        is_standing: whether it shows standstill for the required time.
        figures: the speeds, without sign.
        awaited: whether it shows neither standstill nor motion now.
    """

    source: str
    is_standing: bool
    figures: tuple[Figure, ...]
    awaited: bool = False

    def __str__(self) -> str:
        speeds = ", ".join(
            quantity_text(figure.value, figure.unit, ".2f") for figure in self.figures
        )
        since = ", not received since standstill" if self.awaited else ""
        return f"{speeds} by {self.source}{since}"


class _Odometry:
    """The poses and velocities of the last `WINDOW_S`, by arrival.

    Attributes:
        since_s: the stamp since which it shows standstill; infinite while it moves.
    """

    def __init__(self) -> None:
        self._seen: deque[tuple[float, float, Pose, Velocity]] = deque()
        self.since_s = inf

    def add_sample(self, now_s: float, stamp_s: float, pose: Pose, velocity: Velocity) -> None:
        seen = self._seen
        seen.append((now_s, stamp_s, pose, velocity))
        while len(seen) > 1 and seen[1][0] <= now_s - WINDOW_S:
            seen.popleft()
        if not self._is_standing(now_s):
            self.since_s = inf
        elif self.since_s == inf:
            self.since_s = seen[0][1]

    @property
    def stamp_s(self) -> float:
        """The newest stamp; minus infinity before the first."""
        return self._seen[-1][1] if self._seen else -inf

    def motion(self, now_s: float) -> SourceMotion | None:
        """Return the motion that it shows; None without a recent sample."""
        if not self._seen or now_s - self._seen[-1][0] > SOURCE_TIMEOUT_S:
            return None
        first_s, _, first, _ = self._seen[0]
        last_s, _, last, velocity = self._seen[-1]
        travel_mps, rotate_radps = abs(velocity.travel_mps), abs(velocity.rotate_radps)
        if last_s > first_s:
            distance_m, turn_rad = _step(first, last)
            travel_mps = max(travel_mps, distance_m / (last_s - first_s))
            rotate_radps = max(rotate_radps, turn_rad / (last_s - first_s))
        return SourceMotion(
            "odometry", self.since_s < inf, _figures("odometry", travel_mps, rotate_radps)
        )

    def _is_standing(self, now_s: float) -> bool:
        first_s, _, first, _ = self._seen[0]
        distance_m, turn_rad = _step(first, self._seen[-1][2])
        return (
            first_s <= now_s - WINDOW_S + 1e-9
            and distance_m < STANDING_DISTANCE_M
            and turn_rad < STANDING_TURN_RAD
            and all(is_slow(velocity) for _, _, _, velocity in self._seen)
        )


class _Rate:
    """A speed or rate that is zero at standstill."""

    def __init__(self, source: str, bound: float) -> None:
        self._source = source
        self._bound = bound
        self._rate = 0.0
        self._since_s = self._last_sample_s = -inf

    def add_sample(self, now_s: float, rate_radps: float) -> None:
        if not isfinite(rate_radps):
            return
        if abs(rate_radps) >= self._bound or now_s - self._last_sample_s > SOURCE_TIMEOUT_S:
            self._since_s = now_s
        self._rate, self._last_sample_s = abs(rate_radps), now_s

    def motion(self, now_s: float) -> SourceMotion | None:
        """Return the motion that it shows; None before the first sample."""
        if self._last_sample_s == -inf:
            return None
        silent = now_s - self._last_sample_s > SOURCE_TIMEOUT_S
        is_standing = not silent and self._last_sample_s - self._since_s >= WINDOW_S - 1e-9
        figures = (Figure(self._source, self._rate, "rad/s"),)
        return SourceMotion(self._source, is_standing, figures, silent)


class _Frames:
    """Frames of the second odometry, compared with the first one at standstill."""

    def __init__(self) -> None:
        self._reference: tuple[float, Pose] | None = None
        self._last: tuple[float, Pose] | None = None
        self._last_frame_s = -inf
        self._speeds = (0.0, 0.0)
        self._is_standing = self._compared = False

    def add_frame(self, now_s: float, stamp_s: float, pose: Pose, since_s: float) -> None:
        """Add a frame. `since_s` is the stamp since which odometry shows standstill."""
        if not pose.finite:
            return
        before, self._last, self._last_frame_s = self._last, (stamp_s, pose), now_s
        if before is not None and stamp_s > before[0]:
            distance_m, turn_rad = _step(before[1], pose)
            self._speeds = distance_m / (stamp_s - before[0]), turn_rad / (stamp_s - before[0])
        self._is_standing = self._compared = False
        if self._reference is not None and self._reference[0] >= since_s:
            self._compared = True
            distance_m, turn_rad = _step(self._reference[1], pose)
            self._is_standing = distance_m < FRAME_DISTANCE_M and turn_rad < FRAME_TURN_RAD
        if not self._is_standing:
            self._reference = (stamp_s, pose)

    def motion(self, now_s: float, since_s: float) -> SourceMotion | None:
        """Return the motion that it shows; None before the first frame."""
        if self._reference is None:
            return None
        known = now_s - self._last_frame_s <= FRAME_TIMEOUT_S and self._reference[0] >= since_s
        figures = _figures("second odometry", *self._speeds)
        is_standing = known and self._is_standing
        return SourceMotion("second odometry", is_standing, figures, not (known and self._compared))


class StandstillDetector:
    """Detects standstill by all sources received so far."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._odometry = _Odometry()
        self._joints = _Rate("joints", STANDING_WHEEL_RADPS)
        self._gyro = _Rate("gyro", STANDING_ROTATE_RADPS)
        self._frames = _Frames()
        self._shaken_s = -inf

    def observe(self, fact: Odometry | Imu | Joints | SecondOdometry) -> None:
        """Add a sample of a source; the two odometries are stamped by one clock."""
        now_s = self._clock.now_s()
        match fact:
            case Odometry(stamp_s, pose, velocity):
                self._odometry.add_sample(now_s, stamp_s, pose, velocity)
            case Imu():
                self._gyro.add_sample(now_s, fact.gyro_z_radps)
                if _ground_acceleration_mps2(fact) > PUSH_MPS2:
                    self._shaken_s = self._odometry.stamp_s
            case Joints():
                wheels_radps = (*fact.left_radps, *fact.right_radps)
                if wheels_radps:
                    self._joints.add_sample(now_s, max(wheels_radps, key=abs))
            case SecondOdometry(stamp_s, pose):
                self._frames.add_frame(now_s, stamp_s, pose, self._odometry.since_s)

    @property
    def since_s(self) -> float:
        """The stamp since which the odometry shows standstill; infinite while it moves."""
        return self._odometry.since_s

    @property
    def undisturbed_since_s(self) -> float:
        """The stamp since which it is stationary and the inertial sensors show no push.

        While the rover brakes, they cannot show a push.
        """
        pushed = self._shaken_s > self.since_s + BRAKING_END_S
        return self._shaken_s + PUSH_S if pushed else self.since_s

    def by_source(self) -> tuple[SourceMotion, ...]:
        """Return the motion by each source that was ever received."""
        now_s = self._clock.now_s()
        motions = (
            self._odometry.motion(now_s),
            self._joints.motion(now_s),
            self._gyro.motion(now_s),
            self._frames.motion(now_s, self._odometry.since_s),
        )
        return tuple(motion for motion in motions if motion is not None)


def join_sources(sources: Sequence[str]) -> str:
    """Return a list of sources, for display."""
    if len(sources) == 1:
        return f"by {sources[0]} alone"
    return f"by {', '.join(sources[:-1])} and {sources[-1]}"


def is_slow(velocity: Velocity) -> bool:
    """Return whether a velocity counts as standstill."""
    return (
        abs(velocity.travel_mps) < STANDING_TRAVEL_MPS
        and abs(velocity.rotate_radps) < STANDING_ROTATE_RADPS
    )


def _ground_acceleration_mps2(fact: Imu) -> float:
    """Return the acceleration along the ground, 0 if it is unknown."""
    x_mps2 = fact.acceleration_x_mps2 + GRAVITY_MPS2 * sin(fact.pitch_rad)
    aside_mps2 = GRAVITY_MPS2 * cos(fact.pitch_rad) * sin(fact.roll_rad)
    found_mps2 = hypot(x_mps2, fact.acceleration_y_mps2 - aside_mps2)
    return found_mps2 if isfinite(found_mps2) else 0.0


def _step(before: Pose, after: Pose) -> tuple[float, float]:
    turn_rad = abs(wrap_rad(after.heading_rad - before.heading_rad))
    return before.point.distance_m(after.point), turn_rad


def _figures(source: str, travel_mps: float, rotate_radps: float) -> tuple[Figure, Figure]:
    return Figure(source, travel_mps, "m/s"), Figure(f"{source} turn", rotate_radps, "rad/s")
