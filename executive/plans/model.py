"""A plan that was read and checked: nodes with values; and the leaves that a plan may have."""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum, unique
from typing import Final, assert_never

from executive.commands import Argument, Family, Request, Waypoint, declared

DEADLINE: Final = "deadline_s"
"""The attribute of a leaf that limits its time; needed unless a Timeout stands above."""

_STEERING: Final = {
    Family.PLAN,
    Family.PLAN_START,
    Family.STOP,
    Family.RESUME,
    Family.CONFIRMATION,
}
"""Commands that a plan does not give: a pose is confirmed by an operator who has checked it."""

LEAVES: Final = {
    declaration.name: declaration
    for declaration in declared()
    if declaration.family not in _STEERING
}
"""The requests that can be a step of a plan, by the names of their leaves."""


def help_of(argument: Argument) -> str:
    """Return what an attribute of a leaf holds, for people."""
    if argument.kind is Waypoint:
        return "x,y or x,y,heading (m, rad) joined by ;"
    return argument.meaning


@dataclass(frozen=True, slots=True)
class NodeLocation:
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

    place: NodeLocation
    children: tuple["PlanNode", ...]


@dataclass(frozen=True, slots=True)
class FallbackNode:
    """Runs its children in their order, until one succeeds."""

    place: NodeLocation
    children: tuple["PlanNode", ...]


@dataclass(frozen=True, slots=True)
class ParallelNode:
    """Runs its children at the same time, until enough have succeeded or failed."""

    place: NodeLocation
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

    place: NodeLocation
    repeat_on: RepeatOn
    times: int
    child: "PlanNode"


@dataclass(frozen=True, slots=True)
class TimeoutNode:
    """Fails when its child has not ended within a time."""

    place: NodeLocation
    duration_s: float
    child: "PlanNode"


@dataclass(frozen=True, slots=True)
class InverterNode:
    """Succeeds when its child fails, and fails when it succeeds."""

    place: NodeLocation
    child: "PlanNode"


@dataclass(frozen=True, slots=True)
class PlanStep:
    """A leaf: one command.

    Attributes:
        deadline_s: seconds after which it fails; None where a `Timeout` stands above it.
    """

    place: NodeLocation
    request: Request
    deadline_s: float | None


PlanNode = (
    SequenceNode | FallbackNode | ParallelNode | LoopNode | TimeoutNode | InverterNode | PlanStep
)


def children_of(node: PlanNode) -> tuple[PlanNode, ...]:
    """Return the nodes right below a node."""
    match node:
        case SequenceNode() | FallbackNode() | ParallelNode():
            return node.children
        case LoopNode() | TimeoutNode() | InverterNode():
            return (node.child,)
        case PlanStep():
            return ()


@dataclass(frozen=True, slots=True)
class TimeoutEnd:
    """What a timeout limits is done."""

    node: TimeoutNode


def expected_course(node: PlanNode) -> Iterator[PlanStep | TimeoutNode | TimeoutEnd]:
    """Yield the steps of a plan in their order, if each does what it should.

    Of a fallback the first child, of a retry one attempt. What a timeout limits stands between it
    and its end.
    """
    match node:
        case PlanStep():
            yield node
        case FallbackNode():
            for child in node.children[:1]:
                yield from expected_course(child)
        case LoopNode(repeat_on=repeat_on, times=times, child=child):
            for _ in range(times if repeat_on is RepeatOn.SUCCESS else 1):
                yield from expected_course(child)
        case TimeoutNode(child=child):
            yield node
            yield from expected_course(child)
            yield TimeoutEnd(node)
        case SequenceNode() | ParallelNode() | InverterNode():
            for child in children_of(node):
                yield from expected_course(child)
        case _:
            assert_never(node)


def steps(root: PlanNode) -> tuple[PlanStep, ...]:
    """Return all leaves."""
    if isinstance(root, PlanStep):
        return (root,)
    return tuple(step for child in children_of(root) for step in steps(child))
