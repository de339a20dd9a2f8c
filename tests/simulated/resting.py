"""A Jackal whose physics passes only while it moves, so that a day of standing passes quickly."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final
from zlib import crc32

from executive.settings import Settings
from executive.values.facts import (
    Battery,
    CameraAngles,
    Fact,
    Frame,
    Imu,
    Joints,
    LaserScan,
    Odometry,
)
from executive.values.geometry import STANDING, Pose, Velocity
from executive.values.ports import CameraIntent, Downlink
from sim.rover.body import BatteryModel, BatteryPack
from sim.rover.camera import PictureSettings
from sim.rover.faults import SimulatedFault
from sim.rover.jackal import SimulatedJackal
from sim.rover.world import World as Ground
from tests.simulated.world import World

REST_S: Final = 9.0
"""Maximum time between two ticks of an executive that rests."""
_AWAKE_S: Final = 2.0
"""For which physics goes on after the last command that moves."""
_STEP_S: Final = 0.005
_SCAN_EVERY_S: Final = 9.0
"""How often a standing rover reports the scan of its surroundings."""
_TRACK_M: Final = 0.05
"""Least distance between two noted poses."""
_RAD: Final = 0.01
"""Least turn of the camera that counts as one."""


@dataclass(frozen=True, slots=True)
class TakenPicture:
    """A picture that the camera gave, with the true state at that time."""

    at_s: float
    pose: Pose
    angles: CameraAngles
    checksum: int


class _Jackal(SimulatedJackal):
    """Notes each command after which something moves."""

    woken = True

    def drive(self, velocity: Velocity) -> None:
        self.woken = self.woken or velocity != STANDING
        super().drive(velocity)

    def point_camera(self, wanted: CameraIntent) -> None:
        at = self.camera_angles
        moves = max(abs(wanted.pan_rad - at.pan_rad), abs(wanted.tilt_rad - at.tilt_rad)) > _RAD
        self.woken = self.woken or moves
        super().point_camera(wanted)

    def request_frame(self) -> None:
        self.woken = True
        super().request_frame()


class RestingJackal:
    """A Jackal in MuJoCo whose clock stands while it does; a `Below`.

    While it rests, its last measurements are reported again with the present time. Its battery is
    modelled here: it is charged, and has a load, of so many W at each time.

    Attributes:
        pictures: those that the camera gave.
        track: true poses with times, each at least `_TRACK_M` from the one before.
        charge: times with the charge ratio, one a minute.
        lowest_charge: the least charge ratio so far.
        moved_s: duration for which physics passed.
        rest_s: time between two ticks of an executive that rests, at most `REST_S`.
    """

    rest_s: float = REST_S
    downlinks: Sequence[Downlink] = ()

    def __init__(
        self,
        world: World,
        ground: Ground,
        settings: Settings,
        seed: int,
        power_w: Callable[[float, Pose], float],
    ) -> None:
        camera = settings.camera
        picture = PictureSettings(camera.width_px, camera.height_px)
        self.rover = _Jackal(ground, seed, None, picture, settings.sensors, settings.mux)
        self.pictures: list[TakenPicture] = []
        self.track: list[tuple[float, Pose]] = [(0.0, self.rover.true_pose)]
        self.charge: list[tuple[float, float]] = []
        self.lowest_charge = ground.charge_ratio
        self.moved_s = 0.0
        self._world, self._power_w = world, power_w
        self._pack = BatteryPack()
        self._left_j = self._pack.capacity_j * ground.charge_ratio
        self._used_j = self.rover.energy_j
        self._at_s = self._awake_until_s = self._scanned_s = 0.0
        self._odometry: Odometry | None = None
        self._scan: LaserScan | None = None
        self._triggers: list[tuple[Callable[[Pose], bool], Callable[[], None]]] = []

    def begin(self, last_sequence: int) -> None:
        """Do nothing: what nobody received is lost."""

    def when(self, reached: Callable[[Pose], bool], act: Callable[[], None]) -> None:
        """Do something once, as soon as the true pose meets a condition."""
        self._triggers.append((reached, act))

    def inject(self, fault: SimulatedFault, duration_s: float) -> None:
        """Inject a fault, and clear it after a time."""
        self.rover.inject(fault)
        self._world.after(duration_s, self.rover.clear, type(fault))

    def sense(self, now_s: float) -> Iterable[Fact]:
        """Let the physics follow if anything moves, and return the measurements."""
        rover, step_s = self.rover, now_s - self._at_s
        if rover.woken:
            rover.woken, self._awake_until_s = False, now_s + _AWAKE_S
        measured: list[Fact] = []
        if self._at_s <= self._awake_until_s:
            moved_s = round(min(step_s, REST_S) / _STEP_S) * _STEP_S
            rover.advance(moved_s)
            self.moved_s += moved_s
            measured = rover.facts()
        self._at_s = now_s
        self._live(now_s, step_s)
        facts = [self._stamped(fact, now_s) for fact in measured]
        if not any(isinstance(fact, Odometry) for fact in facts):
            facts += self._repeated(now_s)
        facts += Battery(self._voltage_v(), self._ratio), rover.camera_angles
        return facts

    def _live(self, now_s: float, step_s: float) -> None:
        """Change the charge, and note the truth."""
        rover = self.rover
        used_j, self._used_j = rover.energy_j - self._used_j, rover.energy_j
        pose = rover.true_pose
        gained_j = self._power_w(now_s, pose) * step_s - used_j
        capacity_j = self._pack.capacity_j
        self._left_j = min(max(self._left_j + gained_j, 0.0), capacity_j)
        self.lowest_charge = min(self.lowest_charge, self._ratio)
        if not self.charge or now_s - self.charge[-1][0] >= 60.0:
            self.charge.append((now_s, self._ratio))
        if pose.point.distance_m(self.track[-1][1].point) >= _TRACK_M:
            self.track.append((now_s, pose))
            for each in [each for each in self._triggers if each[0](pose)]:
                self._triggers.remove(each)
                each[1]()

    def pose_at(self, at_s: float) -> Pose:
        """Return the true pose at a time."""
        return next(pose for since_s, pose in reversed(self.track) if since_s <= at_s)

    def charge_at(self, at_s: float) -> float:
        """Return the charge ratio at a time."""
        return next(ratio for since_s, ratio in reversed(self.charge) if since_s <= at_s)

    @property
    def _ratio(self) -> float:
        return self._left_j / self._pack.capacity_j

    def _voltage_v(self) -> float:
        return BatteryModel(self._pack, self._ratio).voltage_v()

    def _stamped(self, fact: Fact, now_s: float) -> Fact:
        """Return a fact of the physics with its time in the world."""
        if not isinstance(fact, Odometry | Imu | Joints | LaserScan | Frame):
            return fact
        fact = replace(fact, stamp_s=fact.stamp_s + now_s - self.rover.time_s)
        match fact:
            case Odometry():
                self._odometry = fact
            case LaserScan():
                self._scan = fact
            case Frame(data=data):
                pose, angles = self.rover.true_pose, self.rover.camera_angles
                self.pictures.append(TakenPicture(now_s, pose, angles, crc32(data)))
            case _:
                pass
        return fact

    def _repeated(self, now_s: float) -> list[Fact]:
        """Return the last measurements, as those of a rover that stands."""
        found: list[Fact] = []
        if self._odometry is not None:
            found.append(replace(self._odometry, stamp_s=now_s))
        if self._scan is not None and now_s - self._scanned_s >= _SCAN_EVERY_S:
            self._scanned_s = now_s
            found.append(replace(self._scan, stamp_s=now_s))
        return found
