"""A plan that was read and checked: nodes with values, no text left to doubt."""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum, unique

from executive.commands import Request


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


@unique
class Order(Enum):
    """How a branch takes its children one after the other."""

    SEQUENCE = "until one fails"
    FALLBACK = "until one succeeds"


@dataclass(frozen=True, slots=True)
class Branch:
    """Runs its children in their order."""

    place: Place
    order: Order
    children: tuple["PlanNode", ...]


@dataclass(frozen=True, slots=True)
class Parallel:
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
class Loop:
    """Runs its child up to `times`, as long as it ends so."""

    place: Place
    again: RepeatOn
    times: int
    child: "PlanNode"


@dataclass(frozen=True, slots=True)
class Timeout:
    """Fails when its child has not ended within a time."""

    place: Place
    duration_s: float
    child: "PlanNode"


@dataclass(frozen=True, slots=True)
class Inversion:
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


PlanNode = Branch | Parallel | Loop | Timeout | Inversion | Step


def children_of(node: PlanNode) -> tuple[PlanNode, ...]:
    """Return the nodes right below a node."""
    match node:
        case Branch() | Parallel():
            return node.children
        case Loop() | Timeout() | Inversion():
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
