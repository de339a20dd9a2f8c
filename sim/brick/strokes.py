"""What the brick's motors do at a stretch: a line, a turn on the spot, or a velocity held."""

from dataclasses import dataclass
from math import copysign, sqrt
from typing import Protocol

from sim.brick.odometry import Rims
from sim.brick.settings import BrickSettings

_SYNC_PER_S = 4.0
"""How hard the wheel that is ahead of the other is held back."""
_SYNC_MOST = 0.3


class Stroke(Protocol):
    """From standing to standing."""

    def rims_mps(self, rims_m: Rims, period_s: float) -> Rims | None:
        """Return the speeds of the rims for the next period; None at the end.

        Args:
            rims_m: how far the rims have rolled since the start of the stroke.
            period_s: how long the speeds hold.
        """
        ...


@dataclass(slots=True)
class Roll:
    """Both wheels as far, ahead or against each other, at a trapezoid of speed.

    Attributes:
        left, right: +1.0 or -1.0, which way each turns.
        length_m: how far.
        speed_mps: at most how fast.
    """

    left: float
    right: float
    length_m: float
    speed_mps: float
    settings: BrickSettings
    _now_mps: float = 0.0

    def rims_mps(self, rims_m: Rims, period_s: float) -> Rims | None:
        """Return the speeds; a wheel that is ahead of the other is held back."""
        left_m, right_m = self.left * rims_m[0], self.right * rims_m[1]
        rest_m = self.length_m - (left_m + right_m) / 2
        if rest_m <= self._now_mps * period_s / 2:
            return None
        faster_mps = self._now_mps + self.settings.rim_mps2 * period_s
        braking_mps = max(self.settings.creep_mps, sqrt(2 * self.settings.rim_mps2 * rest_m))
        self._now_mps = min(self.speed_mps, faster_mps, braking_mps)
        most_mps = _SYNC_MOST * self._now_mps
        sync_mps = max(-most_mps, min(most_mps, _SYNC_PER_S * (left_m - right_m)))
        return self.left * (self._now_mps - sync_mps), self.right * (self._now_mps + sync_mps)


@dataclass(slots=True)
class Holding:
    """A velocity held for a time, ramps included."""

    left_mps: float
    right_mps: float
    duration_s: float
    settings: BrickSettings
    _now: Rims = (0.0, 0.0)
    _elapsed_s: float = 0.0

    def rims_mps(self, _: Rims, period_s: float) -> Rims | None:
        """Return the speeds."""
        fastest_mps = max(abs(self._now[0]), abs(self._now[1]))
        rest_s = self.duration_s - self._elapsed_s
        braking = rest_s <= fastest_mps / self.settings.rim_mps2
        if rest_s <= 0.0 or (braking and fastest_mps == 0.0):
            return None
        self._elapsed_s += period_s
        step_mps = self.settings.rim_mps2 * period_s
        to = (0.0, 0.0) if braking else (self.left_mps, self.right_mps)
        self._now = (_toward(self._now[0], to[0], step_mps), _toward(self._now[1], to[1], step_mps))
        return self._now


def line(distance_m: float, speed_mps: float, settings: BrickSettings) -> Roll:
    """Return a straight line; a negative distance leads backward."""
    sign = copysign(1.0, distance_m)
    return Roll(sign, sign, abs(distance_m), speed_mps, settings)


def turn(angle_rad: float, speed_radps: float, track_m: float, settings: BrickSettings) -> Roll:
    """Return a turn on the spot, counter-clockwise positive."""
    sign = copysign(1.0, angle_rad)
    return Roll(-sign, sign, abs(angle_rad) * track_m / 2, speed_radps * track_m / 2, settings)


def _toward(now: float, to: float, step: float) -> float:
    return max(now - step, min(now + step, to))
