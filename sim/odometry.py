"""Odometry as a Jackal computes it: encoder speed and gyro rate, integrated at 50 Hz."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import copysign, cos, sin, sqrt

import numpy as np

from executive.facts import Odometry
from executive.geometry import Pose, Velocity, wrap_rad


@dataclass(frozen=True, slots=True)
class OdometrySettings:
    """How good the sensors are, and whether side slip is allowed for.

    Attributes:
        slip_offset_m: c0 of the side-slip law v_y = -(c0 + c1 sign(v) sqrt|v w|) w.
        slip_gain: c1 of the law, in m / sqrt(m/s rad/s); both 0 switch the correction off.
        encoder_noise_mps: standard deviation of one encoder speed.
        encoder_scale: standard deviation of the error of the wheel radius, as a ratio.
        gyro_noise_radps: standard deviation of one gyro rate.
        gyro_scale: standard deviation of the error of the gyro's gain, as a ratio.
        gyro_bias_radps: standard deviation of the constant error of the gyro.
        lean_noise_rad: standard deviation of one roll or pitch.
    """

    slip_offset_m: float = 0.044
    slip_gain: float = 0.065
    encoder_noise_mps: float = 0.005
    encoder_scale: float = 0.0007
    gyro_noise_radps: float = 0.002
    gyro_scale: float = 0.0004
    gyro_bias_radps: float = 0.00015
    lean_noise_rad: float = 0.001


def _draws(random: np.random.Generator) -> Iterator[list[float]]:
    """Yield rows of four standard normal numbers, drawn in blocks because that is fast."""
    while True:
        yield from random.standard_normal((512, 4)).tolist()


class WheelOdometry:
    """Dead reckoning from a start pose, with the errors of real sensors."""

    def __init__(
        self, settings: OdometrySettings, start: Pose, random: np.random.Generator
    ) -> None:
        """Start at a pose; the constant errors of this set of sensors are drawn here."""
        self._settings = settings
        scale, gain, bias = random.standard_normal(3).tolist()
        self._scale = 1 + settings.encoder_scale * scale
        self._gain = 1 + settings.gyro_scale * gain
        self._bias_radps = settings.gyro_bias_radps * bias
        self._draws = _draws(random)
        self.pose = start

    def advance(
        self, stamp_s: float, period_s: float, encoder_mps: float, gyro_radps: float, lean: Pose
    ) -> Odometry:
        """Integrate one period and return what is published for its end.

        Args:
            stamp_s: time of measurement.
            period_s: time since the last call.
            encoder_mps: mean rim speed of the wheels over the period.
            gyro_radps: mean rate of heading over the period.
            lean: pose of which roll and pitch are measured.
        """
        settings = self._settings
        first, second, third, fourth = next(self._draws)
        travel_mps = encoder_mps * self._scale + settings.encoder_noise_mps * first
        rotate_radps = (
            gyro_radps * self._gain + self._bias_radps + settings.gyro_noise_radps * second
        )
        roll_rad = lean.roll_rad + settings.lean_noise_rad * third
        pitch_rad = lean.pitch_rad + settings.lean_noise_rad * fourth
        slip_m = settings.slip_offset_m + settings.slip_gain * copysign(
            sqrt(abs(encoder_mps * gyro_radps)), encoder_mps
        )
        ahead_m = travel_mps * cos(pitch_rad) * period_s
        left_m = -slip_m * rotate_radps * period_s
        before = self.pose
        midway_rad = before.heading_rad + rotate_radps * period_s / 2
        self.pose = Pose(
            before.x_m + ahead_m * cos(midway_rad) - left_m * sin(midway_rad),
            before.y_m + ahead_m * sin(midway_rad) + left_m * cos(midway_rad),
            before.z_m - travel_mps * sin(pitch_rad) * period_s,
            wrap_rad(before.heading_rad + rotate_radps * period_s),
            roll_rad,
            pitch_rad,
        )
        return Odometry(stamp_s, self.pose, Velocity(travel_mps, rotate_radps))
