"""`MotionVerification` compares a whole motion with a second odometry, at standstill after it.

Wheel odometry does not see sliding: on 10° slopes drives were up to 0.40 m off while pose, twist
and wheels agreed.
"""

from dataclasses import dataclass
from math import inf
from typing import Final

from executive.settings import Settings
from executive.state import FramePair, Status, disagreement
from executive.values.quantities import angle_text
from executive.values.reasons import Figure, Reason, Refusal

WAIT_S: Final = 6.0
"""Timeout of a frame taken at standstill: longer than usual gaps between frames."""
MAX_FRAME_AGE_S: Final = 10.0
"""Maximum age of the frame before a motion, so that it confirms the start position."""
FUSED_TOLERANCE_M: Final = 0.06
"""Position tolerance while the pose is corrected: wheel odometry is no more accurate."""
TURN_TOLERANCE_M: Final = 0.13
"""Maximum displacement of base_link by a turn on the spot, about the control point."""
ODOMETRY_TOLERANCE_M: Final = 0.07
ODOMETRY_TOLERANCE_PER_M: Final = 0.02
ODOMETRY_TOLERANCE_RAD: Final = 0.08


@dataclass(frozen=True, slots=True)
class Verified:
    """The odometries agree; the figures give the deviation."""

    figures: tuple[Figure, ...]


class MotionVerification:
    """Compares one motion, from the last frame before it to one taken at standstill after it."""

    def __init__(self, status: Status) -> None:
        self._status = status
        self._first = self._newest()
        self._slid_s = -inf

    @classmethod
    def begin(cls, settings: Settings, status: Status) -> "MotionVerification | None":
        """Return the verification of a motion that begins now; None without second odometry."""
        return None if settings.sensors.second_odometry is None else cls(status)

    def ready(self, waited_s: float) -> bool:
        """Return whether the motion may begin: a frame before it was received or timed out.

        Args:
            waited_s: time since the rover was ready to begin.
        """
        self._first = self._first or self._newest()
        return self._first is not None or waited_s >= WAIT_S

    def on_slide(self) -> None:
        """Discard frames up to now: the rover slides after the motion, with stationary wheels."""
        if self._status.odometry is not None:
            self._slid_s = self._status.odometry.stamp_s

    def result(self, waited_s: float) -> Verified | Refusal | None:
        """Return the result, or None while waiting for a frame.

        Args:
            waited_s: time since the motion ended.
        """
        fusion, last, odometry = self._status.fusion, self._newest(), self._status.odometry
        if fusion is None or odometry is None or last is None or last.stamp_s < self._standing_s:
            return None if waited_s < WAIT_S else _unverified("after the motion", waited_s)
        if not fusion.correction_applied:
            return None
        if self._first is None:
            return _unverified("before the motion", 0.0)
        apart = disagreement(self._first, last)
        bound_m = ODOMETRY_TOLERANCE_M + ODOMETRY_TOLERANCE_PER_M * apart.distance_m
        figures = (
            Figure("odometries apart", apart.off_m, "m"),
            Figure("bound", bound_m, "m"),
            Figure("headings apart", apart.off_rad, "rad"),
            Figure("heading bound", ODOMETRY_TOLERANCE_RAD, "rad"),
        )
        if apart.off_m <= bound_m and apart.off_rad <= ODOMETRY_TOLERANCE_RAD:
            age_s = odometry.stamp_s - last.stamp_s
            return Verified((figures[0], figures[2], Figure("seen before", age_s, "s")))
        fusion.unconfirmed_since = self._first
        text = (
            f"the second odometry disagrees with the motion by {apart.off_m:.2f} m and"
            f" {angle_text(apart.off_rad)}"
        )
        return Refusal(Reason.NOT_CONFIRMED, text, figures)

    @property
    def _standing_s(self) -> float:
        return max(self._slid_s, self._status.standstill.undisturbed_since_s)

    def _newest(self) -> FramePair | None:
        fusion, odometry = self._status.fusion, self._status.odometry
        if fusion is None or fusion.latest is None or odometry is None:
            return None
        recent = fusion.latest.stamp_s >= odometry.stamp_s - MAX_FRAME_AGE_S
        return fusion.latest if recent else None


def _unverified(what: str, waited_s: float) -> Refusal:
    text = f"pose not verified: no second-odometry frame {what}"
    return Refusal(Reason.UNVERIFIED, text, (Figure("waited", waited_s, "s"),))
