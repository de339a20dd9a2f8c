"""What mission control asks of a rover, by which link, when, and what should come of it."""

from dataclasses import dataclass, fields
from enum import Enum
from math import degrees

from adapters.mrs.spec import invocation
from executive.commands import Request, Waypoint


class Link(Enum):
    """By which way a command goes, and what is told of it comes back."""

    DIRECT = "direct"
    RELAY = "relay"


class Ending(Enum):
    """How a command ends: a terminal stage of its life, or as one that was sent before."""

    EXECUTED = "EXECUTED"
    CANCELLED = "CANCELLED"
    REJECTED = "REJECTED"
    FAILED = "FAILED"
    EXPIRED = "EXPIRED"
    DUPLICATE = "DUPLICATE"


@dataclass(frozen=True, slots=True)
class AtOnce:
    """Send it as soon as the last one was taken, and a pause is over."""

    pause_s: float = 0.0


@dataclass(frozen=True, slots=True)
class WhenDone:
    """Send it when all before it have ended, and mission control has looked at that for a while."""

    look_s: float = 0.0


@dataclass(frozen=True, slots=True)
class WhenNear:
    """Send it when the rover has come this near to a place."""

    place: Waypoint
    distance_m: float


@dataclass(frozen=True, slots=True)
class WhenDark:
    """Send it a while after the relay was first seen without contact."""

    pause_s: float = 0.0


Cue = AtOnce | WhenDone | WhenNear | WhenDark


@dataclass(frozen=True, slots=True)
class Step:
    """One command of the session.

    Attributes:
        expected: how it should end.
        repeats: whether it is the last command sent once more, under its old number.
        lifetime_s: how long it is worth carrying out; None for ever.
    """

    request: Request
    cue: Cue
    expected: Ending = Ending.EXECUTED
    repeats: bool = False
    link: Link = Link.DIRECT
    lifetime_s: float | None = None


@dataclass(frozen=True, slots=True)
class Script:
    """A session with one rover.

    Attributes:
        title: the rover, for people.
        scale: its size beside the Jackal's.
        route: the waypoints in their order; straight lines between them keep clear of rocks.
        watched: the link by which mission control sees how the rover is.
    """

    title: str
    scale: float
    asset: str
    world: str
    route: tuple[Waypoint, ...]
    steps: tuple[Step, ...]
    watched: Link = Link.DIRECT

    @property
    def links(self) -> frozenset[Link]:
        """The links that it needs."""
        return frozenset({self.watched, *(step.link for step in self.steps)})


def spelled(request: Request) -> str:
    """Return a request as operation and arguments, angles in degrees: `moveTo 3,2,-15°`."""
    values = [
        _spelled(field.name, getattr(request, field.name))
        for field in fields(request)
        if getattr(request, field.name) is not None
    ]
    return " ".join([invocation(request).operation, *values])


def _spelled(name: str, value: object) -> str:
    match value:
        case Waypoint(x_m, y_m, heading_rad):
            place = f"{x_m:g},{y_m:g}"
            return place if heading_rad is None else f"{place},{degrees(heading_rad):.0f}°"
        case tuple():
            return " ".join(_spelled(name, item) for item in value)
        case float() if name.endswith("_rad"):
            return f"{degrees(value):.0f}°"
        case float() | int():
            return f"{value:g}"
        case _:
            return str(value)
