"""`Disturbance` of a simulated rover's body: reduced grip and torque, pushes, tipping.

Without a call, a run is changed only by the friction patches of its world.
"""

from itertools import product
from math import cos, pi, sin
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from executive.values.geometry import Pose
from sim.checkpoint import Checkpointed, changing
from sim.rover.model import Chassis
from sim.rover.world import World

_FREE: Final = 7
_GROUND: Final = np.array([1, 0, 0, 0, 0, 0], np.uint8)
"""Groups of geoms of the ground: the rover has none in them."""
_SKY_M: Final = 100.0
_DROP_M: Final = 0.02


class Disturbance(Checkpointed):
    """Acts on one rover in one world, between two steps."""

    CHANGES = changing(wheel_frictions=list[float])

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, chassis: Chassis, world: World
    ) -> None:
        self._model, self._data = model, data
        self._chassis = chassis
        self._world = world
        self._torques_nm = model.actuator_forcerange[: chassis.wheels].copy()
        soil = model.body("terrain").id
        self._soil: NDArray[np.intp] = np.flatnonzero(model.geom_bodyid == soil)
        self._frictions = model.geom_friction[self._soil, 0].copy()
        self._grip_ratio = 1.0
        self._wheels: NDArray[np.intp] = np.flatnonzero(
            (model.geom_type == mujoco.mjtGeom.mjGEOM_ELLIPSOID) & (model.geom_contype == 1)
        )
        if world.patches:
            self._give_wheels_their_own_friction()

    def limit_torque(self, left_ratio: float, right_ratio: float) -> None:
        """Reduce the torque of the motors of each side to a ratio."""
        ratios = np.resize((left_ratio, right_ratio), self._chassis.wheels)
        self._model.actuator_forcerange[: self._chassis.wheels] = ratios[:, None] * self._torques_nm

    def limit_grip(self, ratio: float) -> None:
        """Reduce the friction of the ground to a ratio."""
        self._grip_ratio = ratio
        self._model.geom_friction[self._soil, 0] = ratio * self._frictions
        self.follow_patches()

    def follow_patches(self) -> None:
        """Set each wheel's friction to that of the ground below it, if there are patches."""
        if not self._world.patches:
            return
        soil = self._data.body("terrain")
        positions_m = self._data.geom_xpos[self._wheels] @ soil.xmat.reshape(3, 3)
        frictions = np.full(len(self._wheels), self._world.friction)
        for patch in self._world.patches:
            frictions[patch.within_m(positions_m[:, 0], positions_m[:, 1]) >= 0] = patch.friction
        self._model.geom_friction[self._wheels, 0] = self._grip_ratio * frictions

    @property
    def wheel_frictions(self) -> list[float]:
        """Friction of the ground below each wheel, if there are patches."""
        frictions: list[float] = self._model.geom_friction[self._wheels, 0].tolist()
        return frictions if self._world.patches else []

    @wheel_frictions.setter
    def wheel_frictions(self, frictions: list[float]) -> None:
        if self._world.patches:
            self._model.geom_friction[self._wheels, 0] = frictions

    def _give_wheels_their_own_friction(self) -> None:
        """Give contacts of wheels the parameters of the ground, except the friction."""
        model, plain = self._model, self._model.geom("plain")
        model.geom_priority[self._wheels] = plain.priority + 1
        model.geom_condim[self._wheels] = plain.condim
        model.geom_solimp[self._wheels] = plain.solimp
        model.geom_solref[self._wheels] = plain.solref
        model.geom_friction[self._wheels] = plain.friction
        mujoco.mj_kinematics(model, self._data)
        self.follow_patches()

    def push(self, there: Pose) -> None:
        """Move the rover at once, at the same height over the ground; its velocity is unchanged."""
        qpos = self._data.qpos
        x_m, y_m = qpos[:2].tolist()
        qpos[2] += self._ground_m(there.x_m, there.y_m) - self._ground_m(x_m, y_m)
        qpos[:2] = there.x_m, there.y_m

    def tip(self, angle_rad: float) -> None:
        """Rotate the rover to the right at once, clear of the ground; it then falls."""
        reach_m = self._chassis.reach_m
        lift_m = reach_m * (sin(abs(angle_rad)) if abs(angle_rad) < pi / 2 else 1.0)
        turned, about_x = np.empty(4), np.array((cos(angle_rad / 2), sin(angle_rad / 2), 0.0, 0.0))
        mujoco.mju_mulQuat(turned, self._data.qpos[3:_FREE], about_x)
        self._set_state(turned, float(self._data.qpos[2]) + lift_m)

    def set_upright(self, pose: Pose) -> None:
        """Set the rover on its wheels at its present position and heading."""
        self.put(pose, _DROP_M)

    def put(self, pose: Pose, drop_m: float | None) -> None:
        """Put the rover at a pose, at rest: upright, this high above the ground; or exactly."""
        self._data.qpos[:2] = pose.x_m, pose.y_m
        if drop_m is None:
            x, y, z, w = pose.quaternion
            self._set_state(np.array((w, x, y, z)), pose.z_m)
            return
        upright = np.array((cos(pose.heading_rad / 2), 0.0, 0.0, sin(pose.heading_rad / 2)))
        height_m = self._ground_m(pose.x_m, pose.y_m) + self._chassis.base_height_m + drop_m
        self._set_state(upright, height_m)

    def _set_state(self, quaternion: NDArray[np.float64], height_m: float) -> None:
        self._data.qpos[2] = height_m
        self._data.qpos[3:_FREE] = quaternion
        self._data.qvel[:6] = 0.0

    def _ground_m(self, x_m: float, y_m: float) -> float:
        """Return the maximum height of the ground below a rover at a position."""
        reach_m = (-self._chassis.reach_m, 0.0, self._chassis.reach_m)
        down, hit = np.array((0.0, 0.0, -1.0)), np.empty(1, np.int32)
        depths_m = [
            mujoco.mj_ray(
                self._model,
                self._data,
                np.array((x_m + along, y_m + across, _SKY_M)),
                down,
                _GROUND,
                True,
                -1,
                hit,
            )
            for along, across in product(reach_m, reach_m)
        ]
        return _SKY_M - float(min(depths_m))
