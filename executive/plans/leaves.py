"""The leaves of plans: every request that can be a step of one, with its parameters."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, unique
from typing import Final

from executive.commands import Argument, Declaration, Family, Request, Waypoint, declared


@unique
class Kind(Enum):
    """What the text of an attribute holds, and what it is called where people write plans."""

    NUMBER = "double"
    COUNT = "int"
    TEXT = "std::string"
    PLACES = "std::vector<Place>"


@dataclass(frozen=True, slots=True)
class Parameter:
    """One attribute of a leaf, named as in the MRS."""

    name: str
    help: str
    kind: Kind = Kind.NUMBER
    required: bool = True


@dataclass(frozen=True, slots=True)
class Leaf:
    """A leaf that people may write.

    Attributes:
        name: as in `rover command` and in scenarios.
        operation: the MRS operation, with its service.
        make: makes the request from the values of the parameters, in their order; None for those
            that were not given.
    """

    name: str
    operation: str
    parameters: tuple[Parameter, ...]
    make: Callable[..., Request]


DEADLINE: Final = Parameter(
    "deadline_s",
    "seconds after which it fails; needed unless a Timeout stands above",
    required=False,
)

_STEERING: Final = {Family.PLAN, Family.PLAN_START, Family.STOP, Family.RESUME}
"""Who commands these is not a plan."""
_KINDS: Final = {float: Kind.NUMBER, int: Kind.COUNT, str: Kind.TEXT, Waypoint: Kind.PLACES}


def _leaf(declaration: Declaration) -> Leaf:
    return Leaf(
        declaration.name,
        f"{declaration.service}.{declaration.operation}",
        tuple(map(_parameter, declaration.written)),
        declaration.make,
    )


def _parameter(argument: Argument) -> Parameter:
    kind = _KINDS[argument.kind]
    places = "x,y or x,y,heading (m, rad) joined by ;"
    help = places if kind is Kind.PLACES else argument.meaning
    return Parameter(argument.name, help, kind, required=not argument.optional)


LEAVES: Final = {
    declaration.name: _leaf(declaration)
    for declaration in declared()
    if declaration.family not in _STEERING
}
