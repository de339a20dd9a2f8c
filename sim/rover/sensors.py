"""`SensorSuite` reads the sensors in an asset's settings during the physics of a Jackal.

Visual odometry and the laser are here, the others are `instruments`.
"""

from collections.abc import Mapping
from dataclasses import replace
from math import copysign, cos, gcd, hypot, inf, nan, pi, sin
from typing import Final

import mujoco
import numpy as np
from numpy.random import default_rng

from executive.settings import Sensor, Sensors
from executive.values.facts import Fact, LaserScan, SecondOdometry
from executive.values.geometry import Pose, wrap_rad
from sim.checkpoint import Checkpointed, changing
from sim.rover import faults
from sim.rover.body import SOON_S, STEP_S, STEPS_PER_PERIOD, SimulatedBody, offset_left
from sim.rover.instruments import InertialUnit, Instrument, WheelSensors

_SCALE: Final = (0.01, 0.02)
"""Bounds of the relative scale error in a run, of either sign."""
_DRIFT_RADPM: Final = 0.002
"""Standard deviation of the drift of the heading in a run."""
_NOISE_M: Final = 0.006
_NOISE_RAD: Final = 0.003
"""Standard deviations of one position and one angle."""
_LATENCY_S: Final = (0.3, 0.5)
"""Bounds of the latency of a frame's result."""
_MISSING: Final = 0.03
_MISSING_IN_TURN: Final = 0.3
"""Ratios of frames without a result."""
_TURN_RADPS: Final = 1.2
"""Minimum rate of a turn."""
_GAP_S: Final = (1.5, 4.0)
_BETWEEN_GAPS_S: Final = (60.0, 120.0)
"""Bounds of the duration of a gap without results, and of the time between gaps."""


class VisualOdometry(Instrument):
    """Pose of the rover by its camera's view of the ground, relative to its start.

    Its uncertainty includes the errors that are not constant, and the scale error.
    """

    CHANGES = changing(
        Instrument,
        _random=np.random.Generator,
        _distance_m=float,
        _true=Pose,
        _pose=Pose,
        _gap_from_s=float,
        _gap_until_s=float,
        _last=SecondOdometry | None,
    )
    MOMENTARY = faults.SecondOdometryJump

    def __init__(self, rover: SimulatedBody, rate_hz: float, random: np.random.Generator) -> None:
        super().__init__(rover, rate_hz, random)
        self._scale = 1 + copysign(random.uniform(*_SCALE), random.uniform(-1, 1))
        self._drift_radpm = _DRIFT_RADPM * random.standard_normal()
        self._distance_m = 0.0
        self._true = rover.true_pose
        self._pose = Pose()
        self._gap_from_s = random.uniform(0.0, _BETWEEN_GAPS_S[1])
        self._gap_until_s = self._gap_from_s + random.uniform(*_GAP_S)
        self._last: SecondOdometry | None = None

    def settle(self) -> None:
        """Begin at the present true pose."""
        super().settle()
        self._true = self._rover.true_pose

    def continue_from(self, last: SecondOdometry, pose: Pose) -> None:
        """Continue from the last frame, and from the pose in its frame at this time."""
        self._last, self._pose = last, pose
        self._distance_m = last.position_sd_m / (sum(_SCALE) / 2)

    def measure(self, stamp_s: float) -> SecondOdometry | None:
        """Return the pose of a frame taken now; None without a result."""
        self._follow(self._rover.true_pose)
        self._mislead()
        fact, there = self._frame(stamp_s)
        if not there or self._fault(faults.SecondOdometryLost) is not None:
            return None
        if self._last is not None and self._fault(faults.SecondOdometryFrozen) is not None:
            fact = replace(self._last, stamp_s=stamp_s)
        self._last = fact
        return fact

    def _follow(self, true: Pose) -> None:
        """Add the displacement since the last frame."""
        before, self._true = self._true, true
        x_m, y_m = true.x_m - before.x_m, true.y_m - before.y_m
        off_rad = self._pose.heading_rad - before.heading_rad
        distance_m = hypot(x_m, y_m)
        self._distance_m += distance_m
        turn_rad = wrap_rad(true.heading_rad - before.heading_rad) + self._drift_radpm * distance_m
        self._pose = Pose(
            self._pose.x_m + self._scale * (x_m * cos(off_rad) - y_m * sin(off_rad)),
            self._pose.y_m + self._scale * (x_m * sin(off_rad) + y_m * cos(off_rad)),
            self._pose.z_m + self._scale * (true.z_m - before.z_m),
            wrap_rad(self._pose.heading_rad + turn_rad),
            true.roll_rad,
            true.pitch_rad,
        )

    def _mislead(self) -> None:
        """Move the pose as faults do."""
        drift = self._fault(faults.SecondOdometryDrift)
        if isinstance(jump := self.begins(), faults.SecondOdometryJump):
            self._pose = offset_left(self._pose, jump.by_m)
        if drift is not None:
            self._pose = offset_left(self._pose, drift.rate_mps * self._since_s)

    def _frame(self, stamp_s: float) -> tuple[SecondOdometry, bool]:
        """Return the fact of a frame, and whether it has a result; both use the same draws."""
        pose, random = self._pose, self._random
        noise = random.standard_normal(6).tolist()
        late, missed = random.uniform(size=2).tolist()
        self.latency_s = _LATENCY_S[0] + (_LATENCY_S[1] - _LATENCY_S[0]) * late
        measured = Pose(
            pose.x_m + _NOISE_M * noise[0],
            pose.y_m + _NOISE_M * noise[1],
            pose.z_m + _NOISE_M * noise[2],
            wrap_rad(pose.heading_rad + _NOISE_RAD * noise[3]),
            pose.roll_rad + _NOISE_RAD * noise[4],
            pose.pitch_rad + _NOISE_RAD * noise[5],
        )
        turning = abs(self._rover.true_velocity.rotate_radps) > _TURN_RADPS
        seen = missed >= (_MISSING_IN_TURN if turning else _MISSING)
        fact = SecondOdometry(
            stamp_s,
            measured,
            hypot(_NOISE_M, sum(_SCALE) / 2 * self._distance_m),
            hypot(_NOISE_RAD, _DRIFT_RADPM * self._distance_m),
        )
        return fact, seen and not self._in_gap(stamp_s) and not self._rover.world.dark

    def _in_gap(self, stamp_s: float) -> bool:
        if stamp_s >= self._gap_until_s:
            self._gap_from_s = self._gap_until_s + self._random.uniform(*_BETWEEN_GAPS_S)
            self._gap_until_s = self._gap_from_s + self._random.uniform(*_GAP_S)
        return stamp_s >= self._gap_from_s


RAYS: Final = 360
RANGE_MIN_M: Final = 0.1
RANGE_MAX_M: Final = 20.0
_HEIGHT_M: Final = 0.2
"""Height of the laser over base_link: 0.26 m over level ground."""
_RANGE_NOISE_M: Final = 0.01
_SCAN_LATENCY_S: Final = 0.06
_SEEN: Final = np.array([1, 0, 0, 0, 1, 0], np.uint8)
"""Groups of geoms that reflect: ground, walls, and the ellipsoids of rocks, which wheels touch."""


class Laser(Instrument):
    """One ray per degree all around, in a plane that tilts with the rover."""

    CHANGES = changing(Instrument, _random=np.random.Generator)

    def __init__(self, rover: SimulatedBody, rate_hz: float, random: np.random.Generator) -> None:
        super().__init__(rover, rate_hz, random)
        self.latency_s = _SCAN_LATENCY_S
        self._model, self._data = rover.model, rover.data
        self._bearing_rad = bearing_rad = 2 * pi * np.arange(RAYS) / RAYS - pi
        self._rays = np.stack((np.cos(bearing_rad), np.sin(bearing_rad), 0 * bearing_rad), 1)
        self._hit = np.empty(RAYS, np.int32)
        self._range_m = np.empty(RAYS)
        self._axes = np.empty(9)

    def measure(self, stamp_s: float) -> LaserScan | None:
        """Return a scan of the present state, with all rays at the same time."""
        noise_m = _RANGE_NOISE_M * self._random.standard_normal(RAYS)
        if self._fault(faults.LaserDead) is not None:
            return None
        position_m, attitude = self._data.qpos[:3], self._data.qpos[3:7]
        mujoco.mju_quat2Mat(self._axes, attitude)
        axes = self._axes.reshape(3, 3)
        mujoco.mj_multiRay(
            self._model,
            self._data,
            position_m + _HEIGHT_M * axes[:, 2],
            (self._rays @ axes.T).ravel(),
            _SEEN,
            True,
            -1,
            self._hit,
            self._range_m,
            None,
            RAYS,
            RANGE_MAX_M,
        )
        measured_m = np.maximum(self._range_m + noise_m, RANGE_MIN_M)
        nothing = (self._hit < 0) | (measured_m > RANGE_MAX_M)
        ranges_m = np.where(nothing, inf, measured_m)
        if (blind := self._fault(faults.LaserBlind)) is not None:
            sector = np.flatnonzero(np.abs(self._bearing_rad) <= blind.sector_rad / 2)
            lost = np.floor(blind.share * np.arange(1, len(sector) + 1))
            ranges_m[sector[np.diff(lost, prepend=0.0) > 0.0]] = nan
        return LaserScan(
            stamp_s, -pi, 2 * pi / RAYS, RANGE_MIN_M, RANGE_MAX_M, tuple(ranges_m.tolist())
        )


_KINDS: Final[Mapping[Sensor, type[Instrument]]] = {
    Sensor.IMU: InertialUnit,
    Sensor.JOINTS: WheelSensors,
    Sensor.SECOND_ODOMETRY: VisualOdometry,
    Sensor.LASER: Laser,
}


class SensorSuite(Checkpointed):
    """Reads each instrument at its rate, and delays its facts by its latency.

    Each instrument has separate random numbers.

    Attributes:
        instruments: its instruments.
        every: steps of physics between two calls of `read`, a part of a period.
    """

    CHANGES = changing(
        instruments=Checkpointed, _due_s=list[float], _delayed=list[tuple[float, Fact]]
    )

    def __init__(self, sensors: Sensors, seed: int, rover: SimulatedBody) -> None:
        self.instruments = tuple(
            _KINDS[each](rover, getattr(sensors, each.value).rate_hz, default_rng([seed, number]))
            for number, each in enumerate(Sensor, 1)
            if each in sensors.present
        )
        self._due_s = [0.0] * len(self.instruments)
        self._delayed: list[tuple[float, Fact]] = []
        self.every = gcd(STEPS_PER_PERIOD, *(each.every for each in self.instruments))

    def read(self, steps: int) -> list[Fact]:
        """Return the facts published at a step of physics."""
        time_s = steps * STEP_S
        published = self._arrived(time_s)
        for number, instrument in enumerate(self.instruments):
            if steps % instrument.every:
                continue
            fact = instrument.measure(time_s)
            if fact is None:
                continue
            if not instrument.latency_s:
                published.append(fact)
                continue
            due_s = max(time_s + instrument.latency_s, self._due_s[number])
            self._due_s[number] = due_s
            self._delayed.append((due_s, fact))
        return published

    def skip(self) -> None:
        """Drop scans in transit: after a skip of time they would be too old."""
        self._delayed.clear()

    def _arrived(self, time_s: float) -> list[Fact]:
        pending, until_s = self._delayed, time_s + SOON_S
        self._delayed = [each for each in pending if each[0] > until_s]
        return [fact for due_s, fact in pending if due_s <= until_s]
