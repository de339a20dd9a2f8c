"""`World` of a simulated rover, read from YAML, and the shape of its ground (`Terrain`).

Defines and checks the valid worlds; their display and simulation are in `sim.rover.model`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import ceil, hypot, pi
from pathlib import Path
from random import Random

import numpy as np
from numpy.typing import NDArray

from executive.settings import SettingsError, figure, load_yaml, structure
from executive.values.geometry import Pose
from sim.rover.features import (
    BANK_M,
    MAX_COORDINATE_M,
    Ditch,
    FrictionPatch,
    Outline,
    SlopeZone,
    StepBlock,
    Wall,
    require,
)

CLEAR_M = 0.35
"""Minimum distance of walls, steps and ditches from the start."""


@dataclass(frozen=True, slots=True)
class SoilShape:
    """The soil: flat, or hills of smooth random shape on a square about the origin.

    Attributes:
        amplitude_m: height difference between the extremes; 0 is flat ground.
        feature_m: length scale of the hills.
        size_m: side of the uneven square; beyond it the ground is flat.
    """

    amplitude_m: float = figure(maximum=2.0, default=0.0)
    feature_m: float = figure(0.3, default=2.0)
    size_m: float = figure(2.0, 60.0, default=30.0)
    seed: int = figure(default=0)


@dataclass(frozen=True, slots=True)
class Rock:
    """A rock: its position, half its width, and its height above the ground."""

    x_m: float
    y_m: float
    radius_m: float = figure(0.02, 5.0)
    height_m: float = figure(0.01, 5.0)


@dataclass(frozen=True, slots=True)
class Clearing:
    """A disc without scattered rocks."""

    x_m: float
    y_m: float
    radius_m: float


@dataclass(frozen=True, slots=True)
class Scatter:
    """Rocks scattered at random over a square about the origin.

    Attributes:
        count: number of rocks; fewer if the clearings leave too little space.
        size_m: side of the square.
        min_radius_m: minimum half width of a rock.
        max_radius_m: maximum half width of a rock.
        min_height_m: minimum height of a rock; usual are 0.6 to 1.2 of their half width.
        clearings: areas without rocks.
    """

    count: int = figure(maximum=500, default=0)
    size_m: float = 24.0
    min_radius_m: float = 0.06
    max_radius_m: float = 0.4
    seed: int = 0
    clearings: tuple[Clearing, ...] = ()
    min_height_m: float = figure(0.01, 5.0, default=0.01)

    def __post_init__(self) -> None:
        require(
            0.02 <= self.min_radius_m <= self.max_radius_m <= 5,
            f"min_radius_m {self.min_radius_m} and max_radius_m {self.max_radius_m} are not ordered"
            " in 0.02 .. 5",
        )

    def rocks(self, *besides: Clearing) -> tuple[Rock, ...]:
        """Return the rocks, the same ones each time, none of them in a clearing."""
        clearings = self.clearings + besides
        random = Random(self.seed)
        found: list[Rock] = []
        for _ in range(20 * self.count):
            if len(found) == self.count:
                break
            radius_m = (
                self.min_radius_m * (self.max_radius_m / self.min_radius_m) ** random.random() ** 2
            )
            x_m = random.uniform(-0.5, 0.5) * self.size_m
            y_m = random.uniform(-0.5, 0.5) * self.size_m
            height_m = max(self.min_height_m, radius_m * random.uniform(0.6, 1.2))
            free = all(
                hypot(x_m - clear.x_m, y_m - clear.y_m) > clear.radius_m + radius_m
                for clear in clearings
            )
            if free:
                found.append(Rock(x_m, y_m, radius_m, height_m))
        return tuple(found)


@dataclass(frozen=True, slots=True)
class StartPose:
    """Start pose of the rover."""

    x_m: float = figure(-MAX_COORDINATE_M, MAX_COORDINATE_M, default=0.0)
    y_m: float = figure(-MAX_COORDINATE_M, MAX_COORDINATE_M, default=0.0)
    heading_rad: float = figure(-pi, pi, default=0.0)


@dataclass(frozen=True, slots=True)
class World:
    """Properties of the environment that affect the rover.

    Attributes:
        slope_rad: slope of the whole world towards +x.
        friction: Coulomb friction of wheels on soil and rock.
        rocks: rocks at given positions.
        scatter: rocks at random positions.
        walls, steps, ditches, patches, slopes: features at given positions. Of overlapping patches
            the last one counts; slopes add up. Ditches and slopes are within the square of the
            ground.
        charge_ratio: charge of the battery, 0 to 1.
        sun_w: power that charges the battery, in W.
        dark: whether it is too dark for visual odometry; pictures are unchanged.
    """

    name: str = "flat"
    ground: SoilShape = field(default_factory=SoilShape)
    slope_rad: float = figure(-1.0, 1.0, default=0.0)
    friction: float = figure(0.05, 2.0, default=0.6)
    rocks: tuple[Rock, ...] = ()
    scatter: Scatter = field(default_factory=Scatter)
    walls: tuple[Wall, ...] = ()
    steps: tuple[StepBlock, ...] = ()
    ditches: tuple[Ditch, ...] = ()
    patches: tuple[FrictionPatch, ...] = ()
    slopes: tuple[SlopeZone, ...] = ()
    start: StartPose = field(default_factory=StartPose)
    charge_ratio: float = figure(maximum=1.0, default=0.9)
    sun_w: float = figure(maximum=1000.0, default=0.0)
    dark: bool = False

    def __post_init__(self) -> None:
        self._check_start()
        for number, ditch in enumerate(self.ditches):
            reach_m = max(max(abs(corner.x_m), abs(corner.y_m)) for corner in ditch.corners)
            require(
                reach_m <= self.ground.size_m / 2,
                f"ditches[{number}] reaches beyond the {self.ground.size_m:g} m of the ground",
            )

    def _check_start(self) -> None:
        areas = {"walls": [wall.area for wall in self.walls], "steps": self.steps}
        for kind, found in {**areas, "ditches": self.ditches}.items():
            for number, area in enumerate(found):
                require(
                    area.distance_m(self.start.x_m, self.start.y_m) >= CLEAR_M,
                    f"{kind}[{number}] is nearer than {CLEAR_M:g} m to the start",
                )

    @property
    def terrain(self) -> "Terrain":
        """The shape of its ground."""
        return make_terrain(self.ground, (*self.ditches, *self.slopes))

    @property
    def outlines(self) -> tuple[Outline, ...]:
        """The shapes of walls, steps, ditches, patches and slopes, for drawings."""
        features = (self.slopes, self.patches, self.ditches, self.steps, self.walls)
        return tuple(feature.outline for kind in features for feature in kind)

    @property
    def all_rocks(self) -> tuple[Rock, ...]:
        """The rocks at given positions, then the scattered ones, which leave the start free."""
        return self.rocks + self.scatter.rocks(Clearing(self.start.x_m, self.start.y_m, 0.7))

    @property
    def start_pose(self) -> Pose:
        """The start as a planar pose."""
        return Pose(self.start.x_m, self.start.y_m, heading_rad=self.start.heading_rad)


def load_world(path: Path) -> World:
    """Read a world from a YAML file.

    Raises:
        SettingsError: if the file cannot be read, is no YAML, or is not a valid world.
    """
    content = load_yaml(path)
    if not isinstance(content, dict):
        raise SettingsError(f"{path}: a world is a YAML mapping")
    return structure({"name": path.stem, **content}, World, str(path))


CELL_M = 0.25


@dataclass(frozen=True, slots=True)
class Terrain:
    """Heights over a square about the origin, in the world's axes before it is sloped.

    Attributes:
        heights_m: shape (n, n), rows along y, columns along x; 0 at the edges except for slopes.
        size_m: side of the square.
    """

    heights_m: NDArray[np.float64]
    size_m: float

    def height_m(self, x_m: float, y_m: float) -> float:
        """Return the height of the ground at a position, 0 outside the square."""
        last = self.heights_m.shape[0] - 1
        column = (x_m / self.size_m + 0.5) * last
        row = (y_m / self.size_m + 0.5) * last
        if not (0 <= column < last and 0 <= row < last):
            return 0.0
        i, j = int(row), int(column)
        up, along = row - i, column - j
        near = self.heights_m[i : i + 2, j : j + 2]
        weights = np.outer((1 - up, up), (1 - along, along))
        return float((near * weights).sum())

    def heights_at_m(self, along_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the heights on a grid with equal coordinates along x and y."""
        own_m = np.linspace(-0.5, 0.5, self.heights_m.shape[0]) * self.size_m
        across = np.array([np.interp(along_m, own_m, row) for row in self.heights_m])
        return np.array([np.interp(along_m, own_m, column) for column in across.T]).T


def make_terrain(ground: SoilShape, reliefs: Sequence[Ditch | SlopeZone] = ()) -> Terrain:
    """Return the terrain of a ground with reliefs, which need finer cells than hills."""
    hills = _hills(ground)
    if not reliefs:
        return hills
    count = round(ground.size_m / BANK_M) + 1
    along_m = np.linspace(-0.5, 0.5, count) * ground.size_m
    x_m, y_m = np.meshgrid(along_m, along_m)
    heights_m = hills.heights_at_m(along_m)
    for relief in reliefs:
        heights_m = heights_m + relief.height_m(x_m, y_m)
    return Terrain(heights_m, ground.size_m)


def _hills(ground: SoilShape) -> Terrain:
    """Return smooth noise that fades to level ground at the edges."""
    cells = max(2, ceil(ground.size_m / CELL_M))
    if ground.amplitude_m == 0:
        return Terrain(np.zeros((2, 2)), ground.size_m)
    white = np.random.default_rng(ground.seed).standard_normal((cells, cells))
    per_m = np.fft.fftfreq(cells, ground.size_m / cells)
    squared = per_m[:, None] ** 2 + per_m[None, :] ** 2
    smooth = np.exp(-squared * (0.6 * ground.feature_m) ** 2)
    hills = np.fft.ifft2(np.fft.fft2(white) * smooth).real
    hills = (hills - hills.min()) / (hills.max() - hills.min())
    edge = np.clip(np.linspace(0, 6, cells), 0, 1) * np.clip(np.linspace(6, 0, cells), 0, 1)
    faded = hills * np.minimum.outer(edge, edge)
    return Terrain(ground.amplitude_m * faded / faded.max(), ground.size_m)
