"""Textures of soil and rocks and colours of the scene, for both renderers."""

from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
Colour = tuple[float, float, float]

ZENITH: Final[Colour] = (0.66, 0.52, 0.40)
HORIZON: Final[Colour] = (0.89, 0.76, 0.60)
SOIL: Final[Colour] = (0.69, 0.42, 0.27)
ROCK: Final[Colour] = (0.40, 0.29, 0.24)
HILL: Final[Colour] = (0.62, 0.41, 0.29)
WALL: Final[Colour] = (0.72, 0.69, 0.64)
PATCH: Final[Colour] = (0.74, 0.78, 0.82)

SUN_DIRECTION: Final = (-0.55, 0.45, -0.62)
"""Direction of the light, in the world's axes."""
AMBIENT: Final = 0.42
SUNLIGHT: Final = 0.75
HAZE_START_M: Final = 15.0
HAZE_END_M: Final = 140.0

TILE_M: Final = 4.0
"""Side of the square of ground that one copy of a texture covers."""


def _noise(size: int, feature: float, seed: int) -> NDArray[np.float64]:
    """Return noise that tiles, of standard deviation 1, shape (size, size)."""
    white = np.random.default_rng(seed).standard_normal((size, size))
    down, across = np.fft.fftfreq(size), np.fft.rfftfreq(size)
    passed = np.outer(np.exp(-((down * feature) ** 2)), np.exp(-((across * feature) ** 2)))
    smooth = np.fft.irfft2(np.fft.rfft2(white) * passed, white.shape)
    return np.asarray(smooth / smooth.std())


def _coloured(colour: Colour, brightness: NDArray[np.float64]) -> Image:
    return (np.clip(brightness[..., None] * colour, 0, 1) * 255).astype(np.uint8)


@cache
def soil_texture(size: int = 384) -> Image:
    """Return reddish soil with drifts, grit and pebbles: shape (size, size, 3)."""
    grit = _noise(size, 1.2, 1)
    pebbles = np.clip(_noise(size, 4.5, 2) - 2.0, 0, 1)
    bright = 1 + 0.07 * _noise(size, 68, 3) + 0.05 * _noise(size, 14, 4) + 0.06 * grit
    return _coloured(SOIL, bright - 0.55 * pebbles)


@cache
def rock_texture(size: int = 128) -> Image:
    """Return dark mottled stone: shape (size, size, 3)."""
    return _coloured(ROCK, 1 + 0.14 * _noise(size, 14, 5) + 0.10 * _noise(size, 2, 6))
