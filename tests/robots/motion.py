"""Motion of a stand-in: what its wheels do, what the ground makes of it, and its odometry."""

from collections import deque
from dataclasses import dataclass
from math import atan, cos, pi, sin, tan

from tests.robots.interfaces import Interface

STEP_S = 0.005
LEAST_MPS = 1e-3
SEEN_M = 0.3
"""Ground that a robot which has driven forward remembers behind itself."""


@dataclass(frozen=True, slots=True)
class Received:
    """A velocity, and when it came."""

    travel_mps: float
    rotate_radps: float
    at_s: float


class Motion:
    """A robot that moves by the last velocity, in steps.

    Attributes:
        travel_mps, rotate_radps: of its wheels.
        turn_radps: true rate.
        heading_rad: true heading, without bounds.
        x_m, y_m, odometry_rad: pose by its odometry.
        wheels_rad: angles of the left and the right wheels.
    """

    def __init__(self, interface: Interface) -> None:
        self._base, self._gyro = interface.base, interface.odometry.gyro
        self._timeout_s = interface.velocities.timeout_s
        self._joints = interface.joints
        self.stopped = interface.emergency_stop is not None and interface.emergency_stop.at_start
        self.now_s = 0.0
        self._last: Received | None = None
        self._waiting: deque[Received] = deque()
        self.travel_mps = self.rotate_radps = self.turn_radps = self.travel_mps2 = 0.0
        self.heading_rad = self.x_m = self.y_m = self.odometry_rad = 0.0
        self.wheels_rad = [0.0, 0.0]
        self._steer_rad = self._ahead_m = 0.0

    @property
    def odometry_radps(self) -> float:
        """The rate that odometry reports."""
        return self.turn_radps if self._gyro else self.rotate_radps

    def command(self, travel_mps: float, rotate_radps: float) -> None:
        self._waiting.append(Received(travel_mps, rotate_radps, self.now_s))

    @property
    def commanded(self) -> tuple[float, float]:
        """The velocity that has not timed out."""
        last = self._last
        if last is None or self.now_s - last.at_s >= self._timeout_s:
            return 0.0, 0.0
        return last.travel_mps, last.rotate_radps

    def wheel_rates(self) -> tuple[float, float]:
        """Return the rates of the left and the right wheels."""
        joints = self._joints
        if joints is None:
            return 0.0, 0.0
        across_mps = self.rotate_radps * joints.track_m / 2
        return (
            (self.travel_mps - across_mps) / joints.wheel_radius_m,
            (self.travel_mps + across_mps) / joints.wheel_radius_m,
        )

    def step(self) -> None:
        base = self._base
        self.now_s += STEP_S
        while self._waiting and self._waiting[0].at_s + base.dead_s <= self.now_s:
            self._last = self._waiting.popleft()
        travel_mps, rotate_radps = (0.0, 0.0) if self.stopped else self.commanded
        travel_mps = bounded(travel_mps, base.travel_mps)
        rotate_radps = bounded(rotate_radps, base.rotate_radps)
        if travel_mps < 0 and self._ahead_m < -base.backward_m:
            travel_mps = 0.0
        share = STEP_S / (base.lag_s + STEP_S)
        faster_mps = bounded((travel_mps - self.travel_mps) * share, base.travel_mps2 * STEP_S)
        self.travel_mps += faster_mps
        self.travel_mps2 = 0.8 * self.travel_mps2 + 0.2 * faster_mps / STEP_S * (1 - base.slip)
        if base.wheelbase_m:
            self._steer(travel_mps, rotate_radps)
            self.rotate_radps = self.travel_mps * tan(self._steer_rad) / base.wheelbase_m
        else:
            self.rotate_radps += bounded(
                (rotate_radps - self.rotate_radps) * share, base.rotate_radps2 * STEP_S
            )
        self._integrate()

    def _steer(self, travel_mps: float, rotate_radps: float) -> None:
        base = self._base
        if abs(travel_mps) > LEAST_MPS:
            wanted_rad = atan(rotate_radps * base.wheelbase_m / travel_mps)
        else:
            wanted_rad = (pi / 2 if rotate_radps > 0 else -pi / 2) if rotate_radps else 0.0
        wanted_rad = bounded(wanted_rad, base.steer_max_rad)
        self._steer_rad += bounded(wanted_rad - self._steer_rad, base.steer_rate_radps * STEP_S)

    def _integrate(self) -> None:
        base = self._base
        way_m = self.travel_mps * STEP_S
        self._ahead_m = min(SEEN_M, self._ahead_m + way_m * (1 - base.slip))
        self.turn_radps = self.rotate_radps * (1 - base.turn_slip)
        self.heading_rad += self.turn_radps * STEP_S
        self.x_m += way_m * cos(self.odometry_rad)
        self.y_m += way_m * sin(self.odometry_rad)
        self.odometry_rad += self.odometry_radps * STEP_S
        for side, rate_radps in enumerate(self.wheel_rates()):
            self.wheels_rad[side] += rate_radps * STEP_S


def bounded(value: float, most: float) -> float:
    return max(-most, min(most, value))
