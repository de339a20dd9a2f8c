"""Simulated rovers in MuJoCo worlds, behind the ports of an executive."""

from sim.rover.features import FeatureKind as FeatureKind
from sim.rover.features import Outline as Outline
from sim.rover.scenery import Image as Image
from sim.rover.world import CELL_M as CELL_M
from sim.rover.world import Rock as Rock
from sim.rover.world import SoilShape as SoilShape
from sim.rover.world import StartPose as StartPose
from sim.rover.world import World as World
from sim.rover.world import load_world as load_world
from sim.rover.world import make_terrain as make_terrain
