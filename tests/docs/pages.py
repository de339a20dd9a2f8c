"""What the documentation tells people to type."""

import re
from dataclasses import dataclass
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[2]
PAGES = [CHECKOUT / "README.md", *sorted((CHECKOUT / "docs").glob("*.md"))]
_FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_STATUS = re.compile(r"#.*exit status (\d+)")
_AS_SHIPPED = re.compile(r"\./rover scenario (\w+)(?: --out (\S+))?")


@dataclass(frozen=True, slots=True)
class Line:
    """A command line.

    Attributes:
        status: the exit status that the page promises.
    """

    text: str
    status: int


def blocks(page: Path, language: str) -> list[str]:
    """Return the fenced blocks of a language."""
    return [text for name, text in _FENCE.findall(page.read_text()) if name == language]


def lines(page: Path) -> list[Line]:
    """Return the command lines of a page."""
    found: list[Line] = []
    for block in blocks(page, "sh"):
        for line in block.replace("\\\n", "").splitlines():
            promised = _STATUS.search(line)
            text = re.sub(r"\s+#.*", "", line).strip()
            if text:
                found.append(Line(text, int(promised[1]) if promised else 0))
    return found


def as_shipped(page: Path) -> dict[str, tuple[str, bool]]:
    """Return the lines that play a scenario as it is, and whose files no other line uses.

    Each with the name of its scenario, and whether it writes files. `tests/scenarios` runs them.
    """
    found = {}
    typed = lines(page)
    for line in typed:
        if (match := _AS_SHIPPED.fullmatch(line.text)) and line.status == 0:
            name, folder = match.groups()
            if folder is None or not any(folder in each.text for each in typed if each != line):
                found[line.text] = name, folder is not None
    return found
