"""Simulated rovers in MuJoCo worlds, behind the ports of an executive."""

from sim.rover.features import FeatureKind, Outline
from sim.rover.scenery import Image
from sim.rover.world import CELL_M, Ground, Rock, Terrain, World, load_world, make_terrain

__all__ = [
    "CELL_M",
    "FeatureKind",
    "Ground",
    "Image",
    "Outline",
    "Rock",
    "Terrain",
    "World",
    "load_world",
    "make_terrain",
]
