"""The nodes of a validated plan as values (`SequenceNode`, `PlanStep`, ...); its valid leaves."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from enum import Enum, unique
from typing import Final, assert_never

from executive.commands import Argument, Family, Request, Waypoint, all_declarations
from executive.values.reasons import Reason, Refusal

DEADLINE: Final = "deadline_s"
"""The attribute that sets a leaf's deadline; required unless a Timeout is above it."""

_STEERING: Final = {
    Family.PLAN,
    Family.PLAN_START,
    Family.STOP,
    Family.RESUME,
    Family.CONFIRMATION,
}
"""Commands that a plan may not give; only an operator may confirm the pose, after a check."""

LEAVES: Final = {
    declaration.name: declaration
    for declaration in all_declarations()
    if declaration.family not in _STEERING
}
"""The requests that can be a step of a plan, by the names of their leaves."""


def attribute_help(argument: Argument) -> str:
    """Return the human-readable description of a leaf's attribute."""
    if argument.kind is Waypoint:
        return "x,y or x,y,heading (m, rad) joined by ;"
    return argument.meaning


@dataclass(frozen=True, slots=True)
class NodeLocation:
    """Location of a node in its plan.

    Attributes:
        number: counts the nodes from 0, parents before children.
        path: unique path, names from the root joined by slashes.
        line: line of the plan's text.
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
    """Runs its children in order, until one fails."""

    location: NodeLocation
    children: tuple["PlanNode", ...]


@dataclass(frozen=True, slots=True)
class FallbackNode:
    """Runs its children in order, until one succeeds."""

    location: NodeLocation
    children: tuple["PlanNode", ...]


@dataclass(frozen=True, slots=True)
class ParallelNode:
    """Runs its children in parallel, until enough have succeeded or failed."""

    location: NodeLocation
    successes: int
    failures: int
    children: tuple["PlanNode", ...]


@unique
class RepeatOn(Enum):
    """Result after which a loop runs its child again."""

    SUCCESS = "repeat"
    FAILURE = "retry"


@dataclass(frozen=True, slots=True)
class LoopNode:
    """Runs its child up to `times`, while it ends with the result `repeat_on`."""

    location: NodeLocation
    repeat_on: RepeatOn
    times: int
    child: "PlanNode"


@dataclass(frozen=True, slots=True)
class TimeoutNode:
    """Fails if its child does not end within a time."""

    location: NodeLocation
    duration_s: float
    child: "PlanNode"


@dataclass(frozen=True, slots=True)
class InverterNode:
    """Succeeds when its child fails, and fails when it succeeds."""

    location: NodeLocation
    child: "PlanNode"


@dataclass(frozen=True, slots=True)
class PlanStep:
    """A leaf: one command.

    Attributes:
        deadline_s: seconds after which it fails; None if a `Timeout` above limits it.
    """

    location: NodeLocation
    request: Request
    deadline_s: float | None


PlanNode = (
    SequenceNode | FallbackNode | ParallelNode | LoopNode | TimeoutNode | InverterNode | PlanStep
)


def children_of(node: PlanNode) -> tuple[PlanNode, ...]:
    """Return the children of a node."""
    match node:
        case SequenceNode() | FallbackNode() | ParallelNode():
            return node.children
        case LoopNode() | TimeoutNode() | InverterNode():
            return (node.child,)
        case PlanStep():
            return ()


@dataclass(frozen=True, slots=True)
class TimeoutEnd:
    """End of the subtree that a timeout limits."""

    node: TimeoutNode


def nominal_steps(node: PlanNode) -> Iterator[PlanStep | TimeoutNode | TimeoutEnd]:
    """Yield the steps of a plan in order, assuming that each succeeds.

    Of a fallback the first child, of a retry one attempt. Steps that a timeout limits follow it and
    precede its end.
    """
    match node:
        case PlanStep():
            yield node
        case FallbackNode():
            for child in node.children[:1]:
                yield from nominal_steps(child)
        case LoopNode(repeat_on=repeat_on, times=times, child=child):
            for _ in range(times if repeat_on is RepeatOn.SUCCESS else 1):
                yield from nominal_steps(child)
        case TimeoutNode(child=child):
            yield node
            yield from nominal_steps(child)
            yield TimeoutEnd(node)
        case SequenceNode() | ParallelNode() | InverterNode():
            for child in children_of(node):
                yield from nominal_steps(child)
        case _:
            assert_never(node)


def nodes(root: PlanNode) -> Iterator[PlanNode]:
    """Yield a node and all nodes below it."""
    yield root
    for child in children_of(root):
        yield from nodes(child)


def steps(root: PlanNode) -> tuple[PlanStep, ...]:
    """Return all leaves."""
    return tuple(each for each in nodes(root) if isinstance(each, PlanStep))


def resume_points(
    node: PlanNode, above: tuple[str, ...] = ()
) -> Iterator[tuple[PlanNode, tuple[str, ...]]]:
    """Yield the nodes at which a plan can be resumed, in order.

    They are those below nothing but sequences, each as a whole, with its path and the paths of the
    sequences that begin with it.
    """
    paths = (*above, node.location.path)
    if not isinstance(node, SequenceNode):
        yield node, paths
        return
    for child in node.children:
        yield from resume_points(child, paths)
        paths = ()


def skipped_nodes(
    root: PlanNode, step: str, last: str, ended: Collection[str]
) -> tuple[PlanNode, ...] | Refusal:
    """Return the nodes to skip from the interruption to a named step, or a refusal.

    A step that has ended cannot be named, because no step is repeated.

    Args:
        root: root node of the plan.
        step: name of the step: a path in the plan, or the end of one.
        last: path of the leaf that started or ended last.
        ended: keys of the steps in the journal.
    """
    points = tuple(resume_points(root))
    at = [each.location for each, _ in points]
    begun = [i for i, each in enumerate(at) if f"{last}/".startswith(f"{each.path}/")]
    after = range(max(begun, default=0), len(points))
    present = next((i for i in after if str(at[i].number) not in ended), len(points))
    named = [
        i for i, (_, paths) in enumerate(points) if any(f"/{p}".endswith(f"/{step}") for p in paths)
    ]
    if len(named) == 1 and named[0] >= present:
        return tuple(each for each, _ in points[present : named[0]])
    plan, names = root.location.path, [each.path.partition("/")[2] for each in at[present:]]
    remaining = f"remaining steps: {', '.join(names) or 'none'}"
    if len(named) == 1:
        text = f"step {step[:64]} of {plan} has ended and is not repeated; {remaining}"
        return Refusal(Reason.PLAN_STATUS, text, argument=2)
    text = f"{len(named) or 'no'} steps of {plan} are named {step[:64]!r}; {remaining}"
    return Refusal(Reason.NO_SUCH_STEP, text, argument=2, subject=step[:64])
