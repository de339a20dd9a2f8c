"""The shape of uneven ground, as a grid of heights."""

from dataclasses import dataclass
from math import ceil

import numpy as np
from numpy.typing import NDArray

from sim.world import Ground

CELL_M = 0.25


@dataclass(frozen=True, slots=True)
class Terrain:
    """Heights over a square about the origin, in the world's axes before it is sloped.

    Attributes:
        heights_m: shape (n, n), rows along y, columns along x, least value 0.
        size_m: side of the square.
    """

    heights_m: NDArray[np.float64]
    size_m: float

    def height_m(self, x_m: float, y_m: float) -> float:
        """Return the height of the ground at a place, 0 outside the square."""
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


def make_terrain(ground: Ground) -> Terrain:
    """Return the terrain of a ground: smooth noise that runs out to level ground at the edges."""
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
