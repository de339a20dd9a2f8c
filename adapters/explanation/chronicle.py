"""What is known of a time in a rover's life: all that an explanation is made from.

A recording knows all of it; by the MRS the reports are known, and the state of the tree now.
"""

from dataclasses import dataclass
from enum import Enum
from math import degrees
from typing import Final

from executive.commands import Arrival, Declaration, Mode, Request, arguments_of, declaration_of
from executive.faults import DECLARED, Then
from executive.reasons import Reason, Refusal
from executive.reports import Identity, Report

SLOWING: Final = frozenset(
    each.reason for each in DECLARED.values() if each.row.then is Then.SLOW_DOWN
)
"""Unless the settings of an asset say otherwise."""
LONGEST_VALUE: Final = 40
"""Characters of an argument that are shown, such as of a path."""
MOST_READ: Final = 4 * LONGEST_VALUE
"""Of what was sent, however long: this is done between the ticks of a rover, too."""


@dataclass(frozen=True, slots=True)
class Asked:
    """A command as it arrived.

    Attributes:
        text: its name and arguments, for people.
        name: of the request, as in its declaration.
        utc_s: when it was looked at first, seconds since 1970-01-01 UTC.
        created_utc_s, lifetime_s: when it was made and how long it may wait, as its sender said.
    """

    identity: Identity
    text: str
    name: str
    link: str
    utc_s: float
    arrival: Arrival = Arrival.APPEND
    created_utc_s: float | None = None
    lifetime_s: float | None = None


@dataclass(frozen=True, slots=True)
class Declined:
    """A command that was not taken under its number, so that it has no life of its own."""

    identity: Identity
    utc_s: float
    refusal: Refusal


@dataclass(frozen=True, slots=True)
class Situation:
    """What the rover was about from a time on.

    Attributes:
        why: one line on why the rover stood, or what moved it.
    """

    utc_s: float
    mode: Mode
    active: Identity | None
    why: str


@dataclass(frozen=True, slots=True)
class LeafRun:
    """A time for which a leaf of the tree ran.

    Attributes:
        path: of the leaf, names from the root joined by slashes.
        ended_utc_s: None while it runs.
        message: what it said of itself last.
    """

    path: str
    began_utc_s: float
    ended_utc_s: float | None
    message: str

    @property
    def name(self) -> str:
        """The name of the leaf."""
        return self.path.rpartition("/")[2]


@dataclass(frozen=True, slots=True)
class Fastest:
    """The greatest speeds, without sign, that the rover was commanded within a command.

    Attributes:
        allowed_mps: the greatest that the asset allows.
    """

    identity: Identity
    travel_mps: float
    allowed_mps: float


@dataclass(frozen=True, slots=True)
class Chronicle:
    """A time in a rover's life.

    Attributes:
        until_utc_s: when it ends, seconds since 1970-01-01 UTC.
        asked: in the order of their arrival.
        reports: in the order of their numbers.
        situations, leaves: in their order; empty where they are not known.
        slowing: the reasons of the faults for which the rover slows down.
    """

    until_utc_s: float
    reports: tuple[Report, ...]
    asked: tuple[Asked, ...] = ()
    declined: tuple[Declined, ...] = ()
    situations: tuple[Situation, ...] = ()
    leaves: tuple[LeafRun, ...] = ()
    fastest: tuple[Fastest, ...] = ()
    slowing: frozenset[Reason] = SLOWING


def request_text(request: Request) -> str:
    """Return what is asked for, with its arguments and their units, on one line."""
    declared = declaration_of(type(request))
    given = [
        _argument(declared, request, each.field, each.name, each.unit) for each in declared.written
    ]
    return " ".join([declared.name, *filter(None, given)])


def _argument(declared: Declaration, request: Request, field: str, name: str, unit: str) -> str:
    composite = declared.composite
    holder: object = request
    if composite is not None and field in {each.field for each in arguments_of(composite)}:
        holder = getattr(request, declared.arguments[0].field)
    value = getattr(holder, field)
    match value:
        case None:
            return ""
        case Enum():
            shown = str(value.value)
        case float() | int() if unit == "rad":
            return f"{name} {degrees(value):.4g}°"
        case float():
            shown = f"{value:.4g}"
        case tuple():
            return f"{len(value)} {name}"
        case bytes():
            return f"{name} of {len(value)} octets"
        case _:
            shown = " ".join(str(value)[:MOST_READ].split())
    if len(shown) > LONGEST_VALUE:
        shown = f"{shown[:LONGEST_VALUE]}…"
    return f"{name} {shown} {unit}".rstrip()
