"""The tree at a moment, as values: what each node is, where it stands, and what it did."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from enum import Enum, unique

from py_trees import composites
from py_trees.behaviour import Behaviour
from py_trees.common import Status
from py_trees.decorators import Decorator

from trees.leaf import Condition
from trees.plan import Together


@unique
class NodeKind(Enum):
    """What a node is."""

    SELECTOR = "selector"
    SEQUENCE = "sequence"
    PARALLEL = "parallel"
    DECORATOR = "decorator"
    CONDITION = "condition"
    LEAF = "leaf"


@unique
class NodeStatus(Enum):
    """What a node did when last ticked; IDLE if that was not in this tick."""

    IDLE = "idle"
    RUNNING = "running"
    SUCCESS = "success"
    FAILURE = "failure"


@dataclass(frozen=True, slots=True)
class Node:
    """One node.

    Attributes:
        path: stable path id, names from the root joined by slashes.
        depth: steps from the root.
        message: what it says of itself.
    """

    path: str
    name: str
    depth: int
    kind: NodeKind
    status: NodeStatus
    message: str


@dataclass(frozen=True, slots=True)
class Snapshot:
    """All nodes in depth-first order, with what the executive says of itself.

    Attributes:
        tick: number of the tick after which it was taken.
        utc_s: when, seconds since 1970-01-01 UTC.
        mode: the asset's mode.
        why: one line on why the rover stands, or what moves it.
    """

    tick: int
    utc_s: float
    mode: str
    why: str
    nodes: tuple[Node, ...]


def nodes(root: Behaviour, ticked: Collection[Behaviour], depth: int = 0) -> tuple[Node, ...]:
    """Return all nodes below and with a root, in depth-first order.

    Args:
        root: where to begin.
        ticked: the nodes that the last tick came to; py_trees leaves the others as they were.
        depth: of the root.
    """
    return tuple(_nodes(root, ticked, "", depth))


def _nodes(
    node: Behaviour, ticked: Collection[Behaviour], prefix: str, depth: int
) -> Iterator[Node]:
    path = f"{prefix}/{node.name}" if prefix else node.name
    status = _STATUS[node.status] if node in ticked else NodeStatus.IDLE
    yield Node(path, node.name, depth, _kind(node), status, node.feedback_message)
    for child in node.children:
        yield from _nodes(child, ticked, path, depth + 1)


def _kind(node: Behaviour) -> NodeKind:
    match node:
        case composites.Selector():
            return NodeKind.SELECTOR
        case composites.Sequence():
            return NodeKind.SEQUENCE
        case composites.Parallel():
            return NodeKind.PARALLEL
        case Together():
            return NodeKind.PARALLEL
        case Decorator():
            return NodeKind.DECORATOR
        case Condition():
            return NodeKind.CONDITION
        case _:
            return NodeKind.LEAF


_STATUS = {
    Status.INVALID: NodeStatus.IDLE,
    Status.RUNNING: NodeStatus.RUNNING,
    Status.SUCCESS: NodeStatus.SUCCESS,
    Status.FAILURE: NodeStatus.FAILURE,
}
