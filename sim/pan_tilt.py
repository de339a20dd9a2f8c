"""The pan/tilt head of a camera: turns to where it is told at no more than a given speed."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class HeadLimits:
    """How far and how fast the head turns."""

    pan_rad: float = 2.9
    tilt_low_rad: float = -1.2
    tilt_high_rad: float = 1.2
    speed_radps: float = 2.0


class HeadController:
    """Set points of the two servos."""

    def __init__(self, limits: HeadLimits, speed_radps: float = 0.5) -> None:
        self._limits = limits
        self._speed_radps = speed_radps
        self._target = (0.0, 0.0)
        self._now = (0.0, 0.0)

    @property
    def target_rad(self) -> tuple[float, float]:
        """Pan and tilt to which it turns."""
        return self._target

    def point(self, pan_rad: float, tilt_rad: float) -> None:
        """Take new angles, cut to what the head can reach."""
        limits = self._limits
        self._target = (
            max(-limits.pan_rad, min(limits.pan_rad, pan_rad)),
            max(limits.tilt_low_rad, min(limits.tilt_high_rad, tilt_rad)),
        )

    def set_speed(self, speed_radps: float) -> None:
        """Take a new greatest speed, cut to what the head can do."""
        self._speed_radps = max(0.0, min(self._limits.speed_radps, speed_radps))

    def setpoints_rad(self, period_s: float) -> tuple[float, float]:
        """Return pan and tilt for the next period."""
        if self._now != self._target:
            step = self._speed_radps * period_s
            (pan, tilt), (to_pan, to_tilt) = self._now, self._target
            self._now = (
                max(pan - step, min(pan + step, to_pan)),
                max(tilt - step, min(tilt + step, to_tilt)),
            )
        return self._now
