"""Settings for predictions: accuracy and energy of motions, and the energy of the battery."""

from dataclasses import dataclass, field
from enum import Enum, auto
from math import hypot
from typing import Final, assert_never

from executive.obstacles.zones import MAX_COORDINATE_M
from executive.settings.settings_files import MAX_VALUE, require_above_zero
from executive.values.geometry import Point


class MotionEndKind(Enum):
    """End of the last motion of a path."""

    LINE = auto()
    CURVE = auto()
    FREE_CURVE = auto()
    """A curve to a position, at any heading."""


@dataclass(frozen=True, slots=True)
class MotionExtent:
    """Extent of a motion, which determines its deviation and energy.

    Attributes:
        turned_rad: sum of all turning, without sign.
        curved_m: sum over all pieces of the lesser of length and turning times 1 m, in metres.
        end: end of its last motion.
    """

    duration_s: float
    length_m: float
    turned_rad: float
    curved_m: float = 0.0
    end: MotionEndKind = MotionEndKind.LINE


@dataclass(frozen=True, slots=True)
class PredictionSettings:
    """Accuracy of a predicted motion, and its energy.

    Deviations at 2 sigma: independent parts that are added as squares.

    Attributes:
        position_m, position_m_per_m, position_m_per_rad: position deviation: constant, per metre of
            path,
            per radian of turning.
        heading_rad, heading_rad_per_m, heading_rad_per_rad: heading deviation, likewise.
        curve_position_m, curve_heading_rad: position and heading deviation after a curve of mpc.
        free_heading_rad: heading deviation if the curve ends without a commanded heading.
        standing_w: power of the stationary asset; None if energy is not predicted.
        travel_j_per_m, rotate_j_per_rad: additional energy of its motion.
        curve_j_per_m: further energy of driving and turning at once, per metre.
    """

    position_m: float = 0.02
    position_m_per_m: float = 0.003
    position_m_per_rad: float = 0.004
    heading_rad: float = 0.015
    heading_rad_per_m: float = 0.001
    heading_rad_per_rad: float = 0.001
    curve_position_m: float = 0.06
    curve_heading_rad: float = 0.045
    free_heading_rad: float = 0.4
    standing_w: float | None = None
    travel_j_per_m: float = 0.0
    rotate_j_per_rad: float = 0.0
    curve_j_per_m: float = 0.0

    def __post_init__(self) -> None:
        """Raise ValueError unless every figure is within its bounds."""
        require_above_zero(self, "position_m", "heading_rad", "standing_w")
        for name in (
            *("position_m_per_m", "position_m_per_rad", "heading_rad_per_m", "heading_rad_per_rad"),
            *("curve_position_m", "curve_heading_rad", "free_heading_rad"),
            *("travel_j_per_m", "rotate_j_per_rad", "curve_j_per_m"),
        ):
            figure = getattr(self, name)
            if not 0 <= figure <= MAX_VALUE:
                raise ValueError(f"{name} must be 0 to {MAX_VALUE:g}, not {figure}")

    def position_deviation_m(self, extent: MotionExtent) -> float:
        """Return the position deviation after a motion, at 2 sigma."""
        grown = (
            self.position_m_per_m * extent.length_m,
            self.position_m_per_rad * extent.turned_rad,
        )
        curve_m = 0.0 if extent.end is MotionEndKind.LINE else self.curve_position_m
        return hypot(self.position_m, curve_m, *grown)

    def heading_deviation_rad(self, extent: MotionExtent) -> float:
        """Return the heading deviation after a motion, at 2 sigma."""
        grown = (
            self.heading_rad_per_m * extent.length_m,
            self.heading_rad_per_rad * extent.turned_rad,
        )
        match extent.end:
            case MotionEndKind.LINE:
                end_rad = 0.0
            case MotionEndKind.CURVE:
                end_rad = self.curve_heading_rad
            case MotionEndKind.FREE_CURVE:
                end_rad = self.free_heading_rad
            case _:
                assert_never(extent.end)
        return hypot(self.heading_rad, end_rad, *grown)

    def energy_j(self, extent: MotionExtent) -> float | None:
        """Return the energy of a motion in joules, None if it is not predicted."""
        if self.standing_w is None:
            return None
        moving_j = self.travel_j_per_m * extent.length_m + self.rotate_j_per_rad * extent.turned_rad
        return self.standing_w * extent.duration_s + moving_j + self.curve_j_per_m * extent.curved_m


def curved_m(length_m: float, turned_rad: float) -> float:
    """Return the lesser of a path's length and its turning times 1 m."""
    return min(abs(length_m), abs(turned_rad))


MAX_RESERVE: Final = 0.9


@dataclass(frozen=True, slots=True)
class BatterySettings:
    """Battery energy available to motion: each motion must leave enough for the return.

    Attributes:
        capacity_j: energy when full.
        reserve_ratio: charge reserved for the unexpected, as a ratio of the capacity.
        home: position that the rover must be able to reach again, in the odometry frame.
    """

    capacity_j: float
    reserve_ratio: float = 0.2
    home: Point = field(default_factory=lambda: Point(0.0, 0.0))

    def __post_init__(self) -> None:
        """Raise ValueError unless every figure is within its bounds."""
        require_above_zero(self, "capacity_j")
        if not 0.0 <= self.reserve_ratio <= MAX_RESERVE:
            raise ValueError(f"reserve_ratio is {self.reserve_ratio}: 0 to {MAX_RESERVE}")
        if not (abs(self.home.x_m) <= MAX_COORDINATE_M and abs(self.home.y_m) <= MAX_COORDINATE_M):
            raise ValueError(f"home is farther than {MAX_COORDINATE_M:g} m from the origin")

    def available_j(self, charge_ratio: float) -> float:
        """Return the energy above the reserve, negative below it."""
        return (charge_ratio - self.reserve_ratio) * self.capacity_j
