"""`Uncertainty`: bounds of the pose's error, after a fault has shown that the pose may be wrong.

Zero until then: ordinary drift of dead reckoning is within the tolerances of motions and of the
verification by the second odometry. Only `executive.safety.pose_uncertainty` lowers it.
"""

from dataclasses import dataclass
from math import degrees
from typing import Final

from executive.values.reasons import Figure, Identity

PROMISED_M: Final = 0.15
PROMISED_RATIO: Final = 0.05
PROMISED_RAD: Final = 0.1
"""Guaranteed accuracy of an absolute motion: 15 cm and 5 % of the distance; its heading."""
MIN_M, MIN_RAD = 0.01, 0.005
"""Minimum uncertainty; a smaller one is zero, since sources differ by their noise."""
DRIFT_PER_M: Final = 0.02
"""Growth of an uncertainty above zero, per distance driven by dead reckoning."""

RECOVERY: Final = (
    "correct the pose by rover command setPositionCompensation X Y Z HEADING,"
    " or, once checked, confirm it by rover command confirmPose 0 0"
)
"""Commands of an operator that end an uncertainty, as typed."""


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """Bounds of the error of the pose of base_link.

    Attributes:
        position_m: distance from the position, in the plane.
        heading_rad: angle from the heading.
        cause: the fault or other event that showed a wrong pose; empty without one.
        confirmed_by: the command of an operator that is the cause.
    """

    position_m: float = 0.0
    heading_rad: float = 0.0
    cause: str = ""
    confirmed_by: Identity | None = None

    def __bool__(self) -> bool:
        """Whether the bounds are above `MIN_M` or `MIN_RAD`."""
        return self.position_m >= MIN_M or self.heading_rad >= MIN_RAD

    def __str__(self) -> str:
        return f"{self.position_m:.2f} m and {degrees(self.heading_rad):.1f} deg"

    @property
    def figures(self) -> tuple[Figure, Figure]:
        """Both bounds, for a report."""
        return (
            Figure("position uncertainty", self.position_m, "m"),
            Figure("heading uncertainty", self.heading_rad, "rad"),
        )

    def position_at_m(self, distance_m: float) -> float:
        """Return the uncertainty of the position after a distance driven by dead reckoning."""
        return self.position_m + (DRIFT_PER_M + self.heading_rad) * distance_m
