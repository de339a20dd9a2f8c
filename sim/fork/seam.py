"""`RecordedMotion`: how a recorded rover moved and measured, for a simulation that continues it."""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from executive.values.facts import (
    Battery,
    CameraAngles,
    Fact,
    Imu,
    Joints,
    LaserScan,
    Odometry,
    SecondOdometry,
)
from executive.values.geometry import STANDING, Pose, Velocity, step_between, up_of, wrap_rad
from sim.rover.body import PERIOD_S

_STORED: Final = 256
"""Number of poses: five seconds of an odometry of 50 Hz."""
_GRAVITY_MPS2: Final = 9.81
_STANDSTILL_S: Final = 0.5
"""Time after which a rover that is commanded zero is stationary."""
_ENOUGH: Final = 20
_MEASURED: Final = 2000
"""Minimum and maximum measurements of a standing rover; their mean is its constant error."""
_MAX_MPS: Final = 2.0
"""Maximum speed of the base."""
_OTHER_CLOCK_S: Final = 5.0
"""Minimum difference of stamps and the core's clock, if they are different clocks."""

Track = Sequence[tuple[float, Pose]]


class RecordedMotion:
    """The last facts of a recording, and the errors of its inertial unit.

    Args:
        charge_ratio: charge of the battery if the recording has none.

    Attributes:
        truths: times and true poses; empty for a real rover.
        ahead_s: difference of the clock of stamps, which is that of a live simulation, and the
            core's; 0 if it is the same.
        published, second, camera: the last facts.
        charge_ratio: charge of the battery.
    """

    def __init__(self, charge_ratio: float) -> None:
        self.truths: deque[tuple[float, Pose]] = deque(maxlen=_STORED)
        self.ahead_s = 0.0
        self._poses: deque[tuple[float, Pose]] = deque(maxlen=_STORED)
        self.published: Odometry | None = None
        self.second: SecondOdometry | None = None
        self.camera: CameraAngles | None = None
        self.charge_ratio = charge_ratio
        self._moved_s = 0.0
        self._errors: deque[list[float]] = deque(maxlen=_MEASURED)

    def observe(self, now_s: float, fact: Fact, commanded: Velocity, is_measured: bool) -> None:
        """Follow a fact; an odometry that repeats earlier poses is none that is measured."""
        if commanded != STANDING:
            self._moved_s = now_s
        match fact:
            case Odometry():
                ahead_s = fact.stamp_s - now_s + PERIOD_S
                if abs(ahead_s) > _OTHER_CLOCK_S:
                    self.ahead_s = max(ahead_s, self.ahead_s or ahead_s)
                self.published = fact = replace(fact, stamp_s=fact.stamp_s - self.ahead_s)
                if is_measured and (not self._poses or fact.stamp_s > self._poses[-1][0]):
                    self._poses.append((fact.stamp_s, fact.pose))
            case SecondOdometry():
                self.second = replace(fact, stamp_s=fact.stamp_s - self.ahead_s)
            case CameraAngles():
                self.camera = fact
            case Battery(charge_ratio=ratio) if ratio is not None:
                self.charge_ratio = ratio
            case Imu() if now_s - self._moved_s > _STANDSTILL_S and self.published is not None:
                lean = self.published.pose
                up = up_of(lean.roll_rad, lean.pitch_rad)
                felt = (a - _GRAVITY_MPS2 * b for a, b in zip(fact.acceleration, up, strict=True))
                leans = fact.roll_rad - lean.roll_rad, fact.pitch_rad - lean.pitch_rad
                self._errors.append([*felt, *fact.rates, *leans])
            case _:
                pass

    def at(self, time_s: float) -> tuple[Pose, Velocity]:
        """Return pose and velocity at a time shortly after the last fact, on the core's clock."""
        pose, before = self._pose_at(time_s), self._pose_at(time_s - 2 * PERIOD_S)
        ahead_m, _, turn_rad = step_between(before, pose)
        return pose, Velocity(ahead_m / (2 * PERIOD_S), turn_rad / (2 * PERIOD_S))

    def second_pose(self, second: SecondOdometry, pose: Pose) -> Pose:
        """Return the pose of the second odometry, in its frame, for a pose."""
        return _moved(second.pose, self._pose_at(second.stamp_s), pose)

    @property
    def inertial_errors(self) -> list[float]:
        """Constant errors of accelerometer, gyro, roll and pitch; empty if they are unknown."""
        if len(self._errors) < _ENOUGH:
            return []
        errors: list[float] = np.nan_to_num(np.mean(self._errors, 0)).tolist()
        return errors

    def _pose_at(self, time_s: float) -> Pose:
        return _pose_at(self.truths or self._poses, time_s)

    def measured(self, time_s: float, late_s: float) -> Iterator[Odometry]:
        """Yield the odometry that is measured until a time, but not published.

        Args:
            time_s: time on the core's clock.
            late_s: latency of the odometry, more than its usual one.
        """
        _, velocity = self.at(time_s)
        last_s, last = self._poses[-1] if self._poses else (time_s, self._pose_at(time_s))
        track = self.truths or self._poses
        moved_m = _pose_at(track, last_s).point.distance_m(_pose_at(track, time_s).point)
        if moved_m > _MAX_MPS * (time_s - last_s + PERIOD_S):
            track = self._poses  # a push, which odometry does not measure
        published_s = -1.0 if self.published is None else self.published.stamp_s
        for periods in range(round(late_s / PERIOD_S), -1, -1):
            stamp_s = time_s - periods * PERIOD_S
            pose = _moved(last, _pose_at(track, last_s), _pose_at(track, stamp_s))
            if stamp_s > published_s + PERIOD_S / 2 or not periods:
                yield Odometry(max(stamp_s, published_s + 1e-3), pose, velocity)


def shifted(fact: Fact, by_s: float) -> Fact:
    """Return a fact with another stamp, if it has one."""
    match fact:
        case Odometry() | SecondOdometry() | Imu() | Joints() | LaserScan():
            return replace(fact, stamp_s=fact.stamp_s + by_s)
        case _:
            return fact


def _moved(pose: Pose, before: Pose, after: Pose) -> Pose:
    """Return the pose of one frame after a displacement in another."""
    there = pose.compose(before.inverse.compose(after))
    return replace(there, z_m=pose.z_m + after.z_m - before.z_m)


def _pose_at(track: Track, time_s: float) -> Pose:
    """Return the pose at a time, also shortly beyond the ends of a track."""
    if len(track) < 2:
        return track[0][1] if track else Pose()
    at = next((i for i, (s, _) in enumerate(track) if s >= time_s and i), len(track) - 1)
    (before_s, before), (after_s, after) = track[at - 1], track[at]
    part = (time_s - before_s) / (after_s - before_s)
    turn_rad = wrap_rad(after.heading_rad - before.heading_rad)
    return Pose(
        before.x_m + part * (after.x_m - before.x_m),
        before.y_m + part * (after.y_m - before.y_m),
        before.z_m + part * (after.z_m - before.z_m),
        wrap_rad(before.heading_rad + part * turn_rad),
        before.roll_rad + part * (after.roll_rad - before.roll_rad),
        before.pitch_rad + part * (after.pitch_rad - before.pitch_rad),
    )
