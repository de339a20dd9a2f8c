"""`InertialUnit` and `WheelSensors`: IMU and wheel encoders of a simulated Jackal.

Each instrument measures the truth with errors of its own, from a random generator of its own, so
that no instrument changes another's measurements.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from copy import deepcopy
from math import asin, atan2
from operator import length_hint
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from executive.values.facts import Fact, Imu, Joints
from sim.checkpoint import Checkpointed, changing
from sim.rover import faults
from sim.rover.body import STEP_S, SimulatedBody
from sim.rover.faults import SimulatedFault

Vector = tuple[float, float, float]

_GRAVITY_MPS2: Final = 9.81
_MAX_RADPS: Final = 35.0
_MAX_MPS2: Final = 157.0
"""Saturation of gyros and accelerometers: 2000 degrees per second, 16 g."""
_WHEELS: Final = slice(7, 11)
"""Angles of front left and right, rear left and right, in the state of physics."""
_WHEEL_RATES: Final = slice(6, 10)
_SHAKEN_M: Final = 0.098 / 4
"""Mean speed of the ground below the wheels, per sum of their rates."""


class Instrument(Checkpointed, ABC):
    """A sensor that measures at a rate, limited to that of the steps of physics.

    Attributes:
        every: number of steps of physics per measurement.
        latency_s: time from the last measurement to its publication.
        MOMENTARY: the fault that acts at its begin only.
    """

    CHANGES = changing(latency_s=float, begun=bool)
    MOMENTARY: ClassVar[type[SimulatedFault]] = SimulatedFault

    def __init__(self, rover: SimulatedBody, rate_hz: float, random: np.random.Generator) -> None:
        self.every = max(1, round(1 / (rate_hz * STEP_S)))
        self.latency_s = 0.0
        self._since_s = self.every * STEP_S
        self._rover, self._random = rover, random
        self._fault = rover.fault
        self._known: SimulatedFault | None = None

    @abstractmethod
    def measure(self, stamp_s: float) -> Fact | None:
        """Return the present measurement; None if there is none."""

    def settle(self) -> None:
        """Begin at the present state of physics, with faults that began before."""
        self.begins()

    def begins(self) -> SimulatedFault | None:
        """Return the momentary fault if it began since the last call."""
        before, self._known = self._known, self._fault(self.MOMENTARY)
        return None if self._known is before else self._known

    @property
    def begun(self) -> bool:
        """Whether the momentary fault that is active began before the last measurement."""
        return self._known is not None and self._known is self._fault(self.MOMENTARY)

    @begun.setter
    def begun(self, begun: bool) -> None:
        self._known = self._fault(self.MOMENTARY) if begun else None


_BLOCK: Final = 512


class NormalRows(Checkpointed, Iterator[list[float]]):
    """Rows of normal numbers, drawn in blocks for speed."""

    CHANGES = changing(position=tuple[np.random.Generator, int])

    def __init__(
        self,
        random: np.random.Generator,
        width: int,
        mean: NDArray[np.float64] | float = 0.0,
        deviation: NDArray[np.float64] | float = 1.0,
    ) -> None:
        self._random, self._width = random, width
        self._mean, self._deviation = mean, deviation
        self._draw()

    def __next__(self) -> list[float]:
        for row in self._rows:
            return row
        self._draw()
        return next(self._rows)

    def _draw(self) -> None:
        self._before = deepcopy(self._random)
        block = self._random.standard_normal((_BLOCK, self._width))
        self._rows: Iterator[list[float]] = iter((self._mean + self._deviation * block).tolist())

    @property
    def position(self) -> tuple[np.random.Generator, int]:
        """The generator before the present block, and the number of rows taken of that."""
        return self._before, _BLOCK - length_hint(self._rows)

    @position.setter
    def position(self, position: tuple[np.random.Generator, int]) -> None:
        self._random, taken = position
        self._draw()
        for _ in range(taken):
            next(self._rows)


_ACCELERATION_BIAS_MPS2: Final = 0.05
_GYRO_BIAS_RADPS: Final = 0.003
_LEAN_BIAS_RAD: Final = 0.005
"""Standard deviations of the errors that are constant in a run."""
_ACCELERATION_NOISE_MPS2: Final = 0.03
_GYRO_NOISE_RADPS: Final = 0.004
_LEAN_NOISE_RAD: Final = 0.002
"""Standard deviations of one measurement."""
_VIBRATION_HZ: Final = 0.3
"""Acceleration noise by the wheels, in m/s2 per m/s of their speed."""


class InertialUnit(Instrument):
    """Mean rates and accelerations since the last measurement, with roll and pitch.

    It is read more often than all others, and therefore written without vectors.
    """

    CHANGES = changing(
        Instrument,
        _before=list[float],
        _before_mps=list[float],
        _shoves_mps2=list[float],
        _draws=Checkpointed,
    )
    MOMENTARY = faults.Pushed

    def __init__(self, rover: SimulatedBody, rate_hz: float, random: np.random.Generator) -> None:
        super().__init__(rover, rate_hz, random)
        data = rover.data
        bias = random.standard_normal(8)
        scale = [_ACCELERATION_BIAS_MPS2] * 3 + [_GYRO_BIAS_RADPS] * 3 + [_LEAN_BIAS_RAD] * 2
        self.set_errors((bias * scale).tolist())
        self._attitude, self._linear = data.qpos[3:7], data.qvel[:3]
        self._wheels = data.qvel[_WHEEL_RATES]
        self._before, self._before_mps = self._attitude.tolist(), self._linear.tolist()
        self._shoves_mps2: list[float] = []

    def settle(self) -> None:
        """Begin at the present attitude and velocity."""
        super().settle()
        self._before, self._before_mps = self._attitude.tolist(), self._linear.tolist()

    def set_errors(self, errors: Sequence[float]) -> None:
        """Set the errors that are constant: three of accelerometer and gyro, two of the lean."""
        self._bias_mps2 = list(errors[:3])
        constant = np.array([*errors[3:6], 0.0, 0.0, 0.0, *errors[6:]])
        deviation = [_GYRO_NOISE_RADPS] * 3 + [1.0] * 3 + [_LEAN_NOISE_RAD] * 2
        self._draws = NormalRows(self._random, 8, constant, np.array(deviation))

    def measure(self, stamp_s: float) -> Imu | None:
        """Return the measurement since the last call, in the axes of base_link."""
        noise = next(self._draws)
        before, before_mps = self._before, self._before_mps
        self._before = now = self._attitude.tolist()
        self._before_mps = now_mps = self._linear.tolist()
        if self._fault(faults.ImuDead) is not None:
            return None
        roll_radps, pitch_radps, yaw_radps = self._by_gyro(_rates(before, now, self._since_s))
        x_mps2, y_mps2, z_mps2 = _felt(before, now, before_mps, now_mps, self._since_s)
        y_mps2 += self._shoved_mps2()
        left, right, rear_left, rear_right = self._wheels.tolist()
        wheels_mps = _SHAKEN_M * (abs(left) + abs(right) + abs(rear_left) + abs(rear_right))
        bias_x, bias_y, bias_z = self._bias_mps2
        shaking_mps2 = _ACCELERATION_NOISE_MPS2 + _VIBRATION_HZ * wheels_mps
        w, x, y, z = now
        return Imu(
            stamp_s,
            atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)) + noise[6],
            asin(max(-1.0, min(1.0, 2 * (w * y - x * z)))) + noise[7],
            _cut(roll_radps + noise[0], _MAX_RADPS),
            _cut(pitch_radps + noise[1], _MAX_RADPS),
            _cut(yaw_radps + noise[2], _MAX_RADPS),
            _cut(x_mps2 + bias_x + shaking_mps2 * noise[3], _MAX_MPS2),
            _cut(y_mps2 + bias_y + shaking_mps2 * noise[4], _MAX_MPS2),
            _cut(z_mps2 + bias_z + shaking_mps2 * noise[5], _MAX_MPS2),
        )

    def _shoved_mps2(self) -> float:
        """Return the acceleration of a push, which begins in one measurement and ends in the next.

        Physics moves the rover at once, without a change of its velocity.
        """
        if isinstance(push := self.begins(), faults.Pushed):
            shove_mps2 = push.by_m / self._since_s**2
            self._shoves_mps2 = [-shove_mps2, shove_mps2]
        return self._shoves_mps2.pop() if self._shoves_mps2 else 0.0

    def _by_gyro(self, rates_radps: Vector) -> Vector:
        """Return the gyro's measurement of true rates, without its own errors."""
        dead = self._fault(faults.GyroDead)
        gain, bias = self._fault(faults.GyroGain), self._fault(faults.GyroBias)
        if dead is not None and dead.shared:
            return 0.0, 0.0, 0.0
        roll_radps, pitch_radps, yaw_radps = rates_radps
        if gain is not None and gain.shared:
            roll_radps, pitch_radps = gain.factor * roll_radps, gain.factor * pitch_radps
            yaw_radps *= gain.factor
        if bias is not None and bias.shared:
            yaw_radps += bias.rate_radps
        return roll_radps, pitch_radps, yaw_radps


def _rates(before: list[float], after: list[float], since_s: float) -> Vector:
    """Return the mean rates about the body's axes between two similar attitudes."""
    a, b, c, d = before
    w, x, y, z = after
    same = 2 / since_s if a * w + b * x + c * y + d * z >= 0 else -2 / since_s
    return (
        same * (a * x - b * w - c * z + d * y),
        same * (a * y + b * z - c * w - d * x),
        same * (a * z - b * y + c * x - d * w),
    )


def _felt(
    before: list[float],
    after: list[float],
    before_mps: list[float],
    after_mps: list[float],
    since_s: float,
) -> Vector:
    """Return the mean specific force in the body's axes, midway between two attitudes."""
    a, b, c, d = before
    w, x, y, z = after
    if a * w + b * x + c * y + d * z < 0:
        w, x, y, z = -w, -x, -y, -z
    w, x, y, z = a + w, b + x, c + y, d + z
    k = 2 / (w * w + x * x + y * y + z * z)
    u = (after_mps[0] - before_mps[0]) / since_s
    v = (after_mps[1] - before_mps[1]) / since_s
    r = (after_mps[2] - before_mps[2]) / since_s + _GRAVITY_MPS2
    return (
        u + k * (-(y * y + z * z) * u + (x * y + w * z) * v + (x * z - w * y) * r),
        v + k * ((x * y - w * z) * u - (x * x + z * z) * v + (y * z + w * x) * r),
        r + k * ((x * z + w * y) * u + (y * z - w * x) * v - (x * x + y * y) * r),
    )


def _cut(value: float, maximum: float) -> float:
    return value if -maximum <= value <= maximum else max(-maximum, min(maximum, value))


_SPEED_NOISE_RADPS: Final = 0.03
_EFFORT_NOISE_NM: Final = 0.05


class WheelSensors(Instrument):
    """Mean speeds of the four wheels since the last measurement, and the present torques."""

    CHANGES = changing(Instrument, _before=list[float], _draws=Checkpointed)

    def __init__(self, rover: SimulatedBody, rate_hz: float, random: np.random.Generator) -> None:
        super().__init__(rover, rate_hz, random)
        deviation = [_SPEED_NOISE_RADPS] * 4 + [_EFFORT_NOISE_NM] * 4
        self._draws = NormalRows(random, 8, deviation=np.array(deviation))
        self._angles, self._efforts = rover.data.qpos[_WHEELS], rover.data.actuator_force[:4]
        self._before = self._angles.tolist()

    def settle(self) -> None:
        """Begin at the present angles."""
        super().settle()
        self._before = self._angles.tolist()

    def measure(self, stamp_s: float) -> Joints | None:
        """Return the measurement."""
        noise, since_s = next(self._draws), self._since_s
        before, now = self._before, self._angles.tolist()
        self._before = now
        if self._fault(faults.JointsDead) is not None:
            return None
        speeds = [(a - b) / since_s for a, b in zip(now, before, strict=True)]
        left, right, rear_left, rear_right = self._rover.counted(speeds, shared=True)
        left_nm, right_nm, rear_left_nm, rear_right_nm = self._efforts.tolist()
        return Joints(
            stamp_s,
            (left + noise[0], rear_left + noise[2]),
            (right + noise[1], rear_right + noise[3]),
            (left_nm + noise[4], rear_left_nm + noise[6]),
            (right_nm + noise[5], rear_right_nm + noise[7]),
        )
