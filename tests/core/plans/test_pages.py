"""What is written of plans is what they are."""

from pathlib import Path

from executive.commands.lifecycle import mermaid
from executive.plans.builder import MOST_COMMANDS, MOST_NODES, MOST_TIMES
from executive.plans.engine import MOST_PLANS
from executive.plans.leaves import LEAVES
from executive.plans.plan_xml import (
    CONTROLS,
    DECORATORS,
    DEEPEST,
    LARGEST_PLAN,
    LONGEST_VALUE,
    MOST_PLACES,
    SUBTREE,
)
from executive.plans.register import PLAN_EDGES

CHECKOUT = Path(__file__).resolve().parents[3]
PAGE = (CHECKOUT / "docs" / "write-a-plan.md").read_text(encoding="utf-8")
ROOM = (CHECKOUT / "executive" / "plans" / "README.md").read_text(encoding="utf-8")


def test_the_page_has_every_leaf() -> None:
    rows = []
    for leaf in LEAVES.values():
        attributes = "; ".join(
            f"`{parameter.name}` ({parameter.help}{'' if parameter.required else ', optional'})"
            for parameter in leaf.parameters
        )
        rows.append(f"| `{leaf.name}` | {leaf.operation} | {attributes} |")
    assert "\n".join(rows) in PAGE


def test_the_page_has_every_node() -> None:
    for node in (*CONTROLS, *DECORATORS, SUBTREE):
        assert f"\n| `{node}` |" in PAGE


def test_the_life_is_drawn_from_its_table() -> None:
    assert mermaid(PLAN_EDGES) in PAGE
    assert mermaid(PLAN_EDGES) in ROOM


def test_the_bounds_are_told() -> None:
    told = (
        f"{LARGEST_PLAN // 1024} KiB, {MOST_NODES} nodes once subtrees are put in their places,"
        f" {DEEPEST} levels, {MOST_TIMES} times round a loop, {MOST_COMMANDS:_} commands if all"
        f" loops run as often as they may, {MOST_PLANS} plans aboard, {MOST_PLACES} waypoints in a"
        f" leaf (an asset may have less), {LONGEST_VALUE:_} characters in a value"
    )
    assert told.replace("_", " ") in PAGE.replace("\n", " ")
