"""`HeadController`: the simulated pan/tilt head of a camera, with a limited speed."""

from typing import Final

from sim.checkpoint import Checkpointed, changing

MAX_PAN_RAD: Final = 2.9
MIN_TILT_RAD: Final = -1.2
MAX_TILT_RAD: Final = 1.2
MAX_SPEED_RADPS: Final = 2.0


class HeadController(Checkpointed):
    """Set points of the two servos.

    Attributes:
        target_rad: target pan and tilt.
    """

    CHANGES = changing(_speed_radps=float, target_rad=tuple[float, float], _now=tuple[float, float])

    def __init__(self) -> None:
        self._speed_radps = 0.5
        self.target_rad = (0.0, 0.0)
        self._now = (0.0, 0.0)

    def set_now(self, pan_rad: float, tilt_rad: float) -> None:
        """Set the present angles of the servos."""
        self._now = pan_rad, tilt_rad

    def point(self, pan_rad: float, tilt_rad: float) -> None:
        """Set new target angles, limited to the range of the head."""
        self.target_rad = (
            max(-MAX_PAN_RAD, min(MAX_PAN_RAD, pan_rad)),
            max(MIN_TILT_RAD, min(MAX_TILT_RAD, tilt_rad)),
        )

    def set_speed(self, speed_radps: float) -> None:
        """Set a new maximum speed, limited to that of the head."""
        self._speed_radps = max(0.0, min(MAX_SPEED_RADPS, speed_radps))

    def setpoints_rad(self, period_s: float) -> tuple[float, float]:
        """Return pan and tilt for the next period."""
        if self._now != self.target_rad:
            step = self._speed_radps * period_s
            (pan, tilt), (to_pan, to_tilt) = self._now, self.target_rad
            self._now = (
                max(pan - step, min(pan + step, to_pan)),
                max(tilt - step, min(tilt + step, to_tilt)),
            )
        return self._now
