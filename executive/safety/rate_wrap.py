"""`RateWrap` corrects yaw rates of drivers that do not wrap heading differences at ±180°."""

from collections import deque
from dataclasses import replace
from math import copysign, pi
from typing import Final

from executive.values.facts import Odometry
from executive.values.geometry import Velocity, wrap_rad

MESSAGES: Final = 20
"""Number of messages after the wrap that may have such a rate, if it is a mean of as many steps."""
TOLERANCE_RATIO: Final = 0.12
"""Tolerance of a whole turn over the time of these steps; chosen, not measured."""
MIN_RADPS: Final = 3.0
"""Minimum error: no rover turns by that much faster than its pose."""


class RateWrap:
    """Corrects yaw rates that contain a whole turn by their driver's error."""

    def __init__(self) -> None:
        self._steps: deque[tuple[float, float]] = deque(maxlen=MESSAGES)
        self._left, self._whole_rad = 0, 0.0

    def corrected(self, before: Odometry, after: Odometry, step_s: float) -> Odometry:
        """Return a message with the rate of its pose, if its own is off by a whole turn.

        Args:
            before: the message before it; only its pose is used.
            after: the message.
            step_s: time between their stamps.
        """
        if step_s <= 0.0:
            return after
        stepped_rad = after.pose.heading_rad - before.pose.heading_rad
        self._steps.appendleft((step_s, wrap_rad(stepped_rad)))
        if abs(stepped_rad) > pi:
            self._left, self._whole_rad = MESSAGES, copysign(2 * pi, stepped_rad)
        if self._left <= 0:
            return after
        self._left -= 1
        span_s = turned_rad = 0.0
        for each_s, each_rad in self._steps:
            span_s, turned_rad = span_s + each_s, turned_rad + each_rad
            off_radps = after.velocity.rotate_radps - turned_rad / span_s
            whole_radps = self._whole_rad / span_s
            is_whole = abs(off_radps - whole_radps) <= TOLERANCE_RATIO * abs(whole_radps)
            if is_whole and abs(off_radps) > MIN_RADPS:
                velocity = Velocity(after.velocity.travel_mps, turned_rad / span_s)
                return replace(after, velocity=velocity)
        return after
