"""`Screen` displays snapshots of the tree in the terminal, below mode, reason and faults."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final, Self

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.text import Text

from trees.snapshot import (
    DisplayStatus,
    NodeStatus,
    TreeNodeSnapshot,
    TreeSnapshot,
    branches,
    display_statuses,
    line,
)

STYLES: Final = {
    DisplayStatus.IDLE: "dim",
    DisplayStatus.RUNNING: "bold cyan",
    DisplayStatus.SUCCESS: "green",
    DisplayStatus.DECLINED: "bright_black",
    DisplayStatus.FAILURE: "red",
}
_HEAD_LINES: Final = 3
_MODE_STYLE: Final = {"SAFE": "bold white on red", "STOPPED": "bold black on yellow"}
_NONE: Final[Mapping[str, str]] = MappingProxyType({})


class Screen:
    """Draws each snapshot over the last, as a context manager; into a pipe, one after the other."""

    def __init__(self, asset: str) -> None:
        self._asset = asset
        self._console = Console()
        self._live = Live(console=self._console, auto_refresh=False)

    def __enter__(self) -> Self:
        if self._console.is_terminal:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()

    def show(self, snapshot: TreeSnapshot) -> None:
        """Draw a snapshot."""
        if self._console.is_terminal:
            self._live.update(render(self._asset, snapshot, self._console.height), refresh=True)
        else:
            self._console.print(render(self._asset, snapshot), Text())


def show_once(asset: str, snapshot: TreeSnapshot) -> None:
    """Print one complete snapshot."""
    Console().print(render(asset, snapshot))


def render(
    asset: str, snapshot: TreeSnapshot, height: int | None = None, notes: Mapping[str, str] = _NONE
) -> RenderableType:
    """Render a snapshot for the terminal: a head line, the reason, faults, the tree.

    Args:
        asset: name of the asset.
        snapshot: the snapshot.
        height: available lines; if they are too few, idle and failed branches are collapsed.
        notes: notes printed after nodes, by their paths.
    """
    nodes, lines = snapshot.nodes, list(map(str, snapshot.faults))
    if snapshot.unmonitored:
        lines.append(f"not monitored: {snapshot.unmonitored}")
    is_full = height is not None and len(nodes) + len(lines) + _HEAD_LINES >= height
    shown = collapse(nodes) if is_full else nodes
    minutes, second = divmod(int(snapshot.utc_s) % 86400, 60)
    at = f"{minutes // 60:02}:{minutes % 60:02}:{second:02}"
    head = Text.assemble(
        (asset, "bold"),
        "  ",
        (f" {snapshot.mode} ", _MODE_STYLE.get(snapshot.mode, "bold black on white")),
        f"  {snapshot.active}" if snapshot.active is not None else "",
        (f"  tick {snapshot.tick}  {at} UTC", "dim"),
    )
    return Group(
        head, *map(Text, (snapshot.why, *lines)), Text(), render_nodes(nodes, notes, shown)
    )


def render_nodes(
    nodes: Sequence[TreeNodeSnapshot],
    notes: Mapping[str, str] = _NONE,
    shown: Sequence[TreeNodeSnapshot] | None = None,
) -> RenderableType:
    """Render nodes for the terminal, one per line, followed by their notes.

    The status of a branch depends on all nodes below it, including those that are not shown.
    """
    displays = dict(zip((each.path for each in nodes), display_statuses(nodes), strict=True))
    shown = nodes if shown is None else shown
    return Group(
        *(
            Text.assemble(
                (branch, "dim"),
                (line(node, displays[node.path]), STYLES[displays[node.path]]),
                (_note(node, notes), "dim"),
            )
            for branch, node in zip(branches(shown), shown, strict=True)
        )
    )


def _note(node: TreeNodeSnapshot, notes: Mapping[str, str]) -> str:
    note = notes.get(node.path, "")
    return f"  {note}" if note else ""


def collapse(nodes: Sequence[TreeNodeSnapshot]) -> tuple[TreeNodeSnapshot, ...]:
    """Return the nodes without those below a node that failed or was not ticked."""
    seen: list[TreeNodeSnapshot] = []
    fold_depth: int | None = None
    for node in nodes:
        if fold_depth is not None and node.depth > fold_depth:
            continue
        nothing = node.status in {NodeStatus.IDLE, NodeStatus.FAILURE}
        fold_depth = node.depth if nothing else None
        seen.append(node)
    return tuple(seen)
