"""How exactly a motion is foretold, what it takes of the battery, and what that may give."""

from dataclasses import dataclass, field
from math import hypot
from typing import Final

from executive.geometry import Point
from executive.settings_files import HIGHEST_FIGURE, require_above_zero
from executive.zones import FARTHEST_M


@dataclass(frozen=True, slots=True)
class PredictionSettings:
    """How exactly a motion is foretold, and what it takes of the battery.

    Deviations at 2 sigma: independent parts that are added as squares.

    Attributes:
        place_m, place_m_per_m, place_m_per_rad: of the place: of each end, for each metre of way,
            for each radian of turning.
        heading_rad, heading_rad_per_m, heading_rad_per_rad: of the heading, alike.
        standing_w: power that the asset takes while it stands; None where energy is not foretold.
        travel_j_per_m, rotate_j_per_rad: what its motion takes beside that.
    """

    place_m: float = 0.02
    place_m_per_m: float = 0.003
    place_m_per_rad: float = 0.004
    heading_rad: float = 0.015
    heading_rad_per_m: float = 0.001
    heading_rad_per_rad: float = 0.001
    standing_w: float | None = None
    travel_j_per_m: float = 0.0
    rotate_j_per_rad: float = 0.0

    def __post_init__(self) -> None:
        """Raise ValueError where a figure is none."""
        require_above_zero(self, "place_m", "heading_rad", "standing_w")
        for name in (
            *("place_m_per_m", "place_m_per_rad", "heading_rad_per_m", "heading_rad_per_rad"),
            *("travel_j_per_m", "rotate_j_per_rad"),
        ):
            figure = getattr(self, name)
            if not 0 <= figure <= HIGHEST_FIGURE:
                raise ValueError(f"{name} must be 0 to {HIGHEST_FIGURE:g}, not {figure}")

    def within_m(self, length_m: float, turned_rad: float) -> float:
        """Return the deviation of the place after a way with turns, at 2 sigma."""
        grown = (self.place_m_per_m * length_m, self.place_m_per_rad * turned_rad)
        return hypot(self.place_m, *grown)

    def within_rad(self, length_m: float, turned_rad: float) -> float:
        """Return the deviation of the heading after a way with turns, at 2 sigma."""
        grown = (self.heading_rad_per_m * length_m, self.heading_rad_per_rad * turned_rad)
        return hypot(self.heading_rad, *grown)

    def energy_j(self, duration_s: float, length_m: float, turned_rad: float) -> float | None:
        """Return what a motion takes of the battery, None where that is not known."""
        if self.standing_w is None:
            return None
        moving_j = self.travel_j_per_m * length_m + self.rotate_j_per_rad * turned_rad
        return self.standing_w * duration_s + moving_j


HIGHEST_RESERVE: Final = 0.9


@dataclass(frozen=True, slots=True)
class BatterySettings:
    """What a battery may give: nothing begins from which it could not bring the rover back.

    Attributes:
        capacity_j: energy when full.
        reserve_ratio: charge that is kept for what nobody foresees, of the whole.
        home: where the rover has to be able to come back to, in the frame of its odometry.
    """

    capacity_j: float
    reserve_ratio: float = 0.2
    home: Point = field(default_factory=lambda: Point(0.0, 0.0))

    def __post_init__(self) -> None:
        """Raise ValueError where a figure is none."""
        require_above_zero(self, "capacity_j")
        if not 0.0 <= self.reserve_ratio <= HIGHEST_RESERVE:
            raise ValueError(f"reserve_ratio is {self.reserve_ratio}: 0 to {HIGHEST_RESERVE}")
        if not (abs(self.home.x_m) <= FARTHEST_M and abs(self.home.y_m) <= FARTHEST_M):
            raise ValueError(f"home is farther than {FARTHEST_M:g} m from the origin")

    def left_j(self, charge_ratio: float) -> float:
        """Return what is left above the reserve, negative below it."""
        return (charge_ratio - self.reserve_ratio) * self.capacity_j
