"""Ways of driving a simulated rover that several tests share."""

from math import copysign, sqrt
from typing import TypeVar

from executive.values.facts import Fact, Frame
from executive.values.geometry import STANDING, Velocity
from sim.rover.body import SimulatedBody
from sim.rover.jackal import SimulatedJackal

COMMAND_PERIOD_S = 0.05
Reading = TypeVar("Reading")


def hold(rover: SimulatedJackal, velocity: Velocity, duration_s: float) -> list[Fact]:
    """Command one velocity at 20 Hz; return all facts of that time."""
    facts: list[Fact] = []
    for _ in range(round(duration_s / COMMAND_PERIOD_S)):
        rover.drive(velocity)
        rover.advance(COMMAND_PERIOD_S)
        facts += rover.facts()
    return facts


def jpeg(rover: SimulatedBody) -> bytes:
    """Take a picture; other facts that wait are lost."""
    rover.request_frame()
    return next(fact.data for fact in rover.facts() if isinstance(fact, Frame))


def readings(
    rover: SimulatedJackal, kind: type[Reading], velocity: Velocity, duration_s: float
) -> list[Reading]:
    """Command one velocity; return the facts of one kind."""
    return [fact for fact in hold(rover, velocity, duration_s) if isinstance(fact, kind)]


def travel(rover: SimulatedJackal, distance_m: float, speed_mps: float = 1.0) -> None:
    """Drive straight by the clock, with 1 m/s2, and stand."""
    for speed in _profile(abs(distance_m), speed_mps, 1.0):
        hold(rover, Velocity(copysign(speed, distance_m), 0), COMMAND_PERIOD_S)
    hold(rover, STANDING, 0.5)


def turn(rover: SimulatedJackal, angle_rad: float, rate_radps: float = 1.5) -> None:
    """Turn on the spot by the clock, with 3 rad/s2, and stand."""
    for rate in _profile(abs(angle_rad), rate_radps, 3.0):
        hold(rover, Velocity(0, copysign(rate, angle_rad)), COMMAND_PERIOD_S)
    hold(rover, STANDING, 0.5)


def _profile(left: float, maximum: float, acceleration: float) -> list[float]:
    speeds: list[float] = []
    speed = 0.0
    while left > 1e-4:
        speed = min(
            speed + acceleration * COMMAND_PERIOD_S,
            maximum,
            sqrt(2 * acceleration * left),
            left / COMMAND_PERIOD_S,
        )
        left -= speed * COMMAND_PERIOD_S
        speeds.append(speed)
    return speeds
