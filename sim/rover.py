"""A simulated Jackal that stands where a real one would: behind the port `VelocityRover`."""

from dataclasses import replace
from math import cos, isfinite, sin

import numpy as np

from executive.facts import Battery, Odometry
from executive.geometry import Pose, Velocity, wrap_rad
from executive.ports import CameraIntent
from sim.base import WHEEL_RADIUS_M, BaseController, BaseLimits
from sim.battery import Pack
from sim.body import PERIOD_S, SimulatedBody
from sim.camera import PictureSettings
from sim.faults import JUMP_M, Fault
from sim.head import HeadController, HeadLimits
from sim.model import JACKAL
from sim.odometry import OdometrySettings, WheelOdometry
from sim.world import World

_ANGLES_EVERY = 5
_BATTERY_EVERY = 50


class SimulatedRover(SimulatedBody):
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
        super().__init__(JACKAL, Pack(), world, step_s, picture)
        random = np.random.default_rng(seed)
        self._odometry = WheelOdometry(odometry or OdometrySettings(), self._pose, random)
        self._base = BaseController(BaseLimits())
        self._servos = HeadController(HeadLimits())
        self._measured: Odometry | None = None
        self._published: Odometry | None = None
        self._actuate()

    def drive(self, velocity: Velocity) -> None:
        """Command a velocity, as cmd_vel does; it times out after 0.25 s.

        Raises:
            ValueError: if a figure is not finite.
        """
        if not velocity.finite:
            raise ValueError(f"{velocity} is no velocity")
        self._base.command(velocity, self.time_s)

    def point_camera(self, wanted: CameraIntent) -> None:
        """Command the camera's angles and greatest speed, cut to what the head can do.

        Raises:
            ValueError: if a figure is not finite.
        """
        if not all(map(isfinite, (wanted.pan_rad, wanted.tilt_rad, wanted.speed_radps))):
            raise ValueError(f"{wanted} cannot be done")
        self._servos.set_speed(wanted.speed_radps)
        self._servos.point(wanted.pan_rad, wanted.tilt_rad)

    def inject(self, fault: Fault) -> None:
        """Switch a fault on."""
        super().inject(fault)
        if fault is Fault.ODOMETRY_JUMP:
            pose = self._odometry.pose
            self._odometry.pose = replace(
                pose,
                x_m=pose.x_m - JUMP_M * sin(pose.heading_rad),
                y_m=pose.y_m + JUMP_M * cos(pose.heading_rad),
            )

    @property
    def odometry_pose(self) -> Pose:
        """The newest pose of the odometry, before its latency and faults."""
        return self._odometry.pose

    def _sense(self, before: Pose, turned_rad: list[float]) -> None:
        """Read the sensors at the end of a period."""
        self._publish_odometry(
            self._odometry.advance(
                self.time_s,
                PERIOD_S,
                WHEEL_RADIUS_M * sum(turned_rad) / (4 * PERIOD_S),
                wrap_rad(self._pose.heading_rad - before.heading_rad) / PERIOD_S,
                self._pose,
            )
        )
        period = self._steps // self._steps_per_period
        if period % _ANGLES_EVERY == 1:
            self._due.append(self.camera_angles)
        if period % _BATTERY_EVERY == 1:
            self._due.append(Battery(self._voltage_v()))

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
        self._ctrl[:] = (left, right, left, right, *self._servos.setpoints_rad(PERIOD_S))
