"""A plan that was read and checked: nodes with values; and the leaves that a plan may have."""

from collections.abc import Callable, Iterator
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


@dataclass(frozen=True, slots=True)
class Place:
    """Where a node stands.

    Attributes:
        number: counts the nodes from 0, parents before children.
        path: names from the root joined by slashes; no two nodes share one.
        line: line of the text that it was read from.
    """

    number: int
    path: str
    line: int

    @property
    def name(self) -> str:
        """The last name of the path."""
        return self.path.rpartition("/")[2]


@dataclass(frozen=True, slots=True)
class SequenceNode:
    """Runs its children in their order, until one fails."""

    place: Place
    children: tuple["PlanNode", ...]


@dataclass(frozen=True, slots=True)
class FallbackNode:
    """Runs its children in their order, until one succeeds."""

    place: Place
    children: tuple["PlanNode", ...]


@dataclass(frozen=True, slots=True)
class ParallelNode:
    """Runs its children at the same time, until enough have succeeded or failed."""

    place: Place
    successes: int
    failures: int
    children: tuple["PlanNode", ...]


@unique
class RepeatOn(Enum):
    """What makes a loop run its child once more."""

    SUCCESS = "repeat"
    FAILURE = "retry"


@dataclass(frozen=True, slots=True)
class LoopNode:
    """Runs its child up to `times`, as long as it ends so."""

    place: Place
    repeat_on: RepeatOn
    times: int
    child: "PlanNode"


@dataclass(frozen=True, slots=True)
class TimeoutNode:
    """Fails when its child has not ended within a time."""

    place: Place
    duration_s: float
    child: "PlanNode"


@dataclass(frozen=True, slots=True)
class InverterNode:
    """Succeeds when its child fails, and fails when it succeeds."""

    place: Place
    child: "PlanNode"


@dataclass(frozen=True, slots=True)
class Step:
    """A leaf: one command.

    Attributes:
        deadline_s: seconds after which it fails; None where a `Limit` stands above it.
    """

    place: Place
    request: Request
    deadline_s: float | None


PlanNode = SequenceNode | FallbackNode | ParallelNode | LoopNode | TimeoutNode | InverterNode | Step


def children_of(node: PlanNode) -> tuple[PlanNode, ...]:
    """Return the nodes right below a node."""
    match node:
        case SequenceNode() | FallbackNode() | ParallelNode():
            return node.children
        case LoopNode() | TimeoutNode() | InverterNode():
            return (node.child,)
        case Step():
            return ()


def walk(node: PlanNode) -> Iterator[PlanNode]:
    """Yield a node and all below it, parents first."""
    yield node
    for child in children_of(node):
        yield from walk(child)


def steps(root: PlanNode) -> tuple[Step, ...]:
    """Return all leaves."""
    return tuple(node for node in walk(root) if isinstance(node, Step))
