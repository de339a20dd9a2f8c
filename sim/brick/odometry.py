"""Pose estimate of the brick: dead reckoning by the counts of two wheels, one degree each."""

from collections import deque
from dataclasses import replace
from math import cos, radians, sin
from typing import Final

from executive.values.geometry import Pose, Velocity, wrap_rad

WINDOW: Final = 5
"""Window of the speed measurement in periods; without a count in it the rover is stationary."""

Rims = tuple[float, float]
"""Figures of the left and of the right wheel's rim."""


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
