"""Model predictive path integral control in numpy, a competitor in `rover bench locomotion`.

Williams et al. 2017: many noisy sequences of velocities are rolled out over a unicycle whose
velocities keep to the limits of speed and acceleration; their mean, weighted by what each costs,
is what is commanded. Weights and noise were tuned by hand on a few goals.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from executive.values.geometry import STANDING, Pose, Velocity, wrap_rad
from tests.benchmarks.competitors import AIM, Seen, Task

Figures = NDArray[np.float64]

SAMPLES: Final = 400
STEPS: Final = 25
STEP_S: Final = 0.1
TEMPERATURE: Final = 0.15
NOISE: Final = np.array([0.5, 0.9])
"""Of travel and rotation, of which it keeps `KEPT` from step to step; less near the goal."""
RETAINED: Final = 0.7
NEAR_M: Final = 1.0
"""From where on the heading of the goal counts, and the noise decreases."""
LEAST_NOISE: Final = 0.2
HEADING_M: Final = 0.2
"""What a radian off the heading costs, as metres off the place."""
LAST: Final = 8.0
"""What the last state of a sequence counts, beside the others."""
SPEED_COST: Final = 0.3


class Mppi:
    """Drives to a pose by sampling; it may reverse."""

    def __init__(self, task: Task) -> None:
        self._task = task
        self._maximum = np.array([task.travel_speed_mps, task.rotate_speed_radps])
        accelerations = [task.travel_acceleration_mps2, task.rotate_acceleration_radps2]
        self._slew = STEP_S * np.array(accelerations)
        self._random = np.random.default_rng(0)
        self._mean: Figures = np.zeros((STEPS, 2))
        self._arrived = False

    def command(self, seen: Seen) -> Velocity:
        """Return the first velocity of the weighted mean."""
        task, pose = self._task, seen.soon(self._task.latency_s)
        off_m = pose.point.distance_m(task.goal.point)
        off_rad = abs(wrap_rad(pose.heading_rad - task.goal.heading_rad))
        share = 1.0 if self._arrived else AIM
        self._arrived = off_m <= share * task.within_m and off_rad <= share * task.within_rad
        if self._arrived:
            self._mean[:] = 0.0
            return STANDING
        near = min(1.0, (off_m + HEADING_M * off_rad) / NEAR_M)
        tried = self._sequences(seen.sent, LEAST_NOISE + (1.0 - LEAST_NOISE) * near)
        costs = self._costs(tried, pose)
        weights = np.exp((costs.min() - costs) / (TEMPERATURE * max(near, LEAST_NOISE)))
        mean = np.tensordot(weights / weights.sum(), tried, 1)
        part = task.tick_s / STEP_S
        self._mean = mean + part * (np.vstack([mean[1:], mean[-1:]]) - mean)
        return Velocity(float(mean[0, 0]), float(mean[0, 1]))

    def _sequences(self, sent: Velocity, ratio: float) -> Figures:
        """Return sequences of velocities within the limits: samples, steps, travel and rotation."""
        noise = self._random.standard_normal((SAMPLES, STEPS, 2)) * (ratio * NOISE)
        for step in range(1, STEPS):
            noise[:, step] = (
                RETAINED * noise[:, step - 1] + (1.0 - RETAINED**2) ** 0.5 * noise[:, step]
            )
        noise[0] = 0.0
        tried: Figures = np.clip(self._mean + noise, -self._maximum, self._maximum)
        tried[1] = 0.0
        before = np.broadcast_to([sent.travel_mps, sent.rotate_radps], (SAMPLES, 2))
        for step in range(STEPS):
            tried[:, step] = np.clip(tried[:, step], before - self._slew, before + self._slew)
            before = tried[:, step]
        return tried

    def _costs(self, tried: Figures, pose: Pose) -> Figures:
        """Return what each sequence costs: how far from the goal it is, for how long."""
        goal = self._task.goal
        turned = np.cumsum(tried[:, :, 1], axis=1) * STEP_S
        headings = pose.heading_rad + turned - tried[:, :, 1] * (STEP_S / 2)
        x_m = pose.x_m + np.cumsum(tried[:, :, 0] * np.cos(headings), axis=1) * STEP_S
        y_m = pose.y_m + np.cumsum(tried[:, :, 0] * np.sin(headings), axis=1) * STEP_S
        off_m = np.hypot(x_m - goal.x_m, y_m - goal.y_m)
        off_rad = np.abs(np.angle(np.exp(1j * (pose.heading_rad + turned - goal.heading_rad))))
        costs = off_m + HEADING_M * off_rad * np.exp(-((off_m / NEAR_M) ** 2))
        fast = SPEED_COST * np.abs(tried[:, -1] / self._maximum).sum(axis=1)
        total: Figures = costs.sum(axis=1) * STEP_S + LAST * STEP_S * (costs[:, -1] + fast)
        return total
