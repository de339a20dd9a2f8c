"""`MotionStatistics`: duration, length and energy of a motion or plan, measured and predicted."""

from executive.state.status import Status
from executive.values.clock import Clock
from executive.values.reasons import Figure


class MotionStatistics:
    """The measured and predicted figures of one motion or plan.

    Attributes:
        predicted: figures of the prediction; empty until it is computed, or without one.

    Args:
        capacity_j: of the battery; None if unknown.
    """

    def __init__(self, clock: Clock, status: Status, capacity_j: float | None = None) -> None:
        self._clock = clock
        self._status = status
        self._began_s: float | None = None
        self._from_m = 0.0
        self._capacity_j = capacity_j
        self._charge_ratio: float | None = None
        self.predicted: tuple[Figure, ...] = ()

    def begin(self) -> None:
        """Start the measurement."""
        self._began_s = self._clock.now_s()
        self._from_m = self._status.travelled_m
        self._charge_ratio = self._charge

    def figures(self) -> tuple[Figure, ...]:
        """Return the figures up to now, then the predicted ones; empty before the start."""
        if self._began_s is None:
            return ()
        pose, energy_j = self._status.pose, self._energy_j()
        return (
            Figure("duration", self._clock.now_s() - self._began_s, "s"),
            Figure("length", self._status.travelled_m - self._from_m, "m"),
            Figure("x", pose.x_m, "m"),
            Figure("y", pose.y_m, "m"),
            Figure("heading", pose.heading_rad, "rad"),
            *(() if energy_j is None else (Figure("energy", energy_j, "J"),)),
            *self.predicted,
        )

    @property
    def _charge(self) -> float | None:
        battery = self._status.battery
        return None if battery is None else battery.charge_ratio

    def _energy_j(self) -> float | None:
        """Return the energy from the battery; None if its resolution does not show any."""
        before, now = self._charge_ratio, self._charge
        if self._capacity_j is None or before is None or now is None or now >= before:
            return None
        return (before - now) * self._capacity_j
