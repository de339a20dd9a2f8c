from pathlib import Path

from executive.commands.declaration import Family
from executive.commands.lifecycle import EDGES, mermaid
from executive.commands.modes import ACCEPTED, Mode
from executive.settings import load_settings
from trees.rover import preview
from trees.snapshot import as_text

CHECKOUT = Path(__file__).resolve().parents[2]


def test_the_core_is_drawn_from_its_own_tables() -> None:
    text = (CHECKOUT / "executive" / "README.md").read_text(encoding="utf-8")
    assert mermaid(EDGES) in text
    for family in Family:
        cells = ["yes" if mode in ACCEPTED[family] else "" for mode in Mode]
        assert f"| {family.value} | {' | '.join(cells)} |" in text


def test_the_tree_is_drawn_as_it_is_built() -> None:
    text = (CHECKOUT / "trees" / "README.md").read_text(encoding="utf-8")
    assert as_text(preview(load_settings("jackal"))) in text
