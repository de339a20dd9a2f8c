"""A simulated Jackal that stands where a real one would: behind the port `Rover`.

Physics runs at `step_s`; every 20 ms the base's own controller acts and the sensors are read.
"""

from dataclasses import replace
from math import asin, atan2, cos, isfinite, sin

import mujoco
import numpy as np

from executive.facts import Battery, CameraAngles, Fact, Frame, Odometry
from executive.geometry import Pose, Velocity, wrap_rad
from sim.base import WHEEL_RADIUS_M, BaseController, BaseLimits
from sim.battery import BatteryModel, Pack
from sim.camera import Camera, PictureSettings
from sim.faults import JUMP_M, LOW_VOLTAGE_V, Fault
from sim.head import HeadController, HeadLimits
from sim.model import build_model
from sim.odometry import OdometrySettings, WheelOdometry
from sim.world import World

PERIOD_S = 0.02
_ANGLES_EVERY = 5
_BATTERY_EVERY = 50
_SETTLING_S = 0.5
_HEAT_W_PER_NM2 = 1.0
"""Power that a wheel's motor turns into heat at a torque of 1 N m."""


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


class SimulatedRover:
    """A Jackal in a world. The odometry frame is the world's frame."""

    def __init__(
        self,
        world: World,
        seed: int = 0,
        step_s: float = 0.005,
        odometry: OdometrySettings | None = None,
        picture: PictureSettings | None = None,
    ) -> None:
        """Put the rover on the ground at the world's start and let it settle.

        Args:
            world: where it drives.
            seed: of all sensor noise; the same seed and calls repeat bit for bit.
            step_s: physics step; divides 20 ms.
            odometry: how good the odometry is.
            picture: size, quality and backend of camera pictures.

        Raises:
            ValueError: if the step does not divide 20 ms.
        """
        steps = round(PERIOD_S / step_s)
        if steps < 1 or abs(steps * step_s - PERIOD_S) > 1e-9:
            raise ValueError(f"a step of {step_s} s does not divide {PERIOD_S} s")
        self.world = world
        self.model = build_model(world, step_s)
        self.data = mujoco.MjData(self.model)
        self._qpos, self._qvel = self.data.qpos, self.data.qvel
        self._ctrl, self._force = self.data.ctrl, self.data.actuator_force
        mujoco.mj_step(self.model, self.data, round(_SETTLING_S / step_s))

        self._step_s = step_s
        self._steps_per_period = steps
        self._steps = 0
        self._pose = _pose(self._qpos[:7].tolist())
        self._wheels_rad = self._qpos[7:11].tolist()
        random = np.random.default_rng(seed)
        self._odometry = WheelOdometry(odometry or OdometrySettings(), self._pose, random)
        self._battery = BatteryModel(Pack(), world.charge_ratio)
        self._base = BaseController(BaseLimits())
        self._head = HeadController(HeadLimits())
        self._camera = Camera(self.model, picture or PictureSettings())
        self._frame_wanted = False
        self._faults: set[Fault] = set()
        self._measured: Odometry | None = None
        self._published: Odometry | None = None
        self._due: list[Fact] = []
        self._actuate()

    def drive(self, velocity: Velocity) -> None:
        """Command a velocity, as cmd_vel does; it times out after 0.25 s.

        Raises:
            ValueError: if a figure is not finite.
        """
        if not velocity.finite:
            raise ValueError(f"{velocity} is no velocity")
        self._base.command(velocity, self.time_s)

    def point_camera(self, pan_rad: float, tilt_rad: float) -> None:
        """Command the camera's angles, cut to the reach of the head.

        Raises:
            ValueError: if an angle is not finite.
        """
        if not (isfinite(pan_rad) and isfinite(tilt_rad)):
            raise ValueError(f"{pan_rad}, {tilt_rad} are no angles")
        self._head.point(pan_rad, tilt_rad)

    def set_camera_speed(self, speed_radps: float) -> None:
        """Command the greatest angular speed of the head."""
        self._head.set_speed(speed_radps)

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

    def inject(self, fault: Fault) -> None:
        """Switch a fault on."""
        self._faults.add(fault)
        if fault is Fault.ODOMETRY_JUMP:
            pose = self._odometry.pose
            self._odometry.pose = replace(
                pose,
                x_m=pose.x_m - JUMP_M * sin(pose.heading_rad),
                y_m=pose.y_m + JUMP_M * cos(pose.heading_rad),
            )

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
        return _pose(self._qpos[:7].tolist())

    @property
    def true_velocity(self) -> Velocity:
        """How fast base_link really moves ahead, and turns."""
        heading_rad = self.true_pose.heading_rad
        x_mps, y_mps = self._qvel[:2].tolist()
        return Velocity(x_mps * cos(heading_rad) + y_mps * sin(heading_rad), float(self._qvel[5]))

    @property
    def odometry_pose(self) -> Pose:
        """The newest pose of the odometry, before its latency and faults."""
        return self._odometry.pose

    @property
    def camera_angles(self) -> CameraAngles:
        """Where the camera really points."""
        pan_rad, tilt_rad = self._qpos[11:13].tolist()
        return CameraAngles(pan_rad, tilt_rad)

    @property
    def energy_j(self) -> float:
        """What has been drawn from the battery since the start."""
        return self._battery.used_j

    def _advance_steps(self, count: int) -> None:
        """Run steps, stopping at every 20 ms for sensors and controllers."""
        per_period = self._steps_per_period
        while count > 0:
            run = min(count, per_period - self._steps % per_period)
            mujoco.mj_step(self.model, self.data, run)
            self._steps += run
            count -= run
            if self._steps % per_period == 0:
                self._sense()
                self._actuate()

    def _sense(self) -> None:
        """Read the sensors at the end of a period."""
        before = self._pose
        self._pose = _pose(self._qpos[:7].tolist())
        wheels_rad = self._qpos[7:11].tolist()
        turned_rad = [now - then for now, then in zip(wheels_rad, self._wheels_rad, strict=True)]
        self._wheels_rad = wheels_rad
        self._publish_odometry(
            self._odometry.advance(
                self.time_s,
                PERIOD_S,
                WHEEL_RADIUS_M * sum(turned_rad) / (4 * PERIOD_S),
                wrap_rad(self._pose.heading_rad - before.heading_rad) / PERIOD_S,
                self._pose,
            )
        )
        torques_nm = self._force[:4].tolist()
        work_j = sum(
            max(0.0, torque * angle) + _HEAT_W_PER_NM2 * torque * torque * PERIOD_S
            for torque, angle in zip(torques_nm, turned_rad, strict=True)
        )
        self._battery.draw(work_j, PERIOD_S)
        period = self._steps // self._steps_per_period
        if period % _ANGLES_EVERY == 1:
            self._due.append(self.camera_angles)
        if period % _BATTERY_EVERY == 1:
            voltage_v = self._battery.voltage_v()
            low = Fault.BATTERY_LOW in self._faults
            self._due.append(Battery(LOW_VOLTAGE_V if low else voltage_v))

    def _publish_odometry(self, measured: Odometry) -> None:
        """Publish what was measured a period ago, as the faults let it."""
        late, self._measured = self._measured, measured
        if late is None or Fault.ODOMETRY_LOST in self._faults:
            return
        if Fault.ODOMETRY_FROZEN in self._faults and self._published is not None:
            late = replace(self._published, stamp_s=late.stamp_s)
        self._published = late
        self._due.append(late)

    def _actuate(self) -> None:
        """Give motors and head their set points for the next period."""
        left, right = self._base.wheels_radps(self.time_s, PERIOD_S)
        left = 0.0 if Fault.LEFT_STUCK in self._faults else left
        right = 0.0 if Fault.RIGHT_STUCK in self._faults else right
        self._ctrl[:] = (left, right, left, right, *self._head.setpoints_rad(PERIOD_S))
