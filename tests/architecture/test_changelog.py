"""The fragments of the changelog have a known type, and are a few plain sentences."""

import re
import tomllib
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[2]
TOWNCRIER = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["tool"]["towncrier"]
FRAGMENTS = CHECKOUT / TOWNCRIER["directory"]
NAME = re.compile(rf"{TOWNCRIER['issue_pattern']}\.({'|'.join(TOWNCRIER['fragment'])})\.md")
MAX_SENTENCES = 3
MAX_SENTENCE = 30
"""Of a sentence."""


def faults(name: str, text: str) -> list[str]:
    """Return what is wrong with a fragment."""
    found = []
    if not NAME.fullmatch(name):
        found.append(f"its name is not NAME.TYPE.md, TYPE one of {list(TOWNCRIER['fragment'])}")
    if not re.fullmatch(r"[A-Z`].*\.\n", text, re.DOTALL) or "\n\n" in text:
        found.append("it is not one paragraph from a capital or a backtick to a full stop")
    if re.search(r"^\s*([-*#>|]|\d+\.|```)", text, re.MULTILINE):
        found.append("it has a list, a heading or a block")
    sentences = re.split(r"(?<=[.!?])\s+", text.strip())
    if len(sentences) > MAX_SENTENCES:
        found.append(f"it has {len(sentences)} sentences, more than {MAX_SENTENCES}")
    if max(len(sentence.split()) for sentence in sentences) > MAX_SENTENCE:
        found.append(f"a sentence has more than {MAX_SENTENCE} words")
    return found


def test_every_fragment_is_a_few_sentences_of_a_known_type() -> None:
    fragments = [path for path in FRAGMENTS.iterdir() if path.name != ".gitkeep"]
    found = {path.name: faults(path.name, path.read_text()) for path in fragments}
    assert {name: wrong for name, wrong in found.items() if wrong} == {}


SENTENCE = "A stop is confirmed.\n"


def test_a_fragment_that_is_right_passes() -> None:
    assert faults("relay-stop.fixed.md", SENTENCE) == []
    assert faults("x2.added.md", "`rover x` draws a\nrecording. It needs `--out`.\n") == []


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("relay-stop.md", SENTENCE),
        ("relay-stop.bugfix.md", SENTENCE),
        ("Relay stop.fixed.md", SENTENCE),
        ("relay-stop.fixed.rst", SENTENCE),
        ("a.fixed.md", "\n"),
        ("a.fixed.md", "a stop is confirmed.\n"),
        ("a.fixed.md", "A stop is confirmed\n"),
        ("a.fixed.md", "- A stop is confirmed.\n"),
        ("a.fixed.md", "A stop:\n- is confirmed.\n"),
        ("a.fixed.md", "One.\n\nTwo.\n"),
        ("a.fixed.md", "One. Two. Three. Four.\n"),
        ("a.fixed.md", "Word " * MAX_SENTENCE + "word.\n"),
    ],
)
def test_a_fragment_that_is_wrong_is_found(name: str, text: str) -> None:
    assert faults(name, text)


def test_releases_are_inserted_above_the_first() -> None:
    page = (CHECKOUT / TOWNCRIER["filename"]).read_text()
    marker = page.index("<!-- towncrier release notes start -->\n")
    assert page.index("\n## ") > marker
