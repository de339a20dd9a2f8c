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
