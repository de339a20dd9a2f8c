"""What the pages say is what there is."""

from pathlib import Path

from executive.commands import ACCEPTED, Mode
from executive.commands.declaration import Family
from executive.commands.lifecycle import EDGES, mermaid
from executive.plans.builder import MOST_COMMANDS, MOST_NODES, MOST_TIMES
from executive.plans.plan_xml import (
    CONTROLS,
    DECORATORS,
    DEEPEST,
    LARGEST_PLAN,
    LONGEST_VALUE,
    MOST_PLACES,
    SUBTREE,
)
from executive.plans.planner import MOST_PLANS, PLAN_EDGES
from executive.settings import load_settings
from trees.rover import preview
from trees.snapshot import as_text

CHECKOUT = Path(__file__).resolve().parents[2]
PAGE = (CHECKOUT / "docs" / "write-a-plan.md").read_text(encoding="utf-8")
ROOM = (CHECKOUT / "executive" / "plans" / "README.md").read_text(encoding="utf-8")


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


def test_the_core_is_drawn_from_its_own_tables() -> None:
    text = (CHECKOUT / "executive" / "commands" / "README.md").read_text(encoding="utf-8")
    assert mermaid(EDGES) in text
    for family in Family:
        cells = ["yes" if mode in ACCEPTED[family] else "" for mode in Mode]
        assert f"| {family.value} | {' | '.join(cells)} |" in text


def test_the_tree_is_drawn_as_it_is_built() -> None:
    text = (CHECKOUT / "trees" / "README.md").read_text(encoding="utf-8")
    assert as_text(preview(load_settings("jackal"))) in text
