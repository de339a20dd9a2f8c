"""What a rover can be made to do in a tick: a velocity, or a whole motion of its own."""

from dataclasses import dataclass

from executive.geometry import Velocity
from executive.reports import Identity


@dataclass(frozen=True, slots=True)
class TurnBy:
    """Turn on the spot by an angle, counter-clockwise positive."""

    angle_rad: float
    speed_radps: float


@dataclass(frozen=True, slots=True)
class Advance:
    """Drive straight on; a negative distance drives backward."""

    distance_m: float
    speed_mps: float


@dataclass(frozen=True, slots=True)
class Hold:
    """Hold a velocity for a time, then stand."""

    velocity: Velocity
    duration_s: float


@dataclass(frozen=True, slots=True)
class WholeMotion:
    """A motion that a rover carries out by itself, from standing to standing.

    Attributes:
        number: counts from 1 in one process; the rover's answer carries it.
        command: the command of which it is a part.
    """

    number: int
    what: TurnBy | Advance | Hold
    command: Identity


Wanted = Velocity | WholeMotion
