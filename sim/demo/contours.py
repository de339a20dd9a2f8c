"""Lines of equal height of the simulated ground."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from executive.geometry import Point
from sim.rover import Terrain


def contour(terrain: Terrain, height_m: float) -> Iterator[tuple[Point, Point]]:
    """Yield short straight pieces of the line at a height, by marching squares."""
    above_m = terrain.heights_m - height_m
    last = above_m.shape[0] - 1

    def place(row: float, column: float) -> Point:
        return Point((column / last - 0.5) * terrain.size_m, (row / last - 0.5) * terrain.size_m)

    high = above_m > 0
    count = high[:-1, :-1].astype(int) + high[:-1, 1:] + high[1:, 1:] + high[1:, :-1]
    for row, column in np.argwhere((count > 0) & (count < 4)).tolist():
        corners = [(row, column), (row, column + 1), (row + 1, column + 1), (row + 1, column)]
        crossings: list[Point] = []
        for (r, c), (to_r, to_c) in pairwise([*corners, corners[0]]):
            near_m, far_m = float(above_m[r, c]), float(above_m[to_r, to_c])
            if (near_m > 0) != (far_m > 0):
                part = near_m / (near_m - far_m)
                crossings.append(place(r + part * (to_r - r), c + part * (to_c - c)))
        yield from zip(crossings[::2], crossings[1::2], strict=True)
