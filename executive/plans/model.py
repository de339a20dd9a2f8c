"""A plan that was read, as values: `PlanNode`, `PlanStep`, `PlanRoot` with its blackboard."""

import hashlib
import json
from collections.abc import Collection, Iterator, Mapping
from dataclasses import astuple, dataclass, replace
from typing import Final

from executive.commands import CommandDeclaration, PlanDefinition, Request
from executive.plans.arguments import ArgumentValue, argument_value, number, position
from executive.plans.dialect import DEADLINE, NodeKind
from executive.plans.scripting import Cells, Script, UnknownValueError
from executive.plans.syntax import Value
from executive.values.reasons import Reason, Refusal


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
class CellReference:
    """A port that is read from, or written to, a cell of the blackboard.

    Attributes:
        name: name of the cell in the text.
    """

    cell: int
    name: str


PortValue = int | ArgumentValue | Script | CellReference


@dataclass(frozen=True, slots=True)
class PlanNode:
    """A node of a plan.

    Attributes:
        ports: value of each port that is given or has a default.
        conditions: scripts of the attributes with an underscore, as `_skipIf`.
    """

    location: NodeLocation
    kind: NodeKind
    children: tuple["PlanNode", ...]
    ports: dict[str, PortValue]
    conditions: dict[str, Script]

    def number(self, port: str) -> float:
        """Return the number of a port that is known when the plan is read."""
        value = self.ports[port]
        assert isinstance(value, float | int), (self.location.path, port)
        return value

    def text(self, port: str) -> str:
        """Return the text of a port that is known when the plan is read."""
        value = self.ports[port]
        assert isinstance(value, str), (self.location.path, port)
        return value


@dataclass(frozen=True, slots=True)
class PlanStep(PlanNode):
    """A leaf: one command."""

    @property
    def deadline_s(self) -> float | None:
        """Seconds after which it fails; None if the time is limited above it."""
        return self.number(DEADLINE) if DEADLINE in self.ports else None

    @property
    def request(self) -> Request | None:
        """The request; None if an argument is read from the blackboard."""
        given = [self.ports.get(each.name) for each in self._declaration.user_arguments]
        if any(isinstance(each, CellReference) for each in given):
            return None
        request: Request = self._declaration.build_request(*given)
        return request

    def bound(self, cells: Cells) -> "PlanStep":
        """Return it with its arguments from the blackboard.

        Raises:
            UnknownValueError: an argument has no known value.
            ArgumentError: a value is none of its argument.
        """
        ports = dict(self.ports)
        for argument in self._declaration.user_arguments:
            value = self.ports.get(argument.name)
            if isinstance(value, CellReference):
                found = cells[value.cell]
                if found is None:
                    raise UnknownValueError(value.cell)
                ports[argument.name] = argument_value(argument, found)
        return replace(self, ports=ports)

    def request_from(self, cells: Cells) -> Request:
        """Return the request with the arguments of the blackboard; see `bound`."""
        request = self.bound(cells).request
        assert request is not None
        return request

    @property
    def _declaration(self) -> CommandDeclaration:
        assert self.kind.command is not None
        return self.kind.command


@dataclass(frozen=True, slots=True)
class Blackboard:
    """The cells of a plan.

    Attributes:
        names: name of each cell, after the path of its tree.
        initial: value of each cell when the plan begins; None as long as it is not written.
        telemetry: cells with telemetry, each with its name.
        numbers: cells that have numbers only.
    """

    names: tuple[str, ...] = ()
    initial: tuple[Value | None, ...] = ()
    telemetry: tuple[tuple[int, str], ...] = ()
    numbers: frozenset[int] = frozenset()


@dataclass(frozen=True, slots=True)
class PlanRoot(PlanNode):
    """The root of a plan; its child is the root node of the main tree.

    Attributes:
        resumes: whether it continues by itself after a restart of the executive.
        unused: trees that nothing runs and ports that no node reads, as lines and texts.
    """

    blackboard: Blackboard
    resumes: bool = False
    unused: tuple[tuple[int, str], ...] = ()


def digest_of(definition: PlanDefinition, root: PlanNode) -> str:
    """Return a digest of a plan's text and arguments, and of the nodes that were read from them."""
    table = [(each.kind.name, each.location.path, len(each.children)) for each in nodes(root)]
    arguments = [astuple(each) for each in definition.arguments]
    content = json.dumps([arguments, table], separators=(",", ":")).encode()
    return hashlib.sha256(definition.content + b"\0" + content).hexdigest()


def nodes(root: PlanNode) -> Iterator[PlanNode]:
    """Yield a node and all nodes below it."""
    yield root
    for child in root.children:
        yield from nodes(child)


def steps(root: PlanNode) -> tuple[PlanStep, ...]:
    """Return all leaves with a command."""
    return tuple(each for each in nodes(root) if isinstance(each, PlanStep))


MAX_LOOP_CYCLES: Final = 1000
MAX_READ_PARTS: Final = 100
"""Maximum number of parts of a queue that is read from the blackboard; chosen."""
LOOPS: Final[Mapping[str, str]] = {"Repeat": "num_cycles", "RetryUntilSuccessful": "num_attempts"}
"""Loops with a number of cycles, and its port."""


def parts_of(queue: str) -> tuple[str, ...]:
    """Return the parts of the queue of a loop."""
    return tuple(filter(None, (each.strip() for each in queue.split(";"))))


def part_values(loop: str, part: str) -> dict[str, Value]:
    """Return the values of the output ports of a loop for a part of its queue.

    Args:
        loop: name of the loop's kind.
        part: the part, as text.

    Raises:
        ArgumentError: the part is not as the loop needs it.
    """
    match loop:
        case "LoopString":
            return {"value": part}
        case "LoopDouble":
            return {"value": number("queue", part)}
        case _:
            return dict(zip(("x", "y", "heading"), position("queue", part), strict=False))


def resume_points(
    node: PlanNode, above: tuple[str, ...] = ()
) -> Iterator[tuple[PlanNode, tuple[str, ...]]]:
    """Yield the nodes at which a plan can be resumed, in order.

    They are those below nothing but sequences, each as a whole, with its path and the paths of the
    sequences that begin with it.
    """
    paths = (*above, node.location.path)
    if node.kind.name not in {"Sequence", "SubTree"} or node.conditions:
        yield node, paths
        return
    for child in node.children:
        yield from resume_points(child, paths)
        paths = ()


def skipped_nodes(
    root: PlanNode, step: str, last: str, ended: Collection[int]
) -> tuple[PlanNode, ...] | Refusal:
    """Return the nodes to skip from the interruption to a named step, or a refusal.

    A step that has ended cannot be named, because no step is repeated.

    Args:
        root: root node of the plan.
        step: name of the step: a path in the plan, or the end of one.
        last: path of the leaf that started or ended last.
        ended: numbers of the nodes that have ended.
    """
    points = tuple(resume_points(root))
    at = [each.location for each, _ in points]
    begun = [i for i, each in enumerate(at) if f"{last}/".startswith(f"{each.path}/")]
    after = range(max(begun, default=0), len(points))
    present = next((i for i in after if at[i].number not in ended), len(points))
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
