"""Speed along one dimension, from rest to rest, within a speed and an acceleration."""

from dataclasses import dataclass
from math import copysign, sqrt
from typing import Protocol, assert_never

from executive.settings import Profile


@dataclass(frozen=True, slots=True)
class Bounds:
    """Greatest speed and acceleration, in units of the dimension (m or rad) and seconds."""

    speed: float
    acceleration: float


class SpeedProfile(Protocol):
    """A law of speed."""

    def speed(self, left: float, elapsed_s: float) -> float:
        """Return the speed to command.

        Args:
            left: signed way left when the command takes effect, in m or rad.
            elapsed_s: seconds since the motion began.
        """
        ...


def duration_s(way: float, bounds: Bounds) -> float:
    """Return the shortest time from rest to rest over a way (bang-bang or trapezoid)."""
    way = abs(way)
    if way <= bounds.speed**2 / bounds.acceleration:
        return 2.0 * sqrt(way / bounds.acceleration)
    return way / bounds.speed + bounds.speed / bounds.acceleration


@dataclass(frozen=True, slots=True)
class SquareRoot:
    """The fastest speed from which braking step by step, tick after tick, ends at the target.

    Attributes:
        gain_per_s: greatest speed per way left, so that the end is reached without hunting.
    """

    bounds: Bounds
    tick_s: float
    gain_per_s: float = 10.0

    def speed(self, left: float, elapsed_s: float) -> float:
        """Return the speed to command, whatever time has passed."""
        step = self.bounds.acceleration * self.tick_s / 2.0
        fastest = sqrt(step**2 + 2.0 * self.bounds.acceleration * abs(left)) - step
        return copysign(min(fastest, self.bounds.speed, self.gain_per_s * abs(left)), left)


@dataclass(frozen=True, slots=True)
class Trapezoid:
    """A schedule of place over time, followed with proportional feedback.

    Attributes:
        way: signed way of the whole motion.
        gain_per_s: speed per unit behind the schedule.
    """

    bounds: Bounds
    way: float
    gain_per_s: float = 2.0

    def speed(self, left: float, elapsed_s: float) -> float:
        """Return the scheduled speed, corrected by how far behind the schedule the rover is.

        One that is ahead of it waits; it turns round only beyond the target.
        """
        left_scheduled, speed = self._schedule(elapsed_s)
        behind = left - copysign(left_scheduled, self.way)
        wanted = copysign(speed, self.way) + self.gain_per_s * behind
        if wanted * left < 0.0:
            return 0.0
        return max(-self.bounds.speed, min(self.bounds.speed, wanted))

    def _schedule(self, elapsed_s: float) -> tuple[float, float]:
        way, acceleration = abs(self.way), self.bounds.acceleration
        total_s = duration_s(way, self.bounds)
        peak = min(self.bounds.speed, sqrt(way * acceleration))
        ramp_s = peak / acceleration
        if elapsed_s < ramp_s:
            return way - acceleration * elapsed_s**2 / 2.0, acceleration * elapsed_s
        if elapsed_s < total_s - ramp_s:
            return way - peak * (elapsed_s - ramp_s / 2.0), peak
        left_s = max(total_s - elapsed_s, 0.0)
        return acceleration * left_s**2 / 2.0, acceleration * left_s


def make_profile(kind: Profile, bounds: Bounds, way: float, tick_s: float) -> SpeedProfile:
    """Return the profile that the settings name, for a signed way."""
    match kind:
        case Profile.TRAPEZOID:
            return Trapezoid(bounds, way)
        case Profile.SQUARE_ROOT:
            return SquareRoot(bounds, tick_s)
        case _:
            assert_never(kind)
