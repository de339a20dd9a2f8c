"""The pages hang together: links lead somewhere, examples are true."""

import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
from PIL import Image

from tests.docs.pages import CHECKOUT, PAGES

LINKED = [*PAGES, CHECKOUT / "ARCHITECTURE.md", CHECKOUT / "CONTRIBUTING.md"]
IMAGES = CHECKOUT / "docs" / "images"


def anchor(heading: str) -> str:
    """Return the anchor that a heading gets on the usual hosts."""
    kept = re.sub(r"[^\w\- ]", "", heading.strip().lower())
    return kept.replace(" ", "-")


@pytest.mark.parametrize("page", LINKED, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text()):
        if target.startswith("http"):
            continue
        path, _, place = target.partition("#")
        linked = (page.parent / path).resolve() if path else page
        assert linked.exists(), target
        if place:
            headings = re.findall(r"^#+ (.*)$", linked.read_text(), re.MULTILINE)
            assert place in map(anchor, headings), target


@pytest.mark.parametrize("page", LINKED, ids=lambda page: page.name)
def test_files_that_are_named_exist(page: Path) -> None:
    rooms = r"(?:executive|trees|adapters|sim|tests|config|docs)"
    for name in re.findall(rf"`({rooms}/[\w./-]+?)/?`", page.read_text()):
        if "scout" not in name:
            assert (CHECKOUT / name).exists(), f"{page.name} names {name}"


def test_every_page_is_in_the_index() -> None:
    index = (CHECKOUT / "docs" / "README.md").read_text()
    for page in PAGES[1:]:
        assert page.name == "README.md" or f"]({page.name})" in index


def test_pictures_are_small_and_decode() -> None:
    total = 0
    for path in IMAGES.iterdir():
        total += path.stat().st_size
        if path.suffix == ".svg":
            ElementTree.fromstring(path.read_text())
        else:
            with Image.open(path) as picture:
                picture.load()
    assert 0 < total < 300_000
