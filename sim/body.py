"""The body of a simulated rover: physics in steps, what is true of it, and its pictures.

Physics runs at `step_s`; every 20 ms the rover's own controllers act and its sensors are read.
"""

from abc import ABC, abstractmethod
from math import asin, atan2, cos, sin
from typing import Final

import mujoco

from executive.facts import CameraAngles, Fact, Frame
from executive.geometry import Pose, Velocity
from sim.battery import BatteryModel, Pack
from sim.camera import Camera, PictureSettings
from sim.cargo import set_cargo
from sim.faults import Fault
from sim.model import Chassis, build_model
from sim.world import World

PERIOD_S: Final = 0.02
_SETTLING_S: Final = 0.5
_FREE: Final = 7
"""Figures of the free joint: the joints of the wheels and of the head follow."""


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


class SimulatedBody(ABC):
    """A rover in a world. What it senses and how it is moved is for its kind.

    Attributes:
        world: where it drives.
        model, data: of MuJoCo.
    """

    def __init__(
        self,
        chassis: Chassis,
        pack: Pack,
        world: World,
        step_s: float,
        picture: PictureSettings | None,
    ) -> None:
        """Put the rover on the ground at the world's start and let it settle.

        Raises:
            ValueError: if the step does not divide 20 ms.
        """
        steps = round(PERIOD_S / step_s)
        if steps < 1 or abs(steps * step_s - PERIOD_S) > 1e-9:
            raise ValueError(f"a step of {step_s} s does not divide {PERIOD_S} s")
        self.world = world
        self.model = build_model(world, step_s, chassis)
        self.data = mujoco.MjData(self.model)
        self._qpos, self._qvel = self.data.qpos, self.data.qvel
        self._ctrl, self._force = self.data.ctrl, self.data.actuator_force
        mujoco.mj_step(self.model, self.data, round(_SETTLING_S / step_s))

        self._step_s = step_s
        self._steps_per_period = steps
        self._steps = 0
        self._wheels = slice(_FREE, _FREE + chassis.wheels)
        self._head = slice(_FREE + chassis.wheels, _FREE + chassis.wheels + 2)
        self._pose = self.true_pose
        self._wheels_rad = self._qpos[self._wheels].tolist()
        self._pack = pack
        self._battery = BatteryModel(pack, world.charge_ratio)
        self._camera = Camera(self.model, picture or PictureSettings())
        self._frame_wanted = False
        self._faults: set[Fault] = set()
        self._due: list[Fact] = []

    def request_frame(self) -> None:
        """Ask for a picture; the next `facts` takes it."""
        self._frame_wanted = True

    def step(self) -> None:
        """Advance by one physics step."""
        self._advance_steps(1)

    def advance(self, duration_s: float) -> None:
        """Advance by a duration, a whole number of steps; quicker than step by step."""
        self._advance_steps(round(duration_s / self._step_s))

    def facts(self) -> list[Fact]:
        """Return what the sensors have published since the last call, oldest first.

        A picture that was asked for is taken here, of the present state.
        """
        due, self._due = self._due, []
        if self._frame_wanted:
            self._frame_wanted = False
            if Fault.CAMERA_DEAD not in self._faults:
                due.append(self.take_picture())
        return due

    def take_picture(self) -> Frame:
        """Render what the camera sees now. Costs milliseconds; physics does not wait for it."""
        return Frame(self.time_s, "JPG", self._camera.jpeg(self.data))

    def load(self, mass_kg: float) -> None:
        """Carry so much from now on, in place of what was carried; 0 is nothing.

        Raises:
            ValueError: it is no mass, or more than 50 kg.
        """
        set_cargo(self.model, mass_kg)

    def inject(self, fault: Fault) -> None:
        """Switch a fault on."""
        self._faults.add(fault)

    def clear(self, fault: Fault) -> None:
        """Switch a fault off."""
        self._faults.discard(fault)

    @property
    def time_s(self) -> float:
        """Simulated time since the start."""
        return self._steps * self._step_s

    @property
    def true_pose(self) -> Pose:
        """Where base_link really is, in the world's frame."""
        return _pose(self._qpos[:_FREE].tolist())

    @property
    def true_velocity(self) -> Velocity:
        """How fast base_link really moves ahead, and turns."""
        heading_rad = self.true_pose.heading_rad
        x_mps, y_mps = self._qvel[:2].tolist()
        return Velocity(x_mps * cos(heading_rad) + y_mps * sin(heading_rad), float(self._qvel[5]))

    @property
    def camera_angles(self) -> CameraAngles:
        """Where the camera really points."""
        pan_rad, tilt_rad = self._qpos[self._head].tolist()
        return CameraAngles(pan_rad, tilt_rad)

    @property
    def energy_j(self) -> float:
        """What has been drawn from the battery since the start."""
        return self._battery.used_j

    @abstractmethod
    def _sense(self, before: Pose, turned_rad: list[float]) -> None:
        """Read the sensors at the end of a period.

        Args:
            before: the true pose at its beginning; the present one is `_pose`.
            turned_rad: what each wheel has turned in it.
        """

    @abstractmethod
    def _actuate(self) -> None:
        """Give motors and head their set points for the next period."""

    def _voltage_v(self) -> float:
        """Return what a voltmeter shows, under the mean load since the last call."""
        voltage_v = self._battery.voltage_v()
        return self._pack.fault_v if Fault.BATTERY_LOW in self._faults else voltage_v

    def _advance_steps(self, count: int) -> None:
        """Run steps, stopping at every 20 ms for sensors and controllers."""
        per_period = self._steps_per_period
        while count > 0:
            run = min(count, per_period - self._steps % per_period)
            mujoco.mj_step(self.model, self.data, run)
            self._steps += run
            count -= run
            if self._steps % per_period == 0:
                self._end_period()

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
        self._sense(before, turned_rad)
        self._actuate()
