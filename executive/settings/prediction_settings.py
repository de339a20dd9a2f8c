"""How exactly a motion is foretold, what it takes of the battery, and what that may give."""

from dataclasses import dataclass, field
from enum import Enum, auto
from math import hypot
from typing import Final, assert_never

from executive.obstacles.zones import FARTHEST_M
from executive.settings.settings_files import HIGHEST_FIGURE, require_above_zero
from executive.values.geometry import Point


class MotionEndKind(Enum):
    """How the last motion of a way ends."""

    LINE = auto()
    CURVE = auto()
    FREE_CURVE = auto()
    """A curve to a place, at whatever heading."""


@dataclass(frozen=True, slots=True)
class MotionExtent:
    """What a deviation or an energy depends on.

    Attributes:
        turned_rad: sum of all turning, without sign.
        curved_m: of all pieces of it the lesser of length and turning times 1 m, in metres.
        end: of its last motion.
    """

    duration_s: float
    length_m: float
    turned_rad: float
    curved_m: float = 0.0
    end: MotionEndKind = MotionEndKind.LINE


@dataclass(frozen=True, slots=True)
class PredictionSettings:
    """How exactly a motion is foretold, and what it takes of the battery.

    Deviations at 2 sigma: independent parts that are added as squares.

    Attributes:
        place_m, place_m_per_m, place_m_per_rad: of the place: of each end, for each metre of way,
            for each radian of turning.
        heading_rad, heading_rad_per_m, heading_rad_per_rad: of the heading, alike.
        curve_place_m, curve_heading_rad: of place and heading where mpc ends a curve.
        free_heading_rad: of the heading where no heading is asked for there.
        standing_w: power that the asset takes while it stands; None where energy is not foretold.
        travel_j_per_m, rotate_j_per_rad: what its motion takes beside that.
        curve_j_per_m: what driving and turning at once takes beside both, for each metre.
    """

    place_m: float = 0.02
    place_m_per_m: float = 0.003
    place_m_per_rad: float = 0.004
    heading_rad: float = 0.015
    heading_rad_per_m: float = 0.001
    heading_rad_per_rad: float = 0.001
    curve_place_m: float = 0.06
    curve_heading_rad: float = 0.045
    free_heading_rad: float = 0.4
    standing_w: float | None = None
    travel_j_per_m: float = 0.0
    rotate_j_per_rad: float = 0.0
    curve_j_per_m: float = 0.0

    def __post_init__(self) -> None:
        """Raise ValueError where a figure is none."""
        require_above_zero(self, "place_m", "heading_rad", "standing_w")
        for name in (
            *("place_m_per_m", "place_m_per_rad", "heading_rad_per_m", "heading_rad_per_rad"),
            *("curve_place_m", "curve_heading_rad", "free_heading_rad"),
            *("travel_j_per_m", "rotate_j_per_rad", "curve_j_per_m"),
        ):
            figure = getattr(self, name)
            if not 0 <= figure <= HIGHEST_FIGURE:
                raise ValueError(f"{name} must be 0 to {HIGHEST_FIGURE:g}, not {figure}")

    def within_m(self, way: MotionExtent) -> float:
        """Return the deviation of the place after a way, at 2 sigma."""
        grown = (self.place_m_per_m * way.length_m, self.place_m_per_rad * way.turned_rad)
        curve_m = 0.0 if way.end is MotionEndKind.LINE else self.curve_place_m
        return hypot(self.place_m, curve_m, *grown)

    def within_rad(self, way: MotionExtent) -> float:
        """Return the deviation of the heading after a way, at 2 sigma."""
        grown = (self.heading_rad_per_m * way.length_m, self.heading_rad_per_rad * way.turned_rad)
        match way.end:
            case MotionEndKind.LINE:
                end_rad = 0.0
            case MotionEndKind.CURVE:
                end_rad = self.curve_heading_rad
            case MotionEndKind.FREE_CURVE:
                end_rad = self.free_heading_rad
            case _:
                assert_never(way.end)
        return hypot(self.heading_rad, end_rad, *grown)

    def energy_j(self, way: MotionExtent) -> float | None:
        """Return what a motion takes of the battery, None where that is not known."""
        if self.standing_w is None:
            return None
        moving_j = self.travel_j_per_m * way.length_m + self.rotate_j_per_rad * way.turned_rad
        return self.standing_w * way.duration_s + moving_j + self.curve_j_per_m * way.curved_m


def curved_m(length_m: float, turned_rad: float) -> float:
    """Return the lesser of the length of a piece of way and its turning times 1 m."""
    return min(abs(length_m), abs(turned_rad))


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
