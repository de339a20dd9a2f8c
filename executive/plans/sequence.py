"""Plans that are one sequence of steps: `sequence_xml` writes such a plan, `steps_of` reads it.

A page edits these plans as a list. The text has one step per line, so that the line of a refusal
names its step.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from executive.commands import Motion, Waypoint, arguments_of
from executive.plans.dialect import DEADLINE, LEAVES
from executive.plans.model import CellReference, PlanNode, PlanStep

MOTION_DEADLINE_S: Final = 600.0
STEP_DEADLINE_S: Final = 60.0
"""Deadlines of steps that are written without one: of motions and of all others; chosen."""

_HEAD: Final = (
    '<root BTCPP_format="4" main_tree_to_execute="Plan">',
    '  <BehaviorTree ID="Plan">',
    "    <Sequence>",
)
_TAIL: Final = ("    </Sequence>", "  </BehaviorTree>", "</root>", "")
FIRST_LINE: Final = len(_HEAD) + 1
"""Line of the first step."""
_WAYPOINT: Final = tuple(each.name for each in arguments_of(Waypoint))


@dataclass(frozen=True, slots=True)
class WrittenStep:
    """A step to write, unchecked.

    Attributes:
        operation: name of its leaf.
        args: arguments by name, in SI units and radians; waypoints as objects in a list.
        name: name of the node; None for the operation.
        deadline_s: None for a default.
    """

    operation: str
    args: Mapping[str, Any]
    name: str | None = None
    deadline_s: float | None = None


def sequence_xml(written: Sequence[WrittenStep]) -> str:
    """Return the text of a plan that executes steps in order.

    Raises:
        ValueError: the name of an argument cannot be written.
    """
    return "\n".join((*_HEAD, *(f"      {_element(each)}" for each in written), *_TAIL))


def _element(step: WrittenStep) -> str:
    from xml.sax.saxutils import quoteattr

    leaf = LEAVES.get(step.operation)
    tag = f"Action ID={quoteattr(step.operation)}" if leaf is None else leaf.name
    is_motion = leaf is not None and issubclass(leaf.kind, Motion)
    deadline_s = step.deadline_s or (MOTION_DEADLINE_S if is_motion else STEP_DEADLINE_S)
    given = {"name": step.name, **step.args, DEADLINE: deadline_s}
    texts = [f"{_name(name)}={_value(each)}" for name, each in given.items() if each is not None]
    return f"<{' '.join((tag, *texts))}/>"


def _name(name: str) -> str:
    if not (name.isascii() and name.isidentifier()):
        raise ValueError(f"{name[:40]!r} is no name of an argument")
    return name


def _value(value: Any) -> str:
    from xml.sax.saxutils import quoteattr  # imports urllib.request: not until a plan is written

    return quoteattr(";".join(map(_item, value)) if isinstance(value, list) else str(value))


def _item(item: Any) -> str:
    """Return a waypoint; a missing part stays empty, which the check refuses."""
    if not isinstance(item, Mapping):
        return str(item)
    if unknown := item.keys() - set(_WAYPOINT):
        raise ValueError(f"a waypoint has no {min(unknown)[:40]!r}")
    parts = ["" if item.get(name) is None else str(item[name]) for name in _WAYPOINT]
    return ",".join(parts).rstrip(",")


def steps_of(root: PlanNode) -> tuple[PlanStep, ...] | PlanNode:
    """Return the steps of a plan that is one sequence, or the first node that prevents that."""
    (main,) = root.children
    children = main.children if main.kind.name == "Sequence" and not main.conditions else (main,)
    other = next((each for each in children if not _is_plain(each)), None)
    return other or tuple(each for each in children if isinstance(each, PlanStep))


def _is_plain(node: PlanNode) -> bool:
    """Return whether a node is a step that a list of steps can show as a whole."""
    variables = any(isinstance(each, CellReference) for each in node.ports.values())
    return isinstance(node, PlanStep) and not node.conditions and not variables
