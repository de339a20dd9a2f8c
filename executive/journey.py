"""What becomes of a motion or a plan, beside what was predicted of it."""

from executive.clock import Clock
from executive.reasons import Figure
from executive.state import Status


class Journey:
    """One motion or plan: what it took so far, and what it was predicted to take.

    Attributes:
        predicted: figures of the prediction; none until it is worked out, or where there is none.
    """

    def __init__(self, clock: Clock, status: Status) -> None:
        self._clock = clock
        self._status = status
        self._began_s: float | None = None
        self._from_m = 0.0
        self.predicted: tuple[Figure, ...] = ()

    def begin(self) -> None:
        """Begin to count."""
        self._began_s = self._clock.now_s()
        self._from_m = self._status.travelled_m

    def figures(self) -> tuple[Figure, ...]:
        """Return what it took until now, and then what was predicted; nothing before it began."""
        if self._began_s is None:
            return ()
        pose = self._status.pose
        return (
            Figure("duration", self._clock.now_s() - self._began_s, "s"),
            Figure("length", self._status.travelled_m - self._from_m, "m"),
            Figure("x", pose.x_m, "m"),
            Figure("y", pose.y_m, "m"),
            Figure("heading", pose.heading_rad, "rad"),
            *self.predicted,
        )
