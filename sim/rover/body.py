"""`SimulatedBody`, base of simulated rovers: stepped physics, ground truth, battery, pictures.

Physics runs in steps of 5 ms; every 20 ms the rover's own controllers act, its sensors are read.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from math import asin, atan2, cos, isfinite, nan, sin
from typing import Final, TypeVar

import mujoco
import numpy as np

from executive.values.facts import CameraAngles, Fact, Frame
from executive.values.geometry import Pose, Velocity
from sim.checkpoint import Checkpointed, changing
from sim.rover import faults
from sim.rover.camera import Camera, PictureSettings
from sim.rover.disturbance import Disturbance
from sim.rover.faults import Part, SimulatedFault
from sim.rover.model import Chassis, build_model
from sim.rover.world import World

F = TypeVar("F", bound=SimulatedFault)


_CELL_CURVE: Final = ((0.0, 3.00), (0.05, 3.35), (0.2, 3.55), (0.5, 3.70), (0.8, 3.97), (1.0, 4.16))
"""Open-circuit voltage of a lithium-ion cell over its charge ratio."""


@dataclass(frozen=True, slots=True)
class BatteryPack:
    """A pack of lithium-ion cells, and its load. A Jackal's has seven in series, 270 Wh.

    Attributes:
        cells: number in series.
        capacity_j: energy when full.
        resistance_ohm: resistance of cells, fuse and leads.
        idle_w: power of computer, radio and camera.
        efficiency: mechanical power of the motors per electrical power.
        heat_w_per_nm2: heat of a wheel's motor at a torque of 1 N m.
        fault_v: measured voltage under the fault `BatteryLow`.
    """

    cells: int = 7
    capacity_j: float = 270 * 3600.0
    resistance_ohm: float = 0.12
    idle_w: float = 30.0
    efficiency: float = 0.7
    heat_w_per_nm2: float = 1.0
    fault_v: float = 21.5


class BatteryModel(Checkpointed):
    """Charge that decreases with the load, and the resulting voltage."""

    CHANGES = changing(_left_j=float, _load_j=float, _load_s=float, used_j=float)

    def __init__(self, pack: BatteryPack, charge_ratio: float, sun_w: float = 0.0) -> None:
        self._pack, self._sun_w = pack, sun_w
        self._left_j = pack.capacity_j * charge_ratio
        self._load_j = 0.0
        self._load_s = 0.0
        self.used_j = 0.0

    def draw(self, mechanical_j: float, period_s: float) -> None:
        """Consume the energy of a period, the motors' work and the idle load, and charge."""
        pack = self._pack
        energy_j = mechanical_j / pack.efficiency + pack.idle_w * period_s
        self.used_j += energy_j
        left_j = self._left_j - energy_j + self._sun_w * period_s
        self._left_j = min(max(0.0, left_j), pack.capacity_j)
        self._load_j += energy_j
        self._load_s += period_s

    def drain(self, charge_ratio: float) -> None:
        """Reduce the charge to a ratio of 0 to 1, if it is above."""
        self._left_j = min(self._left_j, self._pack.capacity_j * charge_ratio)

    def set_charge(self, charge_ratio: float) -> None:
        """Set the charge to a ratio of 0 to 1."""
        self._left_j = self._pack.capacity_j * charge_ratio

    @property
    def charge_ratio(self) -> float:
        """Remaining charge as a ratio of the capacity."""
        return self._left_j / self._pack.capacity_j

    def voltage_v(self) -> float:
        """Return the voltage at the terminals under the mean load since the last call."""
        pack = self._pack
        power_w = self._load_j / self._load_s if self._load_s else pack.idle_w
        self._load_j = self._load_s = 0.0
        open_v = pack.cells * _cell_v(self._left_j / pack.capacity_j)
        return open_v - pack.resistance_ohm * power_w / open_v


def _cell_v(charge_ratio: float) -> float:
    """Return the voltage of a cell without load at a charge of 0 to 1."""
    for (low, low_v), (high, high_v) in pairwise(_CELL_CURVE):
        if charge_ratio <= high:
            part = (charge_ratio - low) / (high - low)
            return low_v + part * (high_v - low_v)
    return _CELL_CURVE[-1][1]


MAX_CARGO_KG: Final = 50.0
_BLOCK: Final = "cargo"
_SEEN: Final = 1
_UNSEEN: Final = 5
"""Groups of geoms; pictures show the first three."""

PERIOD_S: Final = 0.02
STEP_S: Final = 0.005
STEPS_PER_PERIOD: Final = 4
SOON_S: Final = STEP_S / 2
"""Tolerance of due times: they are sums of steps."""
_SETTLING_S: Final = 0.5
_FREE: Final = 7
"""Number of position values of the free joint; the joints of wheels and head follow."""


_RESTING_MPS: Final = 0.002
_RESTING_RADPS: Final = 0.02
"""Maximum speeds of a resting rover, and of its wheels: on hills it creeps at 0.001 m/s."""
CUT_OCTETS: Final = 200
"""Octets of a JPEG that `CameraTruncated` leaves."""


@dataclass(frozen=True, slots=True)
class CameraView:
    """State that the camera renders.

    Attributes:
        octets: number of octets of the JPEG that arrive; None for all.
    """

    data: mujoco.MjData
    time_s: float
    octets: int | None = None


def offset_left(pose: Pose, distance_m: float) -> Pose:
    """Return a pose moved by a distance to the left, with the same heading."""
    x_m, y_m = -distance_m * sin(pose.heading_rad), distance_m * cos(pose.heading_rad)
    return replace(pose, x_m=pose.x_m + x_m, y_m=pose.y_m + y_m)


def _pose(qpos: list[float]) -> Pose:
    """Return the pose of a free joint's position and quaternion."""
    x_m, y_m, z_m, w, x, y, z = qpos
    return Pose(
        x_m,
        y_m,
        z_m,
        heading_rad=atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
        roll_rad=atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
        pitch_rad=asin(max(-1.0, min(1.0, 2 * (w * y - x * z)))),
    )


def _obstacles(model: mujoco.MjModel) -> frozenset[int]:
    """Return the geoms of rocks, walls and steps that collide."""
    return frozenset(
        geom
        for geom in range(model.ngeom)
        if model.geom(geom).name.startswith(("rock", "feature"))
        and model.geom_contype[geom] | model.geom_conaffinity[geom]
    )


_STATE: Final = mujoco.mjtState.mjSTATE_INTEGRATION


class SimulatedBody(Checkpointed, ABC):
    """A rover in a world. Subclasses define sensors and actuators.

    Attributes:
        parts: parts that faults can act on.
        world: its world.
        model, data: of MuJoCo.
        contacts: number of contacts with a rock, a wall or a step that have begun.
    """

    CHANGES = changing(
        cargo_kg=float,
        _physics=list[float],
        _steps=int,
        _pose=Pose,
        _wheels_rad=list[float],
        _battery=Checkpointed,
        _frame_wanted=bool,
        _active=tuple[faults.AnyFault, ...],
        _disturbance=Checkpointed,
        _stale=tuple[float, list[float]] | None,
        _stuck_head=CameraAngles | None,
        _touching=bool,
        contacts=int,
        _due=list[Fact],
    )

    def __init__(
        self,
        chassis: Chassis,
        pack: BatteryPack,
        world: World,
        picture: PictureSettings | None,
        parts: frozenset[Part],
    ) -> None:
        """Put the rover on the ground at the world's start and let it settle."""
        self.world = world
        self.parts = parts
        self.model = build_model(world, STEP_S, chassis)
        self.data = mujoco.MjData(self.model)
        self._qpos, self._qvel = self.data.qpos, self.data.qvel
        self._ctrl, self._force = self.data.ctrl, self.data.actuator_force
        self._disturbance = Disturbance(self.model, self.data, chassis, world)
        mujoco.mj_step(self.model, self.data, round(_SETTLING_S / STEP_S))

        self._steps = 0
        self._read_every = STEPS_PER_PERIOD
        self._read_sensors: Callable[[int], list[Fact]] = lambda _: []
        self._wheels = slice(_FREE, _FREE + chassis.wheels)
        self._head = slice(_FREE + chassis.wheels, _FREE + chassis.wheels + 2)
        self._pose = self.true_pose
        self._wheels_rad = self._qpos[self._wheels].tolist()
        self._pack = pack
        self._battery = BatteryModel(pack, world.charge_ratio, world.sun_w)
        self._camera = Camera(self.model, picture or PictureSettings())
        self._frame_wanted = False
        self._faults: dict[type[SimulatedFault], SimulatedFault] = {}
        self._stale: tuple[float, list[float]] | None = None
        """Time and joint positions of the stale view."""
        self._stuck_head: CameraAngles | None = None
        self._obstacles = _obstacles(self.model)
        self._touching = False
        self.contacts = 0
        self._due: list[Fact] = []

    def request_frame(self) -> None:
        """Request a picture; the next call of `facts` takes it."""
        self._frame_wanted = True

    def advance(self, duration_s: float) -> None:
        """Advance by a duration, a whole number of steps, and every 20 ms sense and actuate."""
        count = round(duration_s / STEP_S)
        while count > 0:
            run = min(count, self._read_every - self._steps % self._read_every)
            mujoco.mj_step(self.model, self.data, run)
            self._steps += run
            count -= run
            if self._steps % self._read_every == 0:
                self._due += self._read_sensors(self._steps)
            if self._steps % STEPS_PER_PERIOD == 0:
                self._end_period()

    @property
    def resting(self) -> bool:
        """Whether nothing moves, and no fault is active that misleads a motion."""
        speeds = abs(self._qvel)
        moves = speeds[:3].max() > _RESTING_MPS or speeds[3:].max() > _RESTING_RADPS
        onsets = (faults.fault_declaration(kind).onset for kind in self._faults)
        return not moves and all(onset is faults.Onset.NONE for onset in onsets)

    def skip(self, duration_s: float) -> None:
        """Let time pass for a resting rover: its battery continues, not physics and sensors."""
        self._steps += round(duration_s / STEP_S)
        wheels = self._wheels.stop - self._wheels.start
        torque2 = sum(torque * torque for torque in self._force[:wheels].tolist())
        self._battery.draw(self._pack.heat_w_per_nm2 * torque2 * duration_s, duration_s)

    def facts(self) -> list[Fact]:
        """Return the facts published since the last call, in order.

        A requested picture is taken here, of the present state.
        """
        due, self._due = self._due, []
        if self._frame_wanted:
            self._frame_wanted = False
            view = self.view
            if view is not None:
                jpeg = self._camera.jpeg(view.data)
                due.append(Frame(view.time_s, "JPG", jpeg[: view.octets]))
        return due

    @property
    def view(self) -> CameraView | None:
        """State that the camera renders under its faults; None if it is dead."""
        if faults.CameraDead in self._faults:
            return None
        view = CameraView(self.data, self.time_s)
        if self._stale is not None:
            data = mujoco.MjData(self.model)
            time_s, data.qpos[:] = self._stale
            mujoco.mj_forward(self.model, data)
            view = CameraView(data, time_s)
        return replace(view, octets=CUT_OCTETS) if faults.CameraTruncated in self._faults else view

    def set_cargo_mass(self, mass_kg: float) -> None:
        """Set the cargo, evenly distributed; it replaces the previous one, 0 is none.

        Raises:
            ValueError: it is no mass, or more than 50 kg.
        """
        if not (isfinite(mass_kg) and 0 <= mass_kg <= MAX_CARGO_KG):
            raise ValueError(f"a cargo of {mass_kg:g} kg is not in 0 .. {MAX_CARGO_KG:g} kg")
        body, geom = self.model.body(_BLOCK), self.model.geom(_BLOCK)
        x2, y2, z2 = (half_m * half_m for half_m in geom.size)
        body.mass[:] = mass_kg
        body.inertia[:] = [mass_kg / 3 * each for each in (y2 + z2, x2 + z2, x2 + y2)]
        geom.group[:] = _SEEN if mass_kg else _UNSEEN
        mujoco.mj_setConst(self.model, mujoco.MjData(self.model))

    def inject(self, fault: SimulatedFault) -> None:
        """Inject a fault; it replaces an active one of its kind.

        Raises:
            ValueError: this rover cannot have it; the text names the missing part.
        """
        why = faults.unsupported_reason(type(fault), self.parts)
        if why is not None:
            raise ValueError(why)
        self._faults[type(fault)] = fault
        match fault:
            case faults.CameraStale():
                self._stale = self.time_s, self._qpos.tolist()
            case faults.BatteryDrained(charge):
                self._battery.drain(charge)
            case faults.HeadStuck():
                self._stuck_head = self.camera_angles
            case faults.Pushed(by_m):
                self._disturbance.push(offset_left(self.true_pose, by_m))
            case faults.Tip(by_rad):
                self._disturbance.tip(by_rad)
            case _:
                self._disturb()

    def clear(self, kind: type[SimulatedFault]) -> None:
        """Clear a fault, if it is active."""
        if self._faults.pop(kind, None) is None:
            return
        if kind is faults.CameraStale:
            self._stale = None
        elif kind is faults.HeadStuck:
            self._stuck_head = None
        elif kind is faults.Tip:
            self._disturbance.set_upright(self.true_pose)
        else:
            self._disturb()

    @property
    def cargo_kg(self) -> float:
        """Mass of the cargo."""
        return float(self.model.body(_BLOCK).mass[0])

    @cargo_kg.setter
    def cargo_kg(self, mass_kg: float) -> None:
        if mass_kg != self.cargo_kg:
            self.set_cargo_mass(mass_kg)

    @property
    def _physics(self) -> list[float]:
        """State of MuJoCo between two steps, and the forces of the motors in the last one."""
        state = np.empty(mujoco.mj_stateSize(self.model, _STATE))
        mujoco.mj_getState(self.model, self.data, state, _STATE)
        return [*state.tolist(), *self._force.tolist()]

    @_physics.setter
    def _physics(self, values: list[float]) -> None:
        state = np.array(values[: -len(self._force)])
        mujoco.mj_setState(self.model, self.data, state, _STATE)
        mujoco.mj_forward(self.model, self.data)
        mujoco.mj_setState(self.model, self.data, state, _STATE)
        self._force[:] = values[-len(self._force) :]

    @property
    def _active(self) -> tuple[SimulatedFault, ...]:
        return tuple(self._faults.values())

    @_active.setter
    def _active(self, active: tuple[SimulatedFault, ...]) -> None:
        self._faults = {type(each): each for each in active}
        self._disturb()

    @property
    def time_s(self) -> float:
        """Simulated time since the start."""
        return self._steps * STEP_S

    @property
    def true_pose(self) -> Pose:
        """True pose of base_link, in the world's frame."""
        return _pose(self._qpos[:_FREE].tolist())

    @property
    def true_velocity(self) -> Velocity:
        """True forward velocity and rotation rate of base_link."""
        heading_rad = self.true_pose.heading_rad
        x_mps, y_mps = self._qvel[:2].tolist()
        return Velocity(x_mps * cos(heading_rad) + y_mps * sin(heading_rad), float(self._qvel[5]))

    @property
    def camera_angles(self) -> CameraAngles:
        """True angles of the camera."""
        pan_rad, tilt_rad = self._qpos[self._head].tolist()
        return CameraAngles(pan_rad, tilt_rad)

    @property
    def energy_j(self) -> float:
        """Energy drawn from the battery since the start."""
        return self._battery.used_j

    @abstractmethod
    def _sense(self, before: Pose, turned_rad: list[float]) -> None:
        """Read the sensors at the end of a period.

        Args:
            before: the true pose at its beginning; the present one is `_pose`.
            turned_rad: rotation of each wheel in it.
        """

    @abstractmethod
    def _actuate(self) -> None:
        """Set the set points of motors and head for the next period."""

    def fault(self, kind: type[F]) -> F | None:
        """Return the active fault of a kind, or None."""
        found = self._faults.get(kind)
        return found if isinstance(found, kind) else None

    def _disturb(self) -> None:
        """Apply the torque and friction that the faults leave to motors and ground."""
        brownout, dead = self.fault(faults.Brownout), self.fault(faults.MotorDead)
        torque_ratio = 1.0 if brownout is None else brownout.factor
        self._disturbance.limit_torque(
            0.0 if dead is not None and dead.side.left else torque_ratio,
            0.0 if dead is not None and dead.side.right else torque_ratio,
        )
        low_friction = self.fault(faults.LowFriction)
        self._disturbance.limit_grip(1.0 if low_friction is None else low_friction.factor)

    def _unstuck(self, left_radps: float, right_radps: float) -> tuple[float, float]:
        """Return the speeds of left and right wheels, 0 for stuck ones."""
        stuck = self._faults
        if not stuck:
            return left_radps, right_radps
        left = faults.LeftWheelsStuck in stuck or faults.WheelsStuck in stuck
        right = faults.RightWheelsStuck in stuck or faults.WheelsStuck in stuck
        return 0.0 if left else left_radps, 0.0 if right else right_radps

    def _head_rad(self, pan_rad: float, tilt_rad: float) -> tuple[float, float]:
        """Return the set points of the camera's head; its present angles if it is stuck."""
        stuck = self._stuck_head
        return (pan_rad, tilt_rad) if stuck is None else (stuck.pan_rad, stuck.tilt_rad)

    def counted(self, turned_rad: list[float], shared: bool = False) -> list[float]:
        """Return the encoder counts for wheel rotations; even indices are left wheels.

        With `shared`, as in messages of the wheels, only shared encoder faults apply.
        """
        dead, scale = self.fault(faults.EncoderDead), self.fault(faults.EncoderScale)
        if dead is not None and (dead.shared or not shared):
            counts = (not dead.side.left, not dead.side.right)
            turned_rad = [turned * counts[at % 2] for at, turned in enumerate(turned_rad)]
        if scale is not None and (scale.shared or not shared):
            turned_rad = [turned * scale.factor for turned in turned_rad]
        return turned_rad

    def _voltage_v(self) -> float:
        """Return the measured voltage, under the mean load since the last call."""
        voltage_v = self._battery.voltage_v()
        if faults.BatteryNan in self._faults:
            return nan
        return self._pack.fault_v if faults.BatteryLow in self._faults else voltage_v

    def _count_contacts(self) -> None:
        """Count a contact if the rover begins to touch a rock, a wall or a step."""
        if not self._obstacles:
            return
        pairs = self.data.contact.geom[: self.data.ncon].ravel().tolist()
        touching = not self._obstacles.isdisjoint(pairs)
        self.contacts += touching and not self._touching
        self._touching = touching

    def _end_period(self) -> None:
        before, self._pose = self._pose, self.true_pose
        wheels_rad = self._qpos[self._wheels].tolist()
        turned_rad = [now - then for now, then in zip(wheels_rad, self._wheels_rad, strict=True)]
        self._wheels_rad = wheels_rad
        torques_nm = self._force[: len(wheels_rad)].tolist()
        heat_w_per_nm2 = self._pack.heat_w_per_nm2
        work_j = sum(
            max(0.0, torque * angle) + heat_w_per_nm2 * torque * torque * PERIOD_S
            for torque, angle in zip(torques_nm, turned_rad, strict=True)
        )
        self._battery.draw(work_j, PERIOD_S)
        self._disturbance.follow_patches()
        self._count_contacts()
        self._sense(before, turned_rad)
        self._actuate()
