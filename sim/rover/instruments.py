"""What a simulated Jackal feels of itself, beside its odometry: inertia, and its wheels.

Each instrument measures what is true with errors of its own, from a random generator of its own,
so that none changes what another measures.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from math import asin, atan2, sqrt
from typing import Final, Protocol, TypeVar

import mujoco
import numpy as np

from executive.state import Fact, Imu, Joints
from sim.rover import faults
from sim.rover.body import STEP_S
from sim.rover.faults import Fault

F = TypeVar("F", bound=Fault)

_GRAVITY_MPS2: Final = 9.81
_GREATEST_RADPS: Final = 35.0
_GREATEST_MPS2: Final = 157.0
"""Where gyros and accelerometers saturate: 2000 degrees a second, 16 g."""
_WHEELS: Final = slice(7, 11)
"""Angles of front left and right, rear left and right, in the state of physics."""
_WHEEL_RATES: Final = slice(6, 10)
_SHAKEN_M: Final = 0.098 / 4
"""Mean speed of the ground below the wheels, per sum of their rates."""


class FaultLookup(Protocol):
    """What is wrong with a rover."""

    def __call__(self, kind: type[F], /) -> F | None:
        """Return the fault of a kind, if it is there."""


class Instrument(ABC):
    """Something that measures at a rate.

    Attributes:
        every: it measures each so many steps of physics.
        latency_s: from the last measurement until it is published.
    """

    def __init__(self, rate_hz: float, fault: FaultLookup) -> None:
        """Measure so often, as often as the steps allow.

        Args:
            rate_hz: how often.
            fault: what is wrong with the rover.
        """
        self.every = max(1, round(1 / (rate_hz * STEP_S)))
        self.latency_s = 0.0
        self._since_s = self.every * STEP_S
        self._fault = fault

    @abstractmethod
    def measure(self, stamp_s: float) -> Fact | None:
        """Return what is measured now; None where nothing is."""


def draws(random: np.random.Generator, width: int) -> Iterator[list[float]]:
    """Yield rows of standard normal numbers, drawn in blocks because that is fast."""
    while True:
        yield from random.standard_normal((512, width)).tolist()


@dataclass(frozen=True, slots=True)
class ImuErrors:
    """How good an inertial measurement unit is, as standard deviations.

    Attributes:
        acceleration_bias_mps2, gyro_bias_radps, lean_bias_rad: of what is constant in a run.
        acceleration_noise_mps2: of one acceleration, to which vibration adds as the wheels turn.
        vibration_hz: acceleration noise per wheel speed, in m/s2 per m/s.
        gyro_noise_radps, lean_noise_rad: of one rate, and one roll or pitch.
    """

    acceleration_bias_mps2: float = 0.05
    acceleration_noise_mps2: float = 0.03
    vibration_hz: float = 0.3
    gyro_bias_radps: float = 0.003
    gyro_noise_radps: float = 0.004
    lean_bias_rad: float = 0.005
    lean_noise_rad: float = 0.002


class InertialUnit(Instrument):
    """Mean rates and accelerations since the last measurement, and the lean."""

    def __init__(
        self,
        rate_hz: float,
        fault: FaultLookup,
        random: np.random.Generator,
        data: mujoco.MjData,
    ) -> None:
        super().__init__(rate_hz, fault)
        self._errors = errors = ImuErrors()
        bias = random.standard_normal(8).tolist()
        self._bias_mps2 = [errors.acceleration_bias_mps2 * each for each in bias[:3]]
        self._bias_radps = [errors.gyro_bias_radps * each for each in bias[3:6]]
        self._bias_rad = [errors.lean_bias_rad * each for each in bias[6:]]
        self._draws = draws(random, 8)
        self._attitude, self._linear = data.qpos[3:7], data.qvel[:3]
        self._wheels = data.qvel[_WHEEL_RATES]
        self._before, self._before_mps = self._attitude.tolist(), self._linear.tolist()

    def measure(self, stamp_s: float) -> Imu | None:
        """Return what is measured since the last call, in the axes of base_link."""
        errors, since_s, row = self._errors, self._since_s, next(self._draws)
        before, before_mps = self._before, self._before_mps
        now, now_mps = self._attitude.tolist(), self._linear.tolist()
        self._before, self._before_mps = now, now_mps
        if self._fault(faults.ImuDead) is not None:
            return None
        force_mps2 = [(a - b) / since_s for a, b in zip(now_mps, before_mps, strict=True)]
        force_mps2[2] += _GRAVITY_MPS2
        felt_mps2 = _in_body(_midway(before, now), force_mps2)
        wheels_mps = _SHAKEN_M * sum(map(abs, self._wheels.tolist()))
        shaking_mps2 = errors.acceleration_noise_mps2 + errors.vibration_hz * wheels_mps
        turned_radps = self._by_gyro(_rates(before, now, since_s))
        w, x, y, z = now
        roll_rad = atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
        pitch_rad = asin(max(-1.0, min(1.0, 2 * (w * y - x * z))))
        return Imu(
            stamp_s,
            roll_rad + self._bias_rad[0] + errors.lean_noise_rad * row[6],
            pitch_rad + self._bias_rad[1] + errors.lean_noise_rad * row[7],
            *(
                _cut(true + bias + errors.gyro_noise_radps * drawn, _GREATEST_RADPS)
                for true, bias, drawn in zip(turned_radps, self._bias_radps, row[:3], strict=True)
            ),
            *(
                _cut(true + bias + shaking_mps2 * drawn, _GREATEST_MPS2)
                for true, bias, drawn in zip(felt_mps2, self._bias_mps2, row[3:6], strict=True)
            ),
        )

    def _by_gyro(self, rates_radps: list[float]) -> list[float]:
        """Return what the gyro measures of true rates, but for its own errors."""
        dead = self._fault(faults.GyroDead)
        gain, bias = self._fault(faults.GyroGain), self._fault(faults.GyroBias)
        if dead is not None and dead.shared:
            return [0.0, 0.0, 0.0]
        if gain is not None and gain.shared:
            rates_radps = [gain.factor * each for each in rates_radps]
        if bias is not None and bias.shared:
            rates_radps = [*rates_radps[:2], rates_radps[2] + bias.rate_radps]
        return rates_radps


def _rates(before: list[float], after: list[float], since_s: float) -> list[float]:
    """Return the mean rates about the body's axes between two attitudes near each other."""
    a, b, c, d = before
    w, x, y, z = after
    same = 2 / since_s if a * w + b * x + c * y + d * z >= 0 else -2 / since_s
    return [
        same * (a * x - b * w - c * z + d * y),
        same * (a * y + b * z - c * w - d * x),
        same * (a * z - b * y + c * x - d * w),
    ]


def _midway(before: list[float], after: list[float]) -> list[float]:
    """Return the attitude between two that are near each other."""
    same = 1 if sum(a * b for a, b in zip(before, after, strict=True)) >= 0 else -1
    middle = [a + same * b for a, b in zip(before, after, strict=True)]
    length = sqrt(sum(each * each for each in middle))
    return [each / length for each in middle]


def _in_body(attitude: list[float], vector: list[float]) -> list[float]:
    """Return a vector of the world in the axes of a body."""
    w, x, y, z = attitude
    u, v, r = vector
    return [
        (1 - 2 * (y * y + z * z)) * u + 2 * (x * y + w * z) * v + 2 * (x * z - w * y) * r,
        2 * (x * y - w * z) * u + (1 - 2 * (x * x + z * z)) * v + 2 * (y * z + w * x) * r,
        2 * (x * z + w * y) * u + 2 * (y * z - w * x) * v + (1 - 2 * (x * x + y * y)) * r,
    ]


def _cut(value: float, most: float) -> float:
    return max(-most, min(most, value))


class WheelSensors(Instrument):
    """Mean speeds of the four wheels since the last measurement, and the torques now."""

    SPEED_NOISE_RADPS: Final = 0.03
    EFFORT_NOISE_NM: Final = 0.05

    def __init__(
        self,
        rate_hz: float,
        fault: FaultLookup,
        random: np.random.Generator,
        data: mujoco.MjData,
    ) -> None:
        super().__init__(rate_hz, fault)
        self._draws = draws(random, 8)
        self._angles, self._efforts = data.qpos[_WHEELS], data.actuator_force[:4]
        self._before = self._angles.tolist()

    def measure(self, stamp_s: float) -> Joints | None:
        """Return what is measured."""
        row, since_s = next(self._draws), self._since_s
        before, now = self._before, self._angles.tolist()
        self._before = now
        if self._fault(faults.JointsDead) is not None:
            return None
        speeds = [(a - b) / since_s for a, b in zip(now, before, strict=True)]
        scale, dead = self._fault(faults.EncoderScale), self._fault(faults.EncoderDead)
        if scale is not None and scale.shared:
            speeds = [each * scale.factor for each in speeds]
        if dead is not None and dead.shared:
            counts = (not dead.side.left, not dead.side.right)
            speeds = [each * counts[at % 2] for at, each in enumerate(speeds)]
        speeds = [s + self.SPEED_NOISE_RADPS * n for s, n in zip(speeds, row[:4], strict=True)]
        efforts = [
            effort + self.EFFORT_NOISE_NM * drawn
            for effort, drawn in zip(self._efforts.tolist(), row[4:], strict=True)
        ]
        return Joints(
            stamp_s,
            (speeds[0], speeds[2]),
            (speeds[1], speeds[3]),
            (efforts[0], efforts[2]),
            (efforts[1], efforts[3]),
        )
