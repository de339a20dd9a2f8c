"""`SimulatedMocup`: a small rover that only its emulated brick moves."""

from collections import deque
from dataclasses import replace
from math import degrees, floor
from random import Random
from typing import Final

from adapters.mops import load_dictionary
from executive.values.geometry import Pose
from executive.values.parameters import Parameter
from sim.brick import BrickSettings, Firmware, Readings, SensorReadings, SetPoints
from sim.checkpoint import CheckpointError
from sim.rover import faults
from sim.rover.body import PERIOD_S, BatteryPack, SimulatedBody, offset_left
from sim.rover.camera import PictureSettings
from sim.rover.faults import MOCUP_PARTS, SimulatedFault
from sim.rover.model import MOCUP
from sim.rover.world import World

PACK: Final = BatteryPack(
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

    Args:
        seed: seed of latencies and of the brick's errors; the same seed repeats bit for bit.

    Attributes:
        brick: receives and sends MOPS messages.
    """

    def __init__(
        self,
        world: World,
        seed: int = 0,
        brick: BrickSettings | None = None,
        picture: PictureSettings | None = None,
    ) -> None:
        super().__init__(MOCUP, PACK, world, picture, MOCUP_PARTS)
        start = replace(self._pose, z_m=0.0, roll_rad=0.0, pitch_rad=0.0)
        self.brick = Firmware(load_dictionary(), brick or BrickSettings(), start, Random(seed))
        self.brick.distort = self._distorted
        self._measured: deque[tuple[float, Readings]] = deque()
        self._last_readings: Readings | None = None
        self._counts = (0, 0)
        self._first_rad = self._wheels_rad
        self._points = SetPoints(0.0, 0.0, 0.0, 0.0)
        self._actuate()

    def save(self) -> str:
        """Refuse: a state without that of the brick would continue another run.

        Raises:
            CheckpointError: always.
        """
        raise CheckpointError("the state of MOCUP's brick is not saved: start at the beginning")

    def receive(self, octets: bytes) -> None:
        """Pass octets to the brick."""
        self.brick.receive(octets, self.time_s)

    def inject(self, fault: SimulatedFault) -> None:
        """Inject a fault."""
        super().inject(fault)
        if isinstance(fault, faults.OdometryJump):
            self._offset_believed_pose(fault.by_m)
        if isinstance(fault, faults.BrickSilent):
            self.brick.mute = True

    def clear(self, kind: type[SimulatedFault]) -> None:
        """Clear a fault, if it is active."""
        super().clear(kind)
        if kind is faults.BrickSilent:
            self.brick.mute = False

    def _sense(self, before: Pose, turned_rad: list[float]) -> None:
        """Run the brick for the period."""
        drift = self.fault(faults.OdometryDrift)
        if drift is not None:
            self._offset_believed_pose(drift.rate_mps * PERIOD_S)
        counted_rad = self.counted(turned_rad)
        if counted_rad is not turned_rad:
            self._first_rad = [
                first + turned - counted
                for first, turned, counted in zip(
                    self._first_rad, turned_rad, counted_rad, strict=True
                )
            ]
        if faults.OdometryFrozen not in self._faults:
            left, right = (
                floor(degrees(now - first) + 0.5)
                for now, first in zip(self._wheels_rad, self._first_rad, strict=True)
            )
            self._counts = (left, right)
        angles = self.camera_angles
        senses = SensorReadings(*self._counts, self._voltage_v(), angles.pan_rad, angles.tilt_rad)
        self._points = self.brick.step(self.time_s, senses, PERIOD_S)

    def _offset_believed_pose(self, distance_m: float) -> None:
        """Move the brick's estimated pose by a distance to the left."""
        odometry = self.brick.machine.odometry
        odometry.pose = offset_left(odometry.pose, distance_m)

    def _distorted(self, readings: Readings) -> Readings | None:
        """Return the telemetry sent for the brick's readings."""
        late = self.fault(faults.OdometryLate)
        self._measured.append((self.time_s, readings))
        sent_s = self.time_s if late is None else self.time_s - late.by_s
        while len(self._measured) > 1 and self._measured[1][0] <= sent_s:
            self._measured.popleft()
        measured_s, readings = self._measured[0]
        if measured_s > sent_s or faults.OdometryLost in self._faults:
            return None
        if self._last_readings is not None and faults.OdometryRepeated in self._faults:
            return self._last_readings
        changed = dict(readings)
        if faults.OdometryZeroTwist in self._faults:
            changed |= {
                Parameter.CURRENT_TRAVEL_SPEED: 0.0,
                Parameter.CURRENT_ROTATE_SPEED: 0.0,
            }
        if faults.BatterySilent in self._faults:
            del changed[Parameter.BATERY_VOLTAGE]
        self._last_readings = changed
        return changed

    def _actuate(self) -> None:
        """Apply the brick's set points to motors and head."""
        points = self._points
        left, right = self._unstuck(points.left_radps, points.right_radps)
        self._ctrl[:] = (left, right, *self._head_rad(points.pan_rad, points.tilt_rad))
