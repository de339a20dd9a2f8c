"""The simulated MOCUP: a small rover moved by the brick that stands on it, and by nothing else."""

from dataclasses import replace
from math import degrees, floor
from random import Random
from typing import Final

from adapters.mops import load_dictionary
from executive.geometry import Pose
from sim.brick import BrickSettings, Firmware, Senses, SetPoints
from sim.rover.body import PERIOD_S, Fault, Pack, SimulatedBody, jumped
from sim.rover.camera import PictureSettings
from sim.rover.model import MOCUP
from sim.rover.world import World

PACK: Final = Pack(
    cells=2,
    capacity_j=10.4 * 3600.0,
    resistance_ohm=0.3,
    idle_w=2.0,
    efficiency=0.4,
    heat_w_per_nm2=50.0,
    fault_v=6.0,
)
"""The NXT's own pack: 7.4 V, 1.4 A h."""


class SimulatedMocup(SimulatedBody):
    """MOCUP in a world. Its brick starts with the true pose.

    Attributes:
        brick: hears and says MOPS strings.
    """

    def __init__(
        self,
        world: World,
        seed: int = 0,
        brick: BrickSettings | None = None,
        picture: PictureSettings | None = None,
    ) -> None:
        """Put the rover on the ground at the world's start and let it settle.

        Args:
            world: where it drives.
            seed: of latencies and of the brick's errors; the same repeats bit for bit.
            brick: how the brick is built.
            picture: size, quality and backend of camera pictures.
        """
        super().__init__(MOCUP, PACK, world, picture)
        start = replace(self._pose, z_m=0.0, roll_rad=0.0, pitch_rad=0.0)
        self.brick = Firmware(load_dictionary(), brick or BrickSettings(), start, Random(seed))
        self._counts = (0, 0)
        self._first_rad = tuple(self._wheels_rad)
        self._points = SetPoints(0.0, 0.0, 0.0, 0.0)
        self._actuate()

    def hear(self, octets: bytes) -> None:
        """Give the brick octets."""
        self.brick.take(octets, self.time_s)

    def inject(self, fault: Fault) -> None:
        """Switch a fault on."""
        super().inject(fault)
        self.brick.mute = Fault.ODOMETRY_LOST in self._faults
        if fault is Fault.ODOMETRY_JUMP:
            odometry = self.brick.machine.odometry
            odometry.pose = jumped(odometry.pose)

    def clear(self, fault: Fault) -> None:
        """Switch a fault off."""
        super().clear(fault)
        self.brick.mute = Fault.ODOMETRY_LOST in self._faults

    @property
    def odometry_pose(self) -> Pose:
        """Where the brick believes it is."""
        return self.brick.machine.odometry.pose

    def _sense(self, before: Pose, turned_rad: list[float]) -> None:
        """Have the brick live through the period."""
        if Fault.ODOMETRY_FROZEN not in self._faults:
            left, right = (
                floor(degrees(now - first) + 0.5)
                for now, first in zip(self._wheels_rad, self._first_rad, strict=True)
            )
            self._counts = (left, right)
        angles = self.camera_angles
        senses = Senses(*self._counts, self._voltage_v(), angles.pan_rad, angles.tilt_rad)
        self._points = self.brick.step(self.time_s, senses, PERIOD_S)

    def _actuate(self) -> None:
        """Give motors and head the brick's set points."""
        points = self._points
        left, right = self._unstuck(points.left_radps, points.right_radps)
        self._ctrl[:] = (left, right, points.pan_rad, points.tilt_rad)
