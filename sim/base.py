"""The Jackal's own motor controller: timeout, limits, and wheel speeds from a velocity."""

from dataclasses import dataclass
from typing import Final

from executive.geometry import STANDING, Velocity

TRACK_M: Final = 0.37559
WHEEL_RADIUS_M: Final = 0.098
TRACK_MULTIPLIER: Final = 1.5
"""Skid steering turns less than its track says; Clearpath commands this much more."""


@dataclass(frozen=True, slots=True)
class BaseLimits:
    """Limits that the base keeps by itself (control.yaml of the Jackal)."""

    travel_mps: float = 2.0
    travel_mps2: float = 20.0
    rotate_radps: float = 4.0
    rotate_radps2: float = 25.0
    timeout_s: float = 0.25


def _approach(now: float, target: float, bound: float, step: float) -> float:
    target = max(-bound, min(bound, target))
    return max(now - step, min(now + step, target))


class BaseController:
    """Turns the newest velocity command into wheel speeds, at 50 Hz."""

    def __init__(self, limits: BaseLimits) -> None:
        """Start at rest, without a command."""
        self._limits = limits
        self._command = STANDING
        self._commanded_s = float("-inf")
        self._travel_mps = 0.0
        self._rotate_radps = 0.0

    def command(self, velocity: Velocity, now_s: float) -> None:
        """Take a velocity command; it holds until the next one or the timeout."""
        self._command = velocity
        self._commanded_s = now_s

    def wheels_radps(self, now_s: float, period_s: float) -> tuple[float, float]:
        """Return the speeds of left and right wheels for the next period."""
        limits = self._limits
        live = now_s - self._commanded_s <= limits.timeout_s
        wanted = self._command if live else STANDING
        self._travel_mps = _approach(
            self._travel_mps, wanted.travel_mps, limits.travel_mps, limits.travel_mps2 * period_s
        )
        self._rotate_radps = _approach(
            self._rotate_radps,
            wanted.rotate_radps,
            limits.rotate_radps,
            limits.rotate_radps2 * period_s,
        )
        across_mps = self._rotate_radps * TRACK_MULTIPLIER * TRACK_M / 2
        return (
            (self._travel_mps - across_mps) / WHEEL_RADIUS_M,
            (self._travel_mps + across_mps) / WHEEL_RADIUS_M,
        )
