"""The words of a plan: nodes of BehaviorTree.CPP v4 that are known, and what they may carry."""

from collections.abc import Collection
from re import compile as pattern
from typing import Final

from executive.plans.faults import PlanError
from executive.plans.reading import Element
from executive.plans.untaken import WHY, perhaps, told
from executive.reasons import Reason

FORMAT: Final = "BTCPP4"
"""Name of the format of plans."""

CONTROLS: Final = frozenset({"Sequence", "Fallback", "Parallel"})
DECORATORS: Final = frozenset({"RetryUntilSuccessful", "Repeat", "Timeout", "Inverter"})
EXPLICIT: Final = frozenset({"Action", "Control", "Decorator"})
"""Elements that name their node by the attribute ID; all others are named by their tag."""

SUBTREE: Final = "SubTree"
AUTOREMAP: Final = "_autoremap"
REMARKS: Final = frozenset({"_uid", "_fullpath", "_description"})
"""Attributes that editors leave behind and that mean nothing."""

_PLAN_ID: Final = pattern(r"[A-Za-z0-9_.-]{1,64}")
LONGEST_NAME: Final = 80


def is_plan_id(text: str) -> bool:
    """Whether a text can name a plan."""
    return _PLAN_ID.fullmatch(text) is not None


def kind_of(element: Element) -> str:
    """Return which node an element means.

    Raises:
        PlanError: it should say so by an ID and does not.
    """
    if element.tag not in EXPLICIT:
        return element.tag
    kind = element.attributes.get("ID")
    if not kind:
        raise PlanError(
            Reason.PLAN_BAD_ARGUMENT, element.line, f"<{element.tag}> needs the attribute ID"
        )
    return kind


def known_kind(element: Element, trees: Collection[str], leaves: Collection[str]) -> str:
    """Return which node an element means.

    Raises:
        PlanError: there is no such node, or tree.
    """
    kind = kind_of(element)
    if kind == SUBTREE:
        tree = element.attributes.get("ID")
        if not tree:
            raise PlanError(
                Reason.PLAN_BAD_ARGUMENT, element.line, "<SubTree> needs the attribute ID"
            )
        if tree not in trees:
            raise PlanError(
                Reason.PLAN_UNKNOWN_NODE,
                element.line,
                f"there is no tree {told(tree)}{perhaps(tree, trees)}",
            )
        return kind
    if kind not in CONTROLS and kind not in DECORATORS and kind not in leaves:
        raise PlanError(Reason.PLAN_UNKNOWN_NODE, element.line, _unknown(kind, leaves))
    return kind


def name_of(element: Element, default: str) -> str:
    """Return what a node is called.

    Raises:
        PlanError: the name cannot stand in a path.
    """
    name = element.attributes.get("name", default)
    if not name or len(name) > LONGEST_NAME or "/" in name or not name.isprintable():
        raise PlanError(
            Reason.PLAN_BAD_ARGUMENT,
            element.line,
            f"name {name[:40]!r}: 1 to {LONGEST_NAME} printable characters, no slash",
        )
    return name


def _unknown(kind: str, leaves: Collection[str]) -> str:
    if kind in WHY:
        return f"{kind}: {WHY[kind]}"
    near = perhaps(kind, [*CONTROLS, *DECORATORS, SUBTREE, *leaves])
    return f"unknown node {told(kind)}{near}"
