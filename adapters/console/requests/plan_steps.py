"""Plans as a list of steps, which pages edit: `sequence_xml` writes one, `steps_of` reads it.

A step is a node without children (a command, wait, question, condition or script), with its own
conditions and at most a `Precondition` around it. The text has one step per line, so that the line
of a refusal names its step.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final
from xml.sax.saxutils import quoteattr

from executive.commands import Motion, Waypoint, argument_values, arguments_of
from executive.plans import (
    CONDITIONS,
    DEADLINE,
    DIALECT,
    CellReference,
    Element,
    PlanNode,
    PlanRoot,
    PlanStep,
    main_tree,
    ports_of,
    read_xml,
    trees_of,
)

MOTION_DEADLINE_S: Final = 600.0
STEP_DEADLINE_S: Final = 60.0
"""Deadlines of commands that are written without one: of motions and of all others; chosen."""

_HEAD: Final = (
    '<root BTCPP_format="4" main_tree_to_execute="Plan">',
    '  <BehaviorTree ID="Plan">',
    "    <Sequence>",
)
_TAIL: Final = ("    </Sequence>", "  </BehaviorTree>", "</root>", "")
FIRST_LINE: Final = len(_HEAD) + 1
"""Line of the first step."""
GUARD: Final = DIALECT["Precondition"]
"""The node around a guarded step; its ports are conditions of the step."""
_GUARD_PORTS: Final = tuple(each.name for each in GUARD.ports)
_WAYPOINT: Final = tuple(each.name for each in arguments_of(Waypoint))


@dataclass(frozen=True, slots=True)
class WrittenStep:
    """A step to write, unchecked.

    Attributes:
        operation: name of the kind of its node.
        args: arguments by name, in SI units and radians; waypoints as objects in a list.
        name: name of the node; None for the operation.
        deadline_s: None for a default.
        conditions: scripts by attribute, and ports of `GUARD`; empty texts are omitted.
    """

    operation: str
    args: Mapping[str, Any]
    name: str | None = None
    deadline_s: float | None = None
    conditions: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class DraftStep:
    """A step of a draft.

    Attributes:
        node: path of its leaf, as in `PlanProgress` and in previews.
        name, operation: name of its node, and of its kind.
        args: arguments of a command by name, in SI units and radians, as in `CommandStatus`; of
            another node the texts of its ports.
        deadline: timeout of a command, s; None if the plan sets another limit.
        line: its line in the XML.
        conditions: see `WrittenStep`.
    """

    node: str
    name: str
    operation: str
    args: dict[str, Any]
    deadline: float | None
    line: int
    conditions: dict[str, str]


def sequence_xml(written: Sequence[WrittenStep]) -> str:
    """Return the text of a plan that executes steps in order.

    Raises:
        ValueError: the name of an argument or of a condition cannot be written.
    """
    return "\n".join((*_HEAD, *(f"      {_element(each)}" for each in written), *_TAIL))


def _element(step: WrittenStep) -> str:
    if unknown := step.conditions.keys() - {*CONDITIONS, *_GUARD_PORTS}:
        raise ValueError(f"{min(unknown)[:40]!r} is no condition")
    kind, deadline_s = DIALECT.get(step.operation), step.deadline_s
    tag = f"Action ID={quoteattr(step.operation)}" if kind is None else kind.name
    if deadline_s is None and kind is not None and kind.command is not None:
        is_motion = issubclass(kind.command.kind, Motion)
        deadline_s = MOTION_DEADLINE_S if is_motion else STEP_DEADLINE_S
    given = {name: text for name, text in step.conditions.items() if text}
    guard = {name: given.pop(name) for name in _GUARD_PORTS if name in given}
    named: dict[str, Any] = {"name": step.name, **step.args}
    if deadline_s is not None:
        named[DEADLINE] = deadline_s
    node = f"<{tag}{_attributes(named)}{_attributes(given)}/>"
    return f"<{GUARD.name}{_attributes(guard)}>{node}</{GUARD.name}>" if guard else node


def _attributes(given: Mapping[str, Any]) -> str:
    texts = {_name(name): _value(each) for name, each in given.items() if each is not None}
    return "".join(f" {name}={text}" for name, text in texts.items())


def _name(name: str) -> str:
    if not (name.isascii() and name.isidentifier()):
        raise ValueError(f"{name[:40]!r} is no name of an argument")
    return name


def _value(value: Any) -> str:
    return quoteattr(";".join(map(_item, value)) if isinstance(value, list) else str(value))


def _item(item: Any) -> str:
    """Return a waypoint; a missing part stays empty, which the check refuses."""
    if not isinstance(item, Mapping):
        return str(item)
    if unknown := item.keys() - set(_WAYPOINT):
        raise ValueError(f"a waypoint has no {min(unknown)[:40]!r}")
    parts = ["" if item.get(name) is None else str(item[name]) for name in _WAYPOINT]
    return ",".join(parts).rstrip(",")


def steps_of(root: PlanRoot, content: bytes) -> tuple[DraftStep, ...] | PlanNode:
    """Return the steps of a plan that is one sequence, or the first node that prevents that.

    That is the root if the plan continues by itself after a restart: a list has no field for that.

    Args:
        root: the plan that was read.
        content: its text, which has the ports as they are written.
    """
    if root.resumes:
        return root
    (main,), text = root.children, read_xml(content)
    trees = trees_of(text)
    (element,) = trees[main_tree(text, trees)].children
    pairs = [(main, element)]
    if main.kind.name == "Sequence" and not main.conditions:
        pairs = list(zip(main.children, element.children, strict=True))
    found = []
    for node, written in pairs:
        step = _step(node, written)
        if step is None:
            return node
        found.append(step)
    return tuple(found)


def _step(node: PlanNode, element: Element) -> DraftStep | None:
    """Return a node as a step; None if a list of steps cannot show it as a whole."""
    conditions = {}
    if node.kind is GUARD and not node.conditions and "name" not in element.attributes:
        conditions = ports_of(element)
        (node,), (element,) = node.children, element.children
    if node.kind.max_children != 0:
        return None
    conditions |= {each: element.attributes[each] for each in node.conditions}
    location, name, args = node.location, node.location.name, dict[str, Any](ports_of(element))
    deadline_s = None
    if isinstance(node, PlanStep):
        if any(isinstance(each, CellReference) for each in node.ports.values()):
            return None
        assert node.request is not None  # no argument is read from the blackboard
        args, deadline_s = argument_values(node.request), node.deadline_s
    elif node.kind.port("name") is not None:
        name, args["name"] = node.kind.name, element.attributes["name"]
    kind = node.kind.name
    return DraftStep(location.path, name, kind, args, deadline_s, location.line, conditions)


def commands_of(root: PlanNode) -> tuple[PlanStep, ...] | None:
    """Return the commands of a plan that is nothing but a sequence of them; None for others."""
    (main,) = root.children
    plain = main.kind.name == "Sequence" and not main.conditions
    children = main.children if plain else (main,)
    found = tuple(each for each in children if isinstance(each, PlanStep) and not each.conditions)
    is_known = all(each.request is not None for each in found)
    return found if len(found) == len(children) and is_known else None
