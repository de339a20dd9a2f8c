"""Whether a second odometry agrees with a whole motion, by a frame taken after it, standing."""

from dataclasses import dataclass
from math import inf
from typing import Final

from executive.settings import Settings
from executive.state import FramePair, Status, disagreement
from executive.values.reasons import Figure, Reason, Refusal

WAIT_S: Final = 6.0
"""For a frame that was taken standing: longer than frames usually fail to come."""
OLDEST_S: Final = 10.0
"""A frame before the motion that is older says nothing of where it began."""
FUSED_NEAR_M: Final = 0.06
"""How near a place is near enough where the pose is corrected: the wheels cannot tell better."""
TURN_NEAR_M: Final = 0.13
"""How far a turn on the spot may move base_link, which goes around the control point."""
APART_M: Final = 0.07
APART_PER_M: Final = 0.02
APART_RAD: Final = 0.08


@dataclass(frozen=True, slots=True)
class Verified:
    """The odometries agree; the figures say how well."""

    figures: tuple[Figure, ...]


class MotionVerification:
    """Compares one motion, from the newest frame before it to one taken after it, standing."""

    def __init__(self, status: Status) -> None:
        self._status = status
        self._first = self._newest()
        self._slid_s = -inf

    @classmethod
    def begin(cls, settings: Settings, status: Status) -> "MotionVerification | None":
        """Return the verification of a motion that begins now; None without second odometry."""
        return None if settings.sensors.second_odometry is None else cls(status)

    def ready(self, waited_s: float) -> bool:
        """Return whether the motion may begin: a frame from before it is there, or fails to come.

        Args:
            waited_s: since the rover was ready to begin.
        """
        self._first = self._first or self._newest()
        return self._first is not None or waited_s >= WAIT_S

    def on_slide(self) -> None:
        """Take no frame of before now: the rover slides after the motion, with standing wheels."""
        if self._status.odometry is not None:
            self._slid_s = self._status.odometry.stamp_s

    def outcome(self, waited_s: float) -> Verified | Refusal | None:
        """Return what comes of it, or None while a frame is waited for.

        Args:
            waited_s: since the motion ended.
        """
        fusion, last, odometry = self._status.fusion, self._newest(), self._status.odometry
        if fusion is None or odometry is None or last is None or last.stamp_s < self._standing_s:
            return None if waited_s < WAIT_S else _unverified("was taken after it", waited_s)
        if not fusion.settled:
            return None
        if self._first is None:
            return _unverified("is known of the time before it", 0.0)
        apart = disagreement(self._first, last)
        bound_m = APART_M + APART_PER_M * apart.way_m
        figures = (
            Figure("odometries apart", apart.off_m, "m"),
            Figure("bound", bound_m, "m"),
            Figure("headings apart", apart.off_rad, "rad"),
            Figure("heading bound", APART_RAD, "rad"),
        )
        if apart.off_m <= bound_m and apart.off_rad <= APART_RAD:
            age_s = odometry.stamp_s - last.stamp_s
            return Verified((figures[0], figures[2], Figure("seen before", age_s, "s")))
        fusion.unconfirmed_since = self._first
        text = (
            f"the second odometry does not agree with the motion: {apart.off_m:.2f} m and"
            f" {apart.off_rad:.2f} rad apart"
        )
        return Refusal(Reason.NOT_CONFIRMED, text, figures)

    @property
    def _standing_s(self) -> float:
        return max(self._slid_s, self._status.standstill.undisturbed_since_s)

    def _newest(self) -> FramePair | None:
        fusion, odometry = self._status.fusion, self._status.odometry
        if fusion is None or fusion.latest is None or odometry is None:
            return None
        recent = fusion.latest.stamp_s >= odometry.stamp_s - OLDEST_S
        return fusion.latest if recent else None


def _unverified(what: str, waited_s: float) -> Refusal:
    text = f"where the rover is is not verified: no frame of the second odometry {what}"
    return Refusal(Reason.UNVERIFIED, text, (Figure("waited", waited_s, "s"),))
