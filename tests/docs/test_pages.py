"""The pages hang together, say what there is, and have examples that are true."""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import click
import pytest
from click.testing import CliRunner
from PIL import Image

from adapters.cli.main import main
from executive.commands import ACCEPTED, Family, Mode
from executive.commands.lifecycle import EDGES, Edge, terminal_states
from executive.plans import DIALECT, plan_xml
from executive.plans.arguments import MAX_VALUE_LENGTH, MAX_WAYPOINTS
from executive.plans.builder import MAX_COMMANDS, MAX_NODES
from executive.plans.dialect import PRECONDITIONS, TELEMETRY
from executive.plans.model import MAX_LOOP_CYCLES
from executive.plans.plan_lifecycle import PLAN_EDGES
from executive.plans.planner import MAX_PLANS
from executive.plans.syntax import _POWERS
from executive.settings import load_settings
from tests.docs.pages import CHECKOUT, PAGES
from trees.rover import preview
from trees.snapshot import as_text

MORE = ("ARCHITECTURE.md", "CHANGELOG.md", "CONTRIBUTING.md")
NAMED = [*PAGES, *(CHECKOUT / name for name in MORE)]
PACKAGES = ("executive", "trees", "adapters", "sim", "config", "tests")
LINKED = [
    *NAMED,
    *sorted(page for package in PACKAGES for page in (CHECKOUT / package).rglob("README.md")),
]
IMAGES = CHECKOUT / "docs" / "images"


def anchor(heading: str) -> str:
    """Return the anchor that a heading gets on the usual hosts."""
    stored = re.sub(r"[^\w\- ]", "", heading.strip().lower())
    return stored.replace(" ", "-")


@pytest.mark.parametrize("page", LINKED, ids=lambda page: str(page.relative_to(CHECKOUT)))
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text()):
        if target.startswith("http"):
            continue
        path, _, section = target.partition("#")
        linked = (page.parent / path).resolve() if path else page
        assert linked.exists(), target
        if section:
            headings = re.findall(r"^#+ (.*)$", linked.read_text(), re.MULTILINE)
            assert section in map(anchor, headings), target


@pytest.mark.parametrize("page", NAMED, ids=lambda page: page.name)
def test_files_that_are_named_exist(page: Path) -> None:
    folders = r"(?:executive|trees|adapters|sim|tests|config|docs)"
    for name in re.findall(rf"`({folders}/[\w./-]+?)/?`", page.read_text()):
        if "scout" not in name and name != "executive/cmd_vel":  # a topic
            assert (CHECKOUT / name).exists(), f"{page.name} names {name}"


def test_every_page_is_in_the_index() -> None:
    index = (CHECKOUT / "README.md").read_text()
    assert [page.name for page in PAGES[1:] if f"](docs/{page.name})" not in index] == []


def test_pictures_are_small_and_decode() -> None:
    total = 0
    for path in IMAGES.iterdir():
        total += path.stat().st_size
        if path.suffix == ".svg":
            ElementTree.fromstring(path.read_text())
        else:
            with Image.open(path) as picture:
                picture.load()
    assert 0 < total < 500_000


PAGE = (CHECKOUT / "docs" / "write-a-plan.md").read_text()


def mermaid(edges: Sequence[Edge[Any, Any]]) -> str:
    """Return a table of edges as a Mermaid state diagram."""
    lines = ["stateDiagram-v2", f"    [*] --> {edges[0].source.name}"]
    lines += [f"    {e.source.name} --> {e.target.name}: {e.event.value}" for e in edges]
    lines += [f"    {state.name} --> [*]" for state in terminal_states(edges)]
    return "\n".join(lines) + "\n"


def test_the_page_has_every_node() -> None:
    for kind in DIALECT.values():
        assert kind.command is not None or f"\n| `{kind.name}` |" in PAGE, kind.name


def test_the_page_has_all_that_scripts_read() -> None:
    for name, meaning in TELEMETRY.items():
        assert f"\n| `@{name}` | {meaning} |" in PAGE
    for sign in _POWERS:
        assert f"`{sign}`" in PAGE or f" {sign} " in PAGE, sign
    assert ", ".join(f"`{name}`" for name in PRECONDITIONS) in PAGE


def test_the_life_cycle_is_drawn_from_its_table() -> None:
    assert mermaid(PLAN_EDGES) in PAGE


def test_the_bounds_are_documented() -> None:
    reported = (
        f"A plan has at most {plan_xml.MAX_PLAN_OCTETS // 1024} KiB, {MAX_NODES} nodes with"
        f" all subtrees included, {plan_xml.MAX_DEPTH} levels, {MAX_LOOP_CYCLES} cycles"
        f" of a loop, and {MAX_COMMANDS:_} leaves if all loops run as often as they may. A leaf"
        f" has at most {MAX_WAYPOINTS} waypoints (an asset may allow fewer), a value at"
        f" most {MAX_VALUE_LENGTH:_} characters. At most {MAX_PLANS} plans are stored"
        " aboard."
    )
    assert reported.replace("_", " ") in PAGE.replace("\n", " ")


def test_the_core_is_drawn_from_its_own_tables() -> None:
    text = (CHECKOUT / "executive" / "commands" / "README.md").read_text()
    assert mermaid(EDGES) in text
    for family in Family:
        cells = ["yes" if mode in ACCEPTED[family] else "" for mode in Mode]
        assert f"| {family.value} | {' | '.join(cells)} |" in text


def test_the_tree_is_drawn_as_it_is_built() -> None:
    text = (CHECKOUT / "trees" / "README.md").read_text()
    assert as_text(preview(load_settings("jackal"))) in text


def commands(command: click.Command, context: click.Context) -> Iterator[str]:
    """Yield the words of a command and of all below it."""
    yield context.command_path.partition(" ")[2]
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            below = command.get_command(context, name)
            assert below is not None
            yield from commands(below, click.Context(below, parent=context, info_name=name))


@pytest.mark.parametrize("path", list(commands(main, click.Context(main, info_name="rover"))))
def test_help_has_an_example_that_can_be_typed(path: str) -> None:
    reported = CliRunner().invoke(main, [*path.split(), "--help"])
    assert reported.exit_code == 0
    _, word, examples = reported.output.partition("Example")
    assert word
    assert f"rover {path}".rstrip() in examples
