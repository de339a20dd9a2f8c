"""What the documentation tells people to type."""

import re
from dataclasses import dataclass
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[2]
PAGES = [CHECKOUT / "README.md", *sorted((CHECKOUT / "docs").glob("*.md"))]
_FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_STATUS = re.compile(r"#.*exit status (\d+)")


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
