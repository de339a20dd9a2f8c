"""What the rover is about, and which commands are accepted then: one table."""

from enum import Enum, unique
from typing import Final

from executive.commands.catalogue import Request
from executive.commands.declaration import Family, declaration_of


@unique
class Mode(Enum):
    """The asset's mode (numbers as on the MRS wire)."""

    IDLE = 1
    MOVING = 2
    TELEOP = 3
    PLAN = 4
    PAUSED = 5
    STOPPED = 6
    SAFE = 7


ACCEPTED: Final = {
    Family.MOTION: {Mode.IDLE, Mode.MOVING, Mode.TELEOP, Mode.PAUSED},
    Family.CAMERA: set(Mode),
    Family.INSTANT: set(Mode),
    Family.POSE: {Mode.IDLE, Mode.PAUSED, Mode.STOPPED, Mode.SAFE},
    Family.SETTING: set(Mode),
    Family.PLAN: set(Mode),
    Family.PLAN_START: {Mode.IDLE, Mode.PLAN, Mode.PAUSED},
    Family.STOP: set(Mode),
    Family.RESUME: {Mode.STOPPED, Mode.SAFE},
}


def family(request: Request) -> Family:
    """Return the family of a request."""
    return declaration_of(type(request)).family


def advice(mode: Mode, request: Request) -> str:
    """Return what to do about a command that the mode does not accept."""
    accepted = ", ".join(sorted(m.name for m in ACCEPTED[family(request)]))
    return f"the rover is {mode.name}, this needs {accepted}{_WAY_OUT.get(mode, '')}"


_WAY_OUT: Final = {
    Mode.STOPPED: "; send resume first",
    Mode.SAFE: "; send resume first",
    Mode.PLAN: "; suspend the plan first",
}
