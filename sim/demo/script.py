"""What mission control asks of a rover, by which link, when, and what should come of it."""

from dataclasses import dataclass, fields, replace
from enum import Enum
from math import degrees, radians
from typing import Final

from executive.commands import (
    FollowPath,
    MoveForward,
    MoveTo,
    Request,
    Resume,
    SetCameraAngles,
    Stop,
    TakePicture,
    Waypoint,
    declaration_of,
)
from sim.processes import Outage


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
    """Send it when the rover has come this near to a place, or goes nowhere any more."""

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
    """Return a request as command and arguments, angles in degrees: `moveTo 3,2,-15°`."""
    values = [
        _spelled(field.name, getattr(request, field.name))
        for field in fields(request)
        if getattr(request, field.name) is not None
    ]
    return " ".join([declaration_of(type(request)).name, *values])


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


@dataclass(frozen=True, slots=True)
class Show:
    """What is played at once."""

    scripts: tuple[Script, ...]
    eclipses: tuple[Outage, ...] = ()

    @property
    def relayed(self) -> bool:
        """Whether the relay is needed."""
        return any(Link.RELAY in script.links for script in self.scripts)


def _session(
    lookout: Waypoint, pan_rad: float, path: tuple[Waypoint, ...], home: Waypoint, near_m: float
) -> tuple[Step, ...]:
    """Return the steps of a session: to a lookout, stopped on the way, along a path, and home."""
    return (
        Step(MoveTo(lookout), WhenDone(), Ending.CANCELLED),
        Step(SetCameraAngles(radians(60), radians(-10)), AtOnce()),
        Step(Stop(), WhenNear(lookout, near_m)),
        Step(Resume(), WhenDone(look_s=2.0)),
        Step(MoveTo(lookout), WhenDone(look_s=1.0)),
        Step(SetCameraAngles(pan_rad, radians(-6)), AtOnce()),
        Step(TakePicture(), WhenDone()),
        Step(MoveTo(Waypoint(500.0, 0.0)), WhenDone(look_s=1.0), Ending.REJECTED),
        Step(FollowPath(path), WhenDone(look_s=2.0)),
        Step(SetCameraAngles(radians(-90), radians(-20)), AtOnce()),
        Step(MoveTo(home), AtOnce()),
        Step(MoveTo(home), WhenDone(look_s=1.0), Ending.DUPLICATE, repeats=True),
    )


_LOOKOUT: Final = Waypoint(3.0, 2.0, radians(-15))
_ROUND_THE_ROCK: Final = (
    Waypoint(4.2, -0.8, radians(-100)),
    Waypoint(3.4, -3.1, radians(180)),
    Waypoint(1.2, -2.6, radians(90)),
    Waypoint(1.2, -0.7, radians(120)),
)
_HOME: Final = Waypoint(0.2, 0.9, 0.0)
JACKAL: Final = Script(
    title="a simulated Jackal",
    scale=1.0,
    asset="jackal",
    world="rough",
    route=(_LOOKOUT, *_ROUND_THE_ROCK, _HOME),
    steps=_session(_LOOKOUT, radians(-4), _ROUND_THE_ROCK, _HOME, near_m=1.7),
)

_KNOLL: Final = Waypoint(1.0, 0.5, radians(-15))
_ROUND_THE_KNOLL: Final = (Waypoint(1.3, -0.3, radians(-100)), Waypoint(0.7, -0.7, radians(180)))
_BASE: Final = Waypoint(0.1, 0.3, 0.0)
MOCUP: Final = Script(
    title="a simulated MOCUP",
    scale=0.5,
    asset="mocup",
    world="rough",
    route=(_KNOLL, *_ROUND_THE_KNOLL, _BASE),
    steps=_session(_KNOLL, radians(26), _ROUND_THE_KNOLL, _BASE, near_m=0.6),
)

_BEND: Final = (Waypoint(4.2, -0.8, radians(-100)), Waypoint(1.2, -0.7, radians(120)))
RELAY: Final = replace(
    JACKAL,
    route=(_LOOKOUT, *_BEND, _HOME),
    steps=(
        Step(SetCameraAngles(0.0, radians(-6)), WhenDone(), link=Link.RELAY),
        Step(MoveTo(_LOOKOUT), AtOnce(), link=Link.RELAY),
        Step(FollowPath(_BEND), AtOnce(), link=Link.RELAY),
        Step(
            MoveForward(5.0), WhenDark(pause_s=1.0), Ending.EXPIRED, link=Link.RELAY, lifetime_s=6.0
        ),
        Step(TakePicture(), AtOnce(pause_s=2.0), link=Link.RELAY),
        Step(MoveTo(_HOME), AtOnce(pause_s=2.0), link=Link.RELAY),
        Step(MoveTo(_HOME), WhenDone(look_s=0.5), Ending.DUPLICATE, repeats=True),
    ),
    watched=Link.RELAY,
)


def _by_both(
    lookout: Waypoint, pan_rad: float, errand: MoveTo | MoveForward, home: Waypoint
) -> tuple[Step, ...]:
    """Return the steps of a session by two links in turn; the way home is asked for by both."""
    return (
        Step(MoveTo(lookout), WhenDone()),
        Step(SetCameraAngles(pan_rad, radians(-6)), WhenDone(), link=Link.RELAY),
        Step(TakePicture(), WhenDone()),
        Step(errand, WhenDone(look_s=0.5), link=Link.RELAY),
        Step(MoveTo(home), WhenDone()),
        Step(MoveTo(home), AtOnce(), repeats=True, link=Link.RELAY),
    )


_ASIDE: Final = Waypoint(1.2, -0.7, radians(120))
ASSETS: Final = (
    replace(
        JACKAL,
        route=(_LOOKOUT, _ASIDE, _HOME),
        steps=_by_both(_LOOKOUT, radians(-4), MoveTo(_ASIDE), _HOME),
    ),
    replace(
        MOCUP, route=(_KNOLL, _BASE), steps=_by_both(_KNOLL, radians(26), MoveForward(0.2), _BASE)
    ),
)

SHOWS: Final = {
    "jackal": Show((JACKAL,)),
    "mocup": Show((MOCUP,)),
    "relay": Show((RELAY,), (Outage(14, 30),)),
    "assets": Show(ASSETS),
}
