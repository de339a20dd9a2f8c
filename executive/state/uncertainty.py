"""How far the rover may be from its pose, after something has shown that the pose may be wrong.

Zero until a fault shows otherwise: ordinary drift of the odometry is within the tolerances of
motions and of the second odometry's verification. It is lowered by
`executive.safety.pose_uncertainty` alone.
"""

from dataclasses import dataclass
from math import degrees
from typing import Final

from executive.values.reasons import Figure

PROMISED_M: Final = 0.15
PROMISED_RATIO: Final = 0.05
PROMISED_RAD: Final = 0.1
"""How near to its target an absolute motion ends: 15 cm and 5 % of the distance; its heading."""
MIN_M, MIN_RAD = 0.01, 0.005
"""An uncertainty that is smaller is none: sources differ by their noise."""
DRIFT_PER_M: Final = 0.02
"""Growth of an uncertainty that is not zero with the distance driven on dead reckoning."""


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """Bounds of the error of the pose of base_link.

    Attributes:
        position_m: distance from the position, in the plane.
        heading_rad: angle from the heading.
        cause: the fault, or whatever else showed that the pose may be wrong; empty where nothing.
    """

    position_m: float = 0.0
    heading_rad: float = 0.0
    cause: str = ""

    def __bool__(self) -> bool:
        """Whether the pose may be wrong by more than counts."""
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
        """Return the uncertainty of the position after so much was driven by dead reckoning."""
        return self.position_m + (DRIFT_PER_M + self.heading_rad) * distance_m
