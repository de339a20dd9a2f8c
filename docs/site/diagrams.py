"""Shows a state diagram in Mermaid as a table of its transitions, without a script."""

import re
from typing import Any, ClassVar, Final

from docutils import nodes
from sphinx.util.docutils import SphinxDirective

_EDGE: Final = re.compile(r"(\S+) --> (\S+?)(?:: (.+))?")
_NAMES: Final = {"[*]": "–"}


class StateDiagram(SphinxDirective):
    """A fence ```mermaid. A diagram of another kind is an error, which ends the build."""

    has_content: ClassVar[bool] = True

    def run(self) -> list[nodes.Node]:
        """Return the table."""
        kind, *lines = (line.strip() for line in self.content if line.strip())
        edges = [_EDGE.fullmatch(line) for line in lines]
        if kind != "stateDiagram-v2" or None in edges:
            raise self.error("the site can show state diagrams alone")
        group = nodes.tgroup("", cols=3)
        group += [nodes.colspec(colwidth=1) for _ in range(3)]
        head, body = nodes.thead(), nodes.tbody()
        head += _row("from", "event", "to")
        body += [_row(edge[1], edge[3] or "", edge[2]) for edge in edges if edge is not None]
        group += [head, body]
        table = nodes.table("", group, classes=["state-diagram"])
        return [table]


def _row(*cells: str) -> nodes.row:
    texts = (nodes.paragraph("", _NAMES.get(cell, cell)) for cell in cells)
    return nodes.row("", *(nodes.entry("", text) for text in texts))


def setup(app: Any) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("mermaid", StateDiagram)
    app.config["myst_fence_as_directive"] = {"mermaid"}
    return {"parallel_read_safe": True, "parallel_write_safe": True}
