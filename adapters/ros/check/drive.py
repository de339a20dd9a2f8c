"""The drive of a check: half a metre ahead, then a quarter turn, within the limits of the asset.

A base that cannot turn on the spot turns along its minimum turning radius.
"""

import signal
import time
from dataclasses import dataclass
from math import hypot, pi, sqrt
from typing import Final

from rclpy.executors import Executor
from rclpy.node import Node

from adapters.ros.check.listening import Listening
from adapters.ros.node import clock_of
from adapters.ros.rover import RosRover
from executive.settings import LocomotionKind, Settings
from executive.values.facts import Odometry
from executive.values.geometry import Velocity, wrap_rad

DISTANCE_M, TURN_RAD = 0.5, pi / 2
SPEED_MPS, RATE_RADPS = 0.3, 0.6
"""Maximum speeds; those of the asset, if they are lower."""
REACHED_M, REACHED_RAD = 0.02, 0.03
LOST_S: Final = 0.5
"""Maximum age of the odometry."""
MISSING_RATIO: Final = 1.0
"""Maximum of the commanded motion that the odometry does not show, relative to the leg: frozen
odometry, or a base that does not move."""
REST_S: Final = 2.5
"""Rest after each motion, for the noise of the pose."""
FLUSH_S: Final = 1.0


class DriveError(Exception):
    """The drive is not possible, or was ended; the text gives the reason."""


@dataclass(slots=True)
class DriveLeg:
    """One motion of the drive, in m or rad.

    Attributes:
        wanted: its end.
        direction: velocity of its unit speed.
        speed: its maximum speed.
        acceleration: its acceleration, also to the end.
        now: its speed in this step.
    """

    name: str
    wanted: float
    direction: Velocity
    speed: float
    acceleration: float
    tolerance: float
    now: float = 0.0

    def next(self, done: float, step_s: float) -> Velocity | None:
        """Return the velocity of the next step; None at the end."""
        remaining = self.wanted - done
        if remaining <= self.tolerance:
            return None
        faster = self.now + self.acceleration * step_s
        self.now = min(self.speed, faster, sqrt(self.acceleration * remaining))
        ahead = self.direction
        return Velocity(ahead.travel_mps * self.now, ahead.rotate_radps * self.now)


def check_drivable(settings: Settings) -> None:
    """Raise DriveError unless the asset takes velocities on its topic."""
    if settings.locomotion is not LocomotionKind.VELOCITY or settings.rover is not None:
        raise DriveError(
            f"--drive moves a rover by velocities on cmd_vel, and {settings.asset} has its own"
            " interface: check it without --drive"
        )


def announcement(settings: Settings) -> str:
    """Return the motions of the drive, for the user to confirm."""
    radius_m = settings.drive.min_turning_radius_m
    curve = "" if radius_m is None else f", with a radius of {radius_m:g} m"
    return (
        f"{settings.asset} WILL MOVE: {DISTANCE_M:g} m ahead, then 90 deg to the left{curve}."
        " Ctrl-C stops it."
    )


def drive(node: Node, executor: Executor, settings: Settings, listening: Listening) -> None:
    """Drive and turn, then rest; the rover receives zero at the end in any case.

    Raises:
        DriveError: the odometry was lost, or the rover did not get there.
        KeyboardInterrupt: SIGINT, SIGTERM or SIGHUP was received.
    """
    limits = settings.drive
    travel_mps = min(SPEED_MPS, limits.travel_speed_mps)
    rate_radps = min(RATE_RADPS, limits.rotate_speed_radps)
    mps2, radps2 = limits.travel_acceleration_mps2, limits.rotate_acceleration_radps2
    if radius_m := limits.min_turning_radius_m or 0.0:
        rate_radps, radps2 = min(rate_radps, travel_mps / radius_m), min(radps2, mps2 / radius_m)
    legs = (
        DriveLeg("drive, m", DISTANCE_M, Velocity(1.0, 0.0), travel_mps, mps2, REACHED_M),
        DriveLeg("turn, rad", TURN_RAD, Velocity(radius_m, 1.0), rate_radps, radps2, REACHED_RAD),
    )
    rover = RosRover(node, listening.topics, clock_of(node), settings)
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.default_int_handler)
    try:
        for leg in legs:
            _move(rover, leg, executor, settings.tick_s, listening)
            rover.stop()
            listening.listen(executor, REST_S)
    finally:
        rover.stop()
        rover.flush(FLUSH_S)


def _move(
    rover: RosRover, leg: DriveLeg, executor: Executor, tick_s: float, listening: Listening
) -> None:
    begin = last = _newest(listening)
    turned_rad = done = commanded = 0.0
    while (velocity := leg.next(done, tick_s)) is not None:
        begun_s = time.monotonic()
        rover.drive(velocity)
        listening.listen(executor, tick_s)
        commanded += leg.now * (time.monotonic() - begun_s)
        now = _newest(listening)
        turned_rad += wrap_rad(now.pose.heading_rad - last.pose.heading_rad)
        moved_m = hypot(now.pose.x_m - begin.pose.x_m, now.pose.y_m - begin.pose.y_m)
        last, done = now, turned_rad if leg.direction.rotate_radps else moved_m
        if commanded - done > MISSING_RATIO * leg.wanted:
            causes = "Is its emergency stop active, or its mux locked?"
            if velocity.rotate_radps and not velocity.travel_mps:
                causes += " If it cannot turn on the spot, set drive.min_turning_radius_m"
            raise DriveError(
                f"the rover was stopped: {leg.name}: {commanded:.2f} commanded, {done:.2f} by its"
                f" odometry. {causes}"
            )


def _newest(listening: Listening) -> Odometry:
    """Return the newest odometry.

    Raises:
        DriveError: it is too old.
    """
    if listening.odometry is None or time.monotonic() - listening.odometry.at_s > LOST_S:
        raise DriveError(f"the rover was stopped: no odometry for {LOST_S:g} s")
    return listening.odometry.fact
