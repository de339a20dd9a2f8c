"""Features of a world that its YAML lists: walls, steps, ditches, friction patches, slopes.

Positions are in metres on the ground before the whole world is sloped, x forward and y left of
its origin.
"""

from dataclasses import dataclass
from enum import Enum, unique
from math import atan2, cos, degrees, hypot, pi, sin, tan
from typing import Final

import numpy as np
from numpy.typing import NDArray

from executive.settings import figure
from executive.values.geometry import Point

MAX_COORDINATE_M: Final = 1000.0
BANK_M: Final = 0.1
"""Width of the sides of a ditch and of a slope, inside it."""
MAX_SLOPE_RAD: Final = 0.7
_FRICTION: Final = (0.01, 2.0)
_SIDE_M: Final = (0.02, 2 * MAX_COORDINATE_M)
_RELIEF_M: Final = (0.005, 2.0)

Floats = NDArray[np.float64]


def require(condition: bool, text: str) -> None:
    """Raise ValueError unless a condition holds.

    Raises:
        ValueError: the condition is false.
    """
    if not condition:
        raise ValueError(text)


@unique
class FeatureKind(Enum):
    """Kind of a feature, for drawings."""

    WALL = "wall"
    STEP = "step"
    DITCH = "ditch"
    PATCH = "patch"
    SLOPE = "slope"


@dataclass(frozen=True, slots=True)
class Outline:
    """The shape of a feature, seen from above.

    Attributes:
        corners: in order around it.
        text: short label.
    """

    kind: FeatureKind
    corners: tuple[Point, ...]
    text: str


@dataclass(frozen=True, slots=True)
class GroundPoint:
    """A position on the ground."""

    x_m: float = figure(-MAX_COORDINATE_M, MAX_COORDINATE_M)
    y_m: float = figure(-MAX_COORDINATE_M, MAX_COORDINATE_M)


@dataclass(frozen=True, slots=True, kw_only=True)
class Rectangle:
    """A rectangle on the ground.

    Attributes:
        x_m, y_m: its centre.
        length_m: along its heading.
        width_m: across it.
    """

    x_m: float = figure(-MAX_COORDINATE_M, MAX_COORDINATE_M)
    y_m: float = figure(-MAX_COORDINATE_M, MAX_COORDINATE_M)
    length_m: float = figure(*_SIDE_M)
    width_m: float = figure(*_SIDE_M)
    heading_rad: float = figure(-2 * pi, 2 * pi, default=0.0)

    @property
    def corners(self) -> tuple[Point, ...]:
        """The corners, counter-clockwise."""
        along, across = self.length_m / 2, self.width_m / 2
        ahead = (cos(self.heading_rad), sin(self.heading_rad))
        return tuple(
            Point(
                self.x_m + u * ahead[0] - v * ahead[1],
                self.y_m + u * ahead[1] + v * ahead[0],
            )
            for u, v in ((along, across), (-along, across), (-along, -across), (along, -across))
        )

    def local(self, x_m: Floats, y_m: Floats) -> tuple[Floats, Floats]:
        """Return positions relative to the centre, forward and left."""
        dx_m, dy_m = x_m - self.x_m, y_m - self.y_m
        ahead = (cos(self.heading_rad), sin(self.heading_rad))
        return dx_m * ahead[0] + dy_m * ahead[1], dy_m * ahead[0] - dx_m * ahead[1]

    def within_m(self, x_m: Floats, y_m: Floats) -> Floats:
        """Return the distance of positions to the border; negative outside."""
        along_m, across_m = self.local(x_m, y_m)
        return np.minimum(self.length_m / 2 - abs(along_m), self.width_m / 2 - abs(across_m))

    def distance_m(self, x_m: float, y_m: float) -> float:
        """Return the distance of a position from the rectangle; 0 within it."""
        along_m, across_m = self.local(np.array(x_m), np.array(y_m))
        outside_m = abs(along_m) - self.length_m / 2, abs(across_m) - self.width_m / 2
        return hypot(*(max(0.0, float(each)) for each in outside_m))


@dataclass(frozen=True, slots=True, kw_only=True)
class Wall:
    """A wall between two positions.

    Attributes:
        x_m, y_m: its start.
        to: its end.
        friction: friction of wheels on it; with that of rough ground, wheels climb it.
    """

    x_m: float = figure(-MAX_COORDINATE_M, MAX_COORDINATE_M)
    y_m: float = figure(-MAX_COORDINATE_M, MAX_COORDINATE_M)
    to: GroundPoint
    height_m: float = figure(0.02, 10.0, default=1.0)
    thickness_m: float = figure(0.02, 5.0, default=0.1)
    friction: float = figure(*_FRICTION, default=0.3)

    def __post_init__(self) -> None:
        require(
            hypot(self.to.x_m - self.x_m, self.to.y_m - self.y_m) >= 0.05,
            "a wall is shorter than 0.05 m",
        )

    @property
    def area(self) -> Rectangle:
        """Its area on the ground."""
        dx_m, dy_m = self.to.x_m - self.x_m, self.to.y_m - self.y_m
        return Rectangle(
            x_m=(self.x_m + self.to.x_m) / 2,
            y_m=(self.y_m + self.to.y_m) / 2,
            length_m=hypot(dx_m, dy_m),
            width_m=self.thickness_m,
            heading_rad=atan2(dy_m, dx_m),
        )

    @property
    def outline(self) -> Outline:
        """Its shape."""
        return Outline(FeatureKind.WALL, self.area.corners, f"{self.height_m:g} m")


@dataclass(frozen=True, slots=True, kw_only=True)
class StepBlock(Rectangle):
    """A block with upright sides and a top that a rover can drive on."""

    height_m: float = figure(*_RELIEF_M)

    @property
    def outline(self) -> Outline:
        """Its shape."""
        return Outline(FeatureKind.STEP, self.corners, f"{100 * self.height_m:.0f} cm")


@dataclass(frozen=True, slots=True, kw_only=True)
class Ditch(Rectangle):
    """A hole in the ground; its sides are the outermost `BANK_M` of it."""

    depth_m: float = figure(*_RELIEF_M)

    def __post_init__(self) -> None:
        require(
            min(self.length_m, self.width_m) >= 2 * BANK_M,
            f"a ditch is shorter or narrower than {2 * BANK_M:g} m",
        )

    def height_m(self, x_m: Floats, y_m: Floats) -> Floats:
        """Return the heights that it makes of level ground, at positions."""
        return -self.depth_m * np.clip(self.within_m(x_m, y_m) / BANK_M, 0.0, 1.0)

    @property
    def outline(self) -> Outline:
        """Its shape."""
        return Outline(FeatureKind.DITCH, self.corners, f"-{100 * self.depth_m:.0f} cm")


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionPatch(Rectangle):
    """Ground with a different friction."""

    friction: float = figure(*_FRICTION)

    @property
    def outline(self) -> Outline:
        """Its shape."""
        return Outline(FeatureKind.PATCH, self.corners, f"friction {self.friction:g}")


@dataclass(frozen=True, slots=True, kw_only=True)
class SlopeZone(Rectangle):
    """Ground that rises along its heading, and stays at that height beyond; a second one descends.

    Attributes:
        slope_rad: slope; negative descends.
    """

    slope_rad: float = figure(-MAX_SLOPE_RAD, MAX_SLOPE_RAD)

    def height_m(self, x_m: Floats, y_m: Floats) -> Floats:
        """Return the heights that it makes of level ground, at positions."""
        along_m, across_m = self.local(x_m, y_m)
        risen_m = np.clip(along_m + self.length_m / 2, 0.0, self.length_m)
        beside = np.clip((self.width_m / 2 - abs(across_m)) / BANK_M, 0.0, 1.0)
        return np.asarray(tan(self.slope_rad) * risen_m * beside)

    @property
    def outline(self) -> Outline:
        """Its shape."""
        return Outline(FeatureKind.SLOPE, self.corners, f"{degrees(self.slope_rad):.0f}°")
