"""The heading by the gyro instead of the odometry: wheels of skid steering turn more than the body.

The path remains that of the odometry: its steps ahead and aside, along the heading of the gyro.
"""

from dataclasses import replace
from math import cos, inf, sin
from typing import Final

from executive.safety.channel import Channel
from executive.safety.sensor_history import FRESH_S, ImuHistory
from executive.values.facts import Odometry
from executive.values.geometry import Pose, step_between, wrap_rad

BY_GYRO: Final = frozenset({"quick_gyro", "slow_gyro"})
"""Windows of the comparison with the odometry's own turn if the heading is that of the gyro."""


class GyroHeading:
    """The pose with the heading of the gyro.

    While the gyro is silent, or after a gap of it, the odometry's own turn is used.

    Args:
        inertia: has the gyro, with its bias.

    Attributes:
        newest: the newest odometry with that heading; None before the first.
    """

    def __init__(self, inertia: ImuHistory) -> None:
        self._inertia = inertia
        self._own = Pose()
        self._channel: Channel | None = None
        self._time_s, self._total_rad = -inf, 0.0
        self.newest: Odometry | None = None

    def observe(self, fact: Odometry, time_s: float) -> None:
        """Add an odometry message measured at a time."""
        step_s = time_s - self._time_s
        gyro_rad = self._turn_rad(time_s, step_s)
        self.newest = fact if self.newest is None else self._next(fact, step_s, gyro_rad)
        self._own, self._time_s = fact.pose, time_s

    def _next(self, fact: Odometry, step_s: float, gyro_rad: float | None) -> Odometry:
        assert self.newest is not None
        last, velocity = self.newest.pose, fact.velocity
        ahead_m, left_m, turn_rad = step_between(self._own, fact.pose)
        if gyro_rad is not None:
            turn_rad = gyro_rad
            if step_s > 0.0:
                velocity = replace(velocity, rotate_radps=gyro_rad / step_s)
        along_rad = last.heading_rad + turn_rad / 2
        pose = replace(
            fact.pose,
            x_m=last.x_m + ahead_m * cos(along_rad) - left_m * sin(along_rad),
            y_m=last.y_m + ahead_m * sin(along_rad) + left_m * cos(along_rad),
            heading_rad=wrap_rad(last.heading_rad + turn_rad),
        )
        return replace(fact, pose=pose, velocity=velocity)

    def _turn_rad(self, time_s: float, step_s: float) -> float | None:
        """Return the turn by the gyro since the last message; None if it is unknown.

        Its last rate is extrapolated to the time of the odometry, and corrected with the next.
        """
        sums, before_rad = self._inertia.sums, self._total_rad
        if time_s < sums.first_s or time_s - sums.time_s > FRESH_S:
            self._channel = None
            return None
        known_s = min(time_s, sums.time_s)
        rate_radps = self._inertia.rate_radps
        self._total_rad = sums.sum_at(known_s, 0) + rate_radps * (time_s - known_s)
        continued, self._channel = self._channel is sums, sums
        turn_rad = self._total_rad - before_rad - self._inertia.bias_radps * step_s
        return turn_rad if continued else None
