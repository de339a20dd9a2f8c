"""`TreeSnapshot`: the behaviour tree as values; its drawings as text, Mermaid or SVG."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from enum import Enum, unique
from functools import cache
from typing import Final

from py_trees import composites
from py_trees.behaviour import Behaviour
from py_trees.common import Status
from py_trees.decorators import Decorator

from executive.commands.intake import SOURCE_PREFIX
from executive.plans import Role
from executive.values.plan_nodes import NodeStatus as NodeStatus
from executive.values.reports import Identity, Severity
from trees.leaf import Condition, TakeGoal
from trees.plan import PlanBehaviour


@unique
class NodeKind(Enum):
    """Kind of a node: TAKE activates a goal of a queue; PLANNED is a node of a plan."""

    SELECTOR = "selector"
    SEQUENCE = "sequence"
    PARALLEL = "parallel"
    DECORATOR = "decorator"
    CONDITION = "condition"
    TAKE = "take"
    LEAF = "leaf"
    PLANNED = "planned"


@unique
class DisplayStatus(Enum):
    """Displayed status of a node: DECLINED if it failed because there was no work."""

    IDLE = "not ticked"
    RUNNING = "running"
    SUCCESS = "success"
    DECLINED = "nothing to do"
    FAILURE = "failed"


@dataclass(frozen=True, slots=True)
class TreeNodeSnapshot:
    """One node.

    Attributes:
        path: stable path id, names from the root joined by slashes.
        depth: depth below the root.
        message: its feedback message. A TAKE node, a condition that holds for a command, and a leaf
            of a plan name their last command, as SOURCE:NUMBER.
    """

    path: str
    name: str
    depth: int
    kind: NodeKind
    status: NodeStatus
    message: str


@dataclass(frozen=True, slots=True)
class FaultSnapshot:
    """A fault that is active, with its evidence as a text."""

    name: str
    severity: Severity
    text: str

    def __str__(self) -> str:
        return f"{self.severity.name} {self.name}: {self.text}"


@dataclass(frozen=True, slots=True)
class TreeSnapshot:
    """All nodes in depth-first order, with the executive's status.

    Attributes:
        tick: number of the last tick before the snapshot.
        utc_s: time of the snapshot, seconds since 1970-01-01 UTC.
        why: one line on the rover's motion and its reason.
        unmonitored: one line on missing monitors.
    """

    tick: int
    utc_s: float
    mode: str
    why: str
    nodes: tuple[TreeNodeSnapshot, ...]
    faults: tuple[FaultSnapshot, ...] = ()
    unmonitored: str = ""
    active: Identity | None = None


def nodes(
    root: Behaviour, ticked: Collection[Behaviour], depth: int = 0
) -> tuple[TreeNodeSnapshot, ...]:
    """Return a root and all its descendants, in depth-first order.

    Nodes that the last tick did not reach are IDLE: py_trees leaves their status unchanged.
    """
    found: list[TreeNodeSnapshot] = []
    _add(found, root, ticked, root.name, depth)
    return tuple(found)


def _add(
    found: list[TreeNodeSnapshot],
    node: Behaviour,
    ticked: Collection[Behaviour],
    path: str,
    depth: int,
) -> None:
    status = _STATUSES[node.status] if node in ticked else NodeStatus.IDLE
    found.append(
        TreeNodeSnapshot(path, node.name, depth, _kind_of(node), status, node.feedback_message)
    )
    for child in node.children:
        _add(found, child, ticked, f"{path}/{child.name}", depth + 1)


_STATUSES: Final = {
    Status.INVALID: NodeStatus.IDLE,
    Status.RUNNING: NodeStatus.RUNNING,
    Status.SUCCESS: NodeStatus.SUCCESS,
    Status.FAILURE: NodeStatus.FAILURE,
}
_KINDS: Final[dict[type, NodeKind]] = {
    composites.Selector: NodeKind.SELECTOR,
    composites.Sequence: NodeKind.SEQUENCE,
    composites.Parallel: NodeKind.PARALLEL,
    Decorator: NodeKind.DECORATOR,
    Condition: NodeKind.CONDITION,
    TakeGoal: NodeKind.TAKE,
}


_PLAN_KINDS: Final = {
    Role.CONTROL: NodeKind.SELECTOR,
    Role.DECORATOR: NodeKind.DECORATOR,
    Role.SUBTREE: NodeKind.SEQUENCE,
    Role.CONDITION: NodeKind.CONDITION,
    Role.ACTION: NodeKind.LEAF,
}


def _kind_of(node: Behaviour) -> NodeKind:
    if not isinstance(node, PlanBehaviour):
        return _kind(type(node))
    name = node.plan.kind.name
    if "Sequence" in name or name == "TryCatch":
        return NodeKind.SEQUENCE
    return NodeKind.PARALLEL if "Parallel" in name else _PLAN_KINDS[node.plan.kind.role]


@cache
def _kind(of: type[Behaviour]) -> NodeKind:
    return next((kind for base, kind in _KINDS.items() if issubclass(of, base)), NodeKind.LEAF)


_MARK = {
    NodeKind.SELECTOR: "?",
    NodeKind.SEQUENCE: "→",
    NodeKind.PARALLEL: "⇉",
    NodeKind.DECORATOR: "◆",
    NodeKind.CONDITION: "◇",
    NodeKind.TAKE: "▸",
    NodeKind.LEAF: "▸",
    NodeKind.PLANNED: "·",
}
_BRANCHES: Final = {
    NodeKind.SELECTOR,
    NodeKind.SEQUENCE,
    NodeKind.PARALLEL,
    NodeKind.DECORATOR,
}
_GUARDS: Final = {NodeKind.CONDITION, NodeKind.TAKE}
_SIGN = {
    DisplayStatus.IDLE: " ",
    DisplayStatus.RUNNING: "●",
    DisplayStatus.SUCCESS: "✓",
    DisplayStatus.DECLINED: "–",
    DisplayStatus.FAILURE: "✕",
}
COLOURS: Final = {
    DisplayStatus.IDLE: ("#f4f4f2", "#9a9a94"),
    DisplayStatus.RUNNING: ("#dbe9ff", "#1d5fc4"),
    DisplayStatus.SUCCESS: ("#dff3e0", "#2b7a36"),
    DisplayStatus.DECLINED: ("#ececf2", "#77778a"),
    DisplayStatus.FAILURE: ("#f7e3e0", "#a3422f"),
}
"""Fill and edge colours."""
_ROW, _INDENT, _BOX_HEIGHT, _CHARACTER = 34, 34, 26, 7.6


def display_statuses(nodes: Sequence[TreeNodeSnapshot]) -> tuple[DisplayStatus, ...]:
    """Return the displayed status of each node.

    A false condition and an empty queue are no failures, nor is a branch that
    failed because of them; a leaf that failed is one, and so are the branches above it.
    """
    found = [
        DisplayStatus.DECLINED
        if node.status is NodeStatus.FAILURE and node.kind in _GUARDS
        else DisplayStatus[node.status.name]
        for node in nodes
    ]
    for index, node in enumerate(nodes):
        if found[index] is not DisplayStatus.FAILURE or node.kind not in _BRANCHES:
            continue
        leaves = set()
        for below, display in zip(nodes[index + 1 :], found[index + 1 :], strict=True):
            if below.depth <= node.depth:
                break
            if below.kind not in _BRANCHES:
                leaves.add(display)
        if DisplayStatus.FAILURE not in leaves and DisplayStatus.DECLINED in leaves:
            found[index] = DisplayStatus.DECLINED
    return tuple(found)


def commands_by_node(nodes: Sequence[TreeNodeSnapshot]) -> tuple[str | None, ...]:
    """Return the present or last command of each node, as SOURCE:NUMBER.

    It is named by the node itself if it is a leaf of a plan, otherwise by the guard at the start of
    its branch; None if neither names one.
    """
    found: list[str | None] = []
    above: list[int] = []
    for index, node in enumerate(nodes):
        del above[node.depth :]
        in_plan = node.path.startswith(SOURCE_PREFIX)
        if node.kind in _GUARDS and node.message and above and not in_plan:
            found[above[-1]] = node.message
        if node.message.startswith(SOURCE_PREFIX):
            found.append(node.message)
        else:
            found.append(found[above[-1]] if above else None)
        above.append(index)
    return tuple(found)


def line(node: TreeNodeSnapshot, display: DisplayStatus) -> str:
    """Return the text of a node: its mark, its name, its status."""
    message = f"  {node.message}" if node.message and node.status is NodeStatus.RUNNING else ""
    return f"{_MARK[node.kind]} {node.name} {_SIGN[display]}{message}".rstrip()


def as_text(nodes: Sequence[TreeNodeSnapshot]) -> str:
    """Return the tree drawn with box characters, one node per line."""
    return "\n".join(
        branch + line(node, display)
        for branch, node, display in zip(
            branches(nodes), nodes, display_statuses(nodes), strict=True
        )
    )


def branches(nodes: Sequence[TreeNodeSnapshot]) -> list[str]:
    """Return the box characters before each node."""
    drawn: list[str] = []
    open_below: list[bool] = []
    for index, node in enumerate(nodes):
        if node.depth == 0:
            drawn.append("")
            continue
        later = (each.depth for each in nodes[index + 1 :] if each.depth <= node.depth)
        more = next(later, 0) == node.depth
        del open_below[node.depth - 1 :]
        drawn.append(
            "".join("│  " if still else "   " for still in open_below) + ("├─ " if more else "└─ ")
        )
        open_below.append(more)
    return drawn


def as_mermaid(nodes: Sequence[TreeNodeSnapshot]) -> str:
    """Return a Mermaid flowchart."""
    lines = ["flowchart TD"]
    parents: list[int] = []
    for index, (node, display) in enumerate(zip(nodes, display_statuses(nodes), strict=True)):
        del parents[node.depth :]
        label = f"{_MARK[node.kind]} {node.name}".replace('"', "'")
        lines.append(f'    n{index}["{label}"]:::{display.name.lower()}')
        if parents:
            lines.append(f"    n{parents[-1]} --> n{index}")
        parents.append(index)
    for display, (fill, stroke) in COLOURS.items():
        lines.append(f"    classDef {display.name.lower()} fill:{fill},stroke:{stroke}")
    return "\n".join(lines) + "\n"


def as_svg(nodes: Sequence[TreeNodeSnapshot], title: str = "") -> str:
    """Return an SVG of the tree, one row per node, coloured by status, with a legend if it ran."""
    from xml.sax.saxutils import escape  # imports urllib.request: not aboard

    top = 44 if title else 12
    seen = display_statuses(nodes)
    lines = [line(node, display) for node, display in zip(nodes, seen, strict=True)]
    widths = [len(each) * _CHARACTER + 20 for each in lines]
    legend = list(DisplayStatus) if {*seen} != {DisplayStatus.IDLE} else []
    across = [len(f"{_SIGN[display]} {display.value}") * _CHARACTER + 20 for display in legend]
    width = max(
        [12 + node.depth * _INDENT + box + 12 for node, box in zip(nodes, widths, strict=True)]
        + [len(title) * _CHARACTER + 24, sum(across) + 8 * len(across) + 24]
    )
    bottom = top + len(nodes) * _ROW + 8
    height = bottom + (_ROW + 4 if legend else 0)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height}"'
        f' viewBox="0 0 {width:.0f} {height}" font-family="DejaVu Sans Mono, monospace"'
        ' font-size="12.5">',
        f'<rect width="{width:.0f}" height="{height}" fill="#ffffff"/>',
    ]
    if title:
        parts.append(f'<text x="12" y="26" fill="#333333">{escape(title)}</text>')
    rows: list[int] = []
    for index, (node, box, text) in enumerate(zip(nodes, widths, lines, strict=True)):
        x, y = 12 + node.depth * _INDENT, top + index * _ROW
        del rows[node.depth :]
        if rows:
            stem = 12 + (node.depth - 1) * _INDENT + 12
            parts.append(
                f'<path d="M{stem} {rows[-1] + _BOX_HEIGHT} V{y + _BOX_HEIGHT / 2} H{x}"'
                ' fill="none" stroke="#b8b8b2"/>'
            )
        rows.append(y)
        parts += _box(x, y, box, text, seen[index])
    for at, (display, box) in enumerate(zip(legend, across, strict=True)):
        left = 12 + sum(across[:at]) + 8 * at
        parts += _box(left, bottom, box, f"{_SIGN[display]} {display.value}", display)
    return "\n".join([*parts, "</svg>"]) + "\n"


def _box(x: float, y: float, width: float, text: str, display: DisplayStatus) -> tuple[str, str]:
    from xml.sax.saxutils import escape

    fill, stroke = COLOURS[display]
    return (
        f'<rect x="{x:.0f}" y="{y}" width="{width:.0f}" height="{_BOX_HEIGHT}" rx="5"'
        f' fill="{fill}" stroke="{stroke}"/>',
        f'<text x="{x + 10:.0f}" y="{y + 17}" fill="#222222">{escape(text)}</text>',
    )
