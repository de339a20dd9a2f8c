"""`CurvesLaw` drives arcs one after the other, to turn a base that cannot turn on the spot."""

from collections.abc import Callable, Sequence

from executive.commands import Curve
from executive.motion.locomotion import Motion
from executive.values.ports import MotionIntent


class CurvesLaw(Motion):
    """Drives arcs, each from the standstill at the end of the one before.

    Args:
        begin: begins an arc, at the present heading.
    """

    def __init__(self, curves: Sequence[Curve], begin: Callable[[Curve], Motion]) -> None:
        self._left = list(curves)
        self._begin = begin
        self.expected_s = sum(begin(each).expected_s for each in curves)
        self._arc = begin(self._left.pop(0))

    @property
    def done(self) -> bool:
        """Whether the rover is stationary at the end of the last arc."""
        return not self._left and self._arc.done

    @property
    def remaining_text(self) -> str:
        """The remaining part, for display."""
        return f"{self._arc.remaining_text} of this arc, {len(self._left)} arcs follow"

    def update_limits(self, now_s: float) -> bool:
        """Plan the present arc again if the speed limit changed; return whether it did."""
        return self._arc.update_limits(now_s)

    def intent(self, now_s: float) -> MotionIntent:
        """Return the intent of this tick."""
        if self._left and self._arc.done:
            self._arc = self._begin(self._left.pop(0))
        return self._arc.intent(now_s)
