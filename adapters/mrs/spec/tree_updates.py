"""The behaviour tree on the wire: periodic full updates, and differences from the last full one.

A difference refers to the last full update, not to the previous difference: any may be lost.
"""

from collections.abc import Sequence
from typing import Final

from adapters.mrs.spec import types
from adapters.mrs.spec.mapping import MAX_TEXT_LENGTH, NS_PER_S, to_ns
from executive.values.reports import Identity
from trees import FaultSnapshot, NodeKind, TreeNodeSnapshot, TreeSnapshot

SEPARATOR: Final = "/"


def whole_update(number: int, snapshot: TreeSnapshot) -> types.TreeUpdate:
    """Return a full update with its number."""
    paths = _Paths()
    nodes = tuple(
        types.TreeNode(
            name=each.name,
            path=None if paths.next(each.name, each.depth, each.path) else each.path,
            depth=each.depth,
            kind=types.NodeKind[each.kind.name],
            status=each.status,
            message=each.message or None,
        )
        for each in snapshot.nodes
    )
    return _update(number, snapshot, unmonitored=snapshot.unmonitored, nodes=nodes)


def change_update(
    number: int, whole: TreeSnapshot, snapshot: TreeSnapshot
) -> types.TreeUpdate | None:
    """Return the differences from a full update that was sent; None if it has other nodes."""
    if not _alike(whole.nodes, snapshot.nodes) or whole.unmonitored != snapshot.unmonitored:
        return None
    changes = tuple(
        types.NodeChange(
            index=index,
            status=each.status,
            message=each.message or None,
        )
        for index, (before, each) in enumerate(zip(whole.nodes, snapshot.nodes, strict=True))
        if each != before
    )
    return _update(number, snapshot, changes=changes)


def snapshot_of_update(update: types.TreeUpdate, whole: TreeSnapshot | None) -> TreeSnapshot:
    """Return the tree of an update: a full one, or differences from `whole`.

    Raises:
        ValueError: the differences do not fit `whole`, or the nodes of a full update are no tree.
    """
    if update.nodes is not None:
        nodes, unmonitored = tuple(_nodes(update.nodes)), update.unmonitored or ""
    elif whole is not None:
        nodes, unmonitored = _changed(whole.nodes, update.changes or ()), whole.unmonitored
    else:
        raise ValueError("differences from an unknown full tree")
    number = update.activeCommandId
    return TreeSnapshot(
        tick=update.tick,
        utc_s=update.timestamp / NS_PER_S,
        mode=update.mode.name,
        why=update.why,
        nodes=nodes,
        faults=tuple(FaultSnapshot(each.name, each.severity, each.text) for each in update.faults),
        unmonitored=unmonitored,
        active=None if number is None else Identity(update.activeSource or "", number),
    )


def _update(
    number: int,
    snapshot: TreeSnapshot,
    *,
    unmonitored: str | None = None,
    nodes: tuple[types.TreeNode, ...] | None = None,
    changes: tuple[types.NodeChange, ...] | None = None,
) -> types.TreeUpdate:
    active = snapshot.active
    return types.TreeUpdate(
        whole=number,
        timestamp=to_ns(snapshot.utc_s),
        tick=snapshot.tick,
        mode=types.AssetMode[snapshot.mode],
        activeSource=None if active is None else active.source,
        activeCommandId=None if active is None else active.command_id,
        why=snapshot.why[:MAX_TEXT_LENGTH],
        faults=tuple(
            types.TreeFault(
                name=each.name, severity=each.severity, text=each.text[:MAX_TEXT_LENGTH]
            )
            for each in snapshot.faults
        ),
        unmonitored=unmonitored,
        nodes=nodes,
        changes=changes,
    )


def _alike(some: Sequence[TreeNodeSnapshot], others: Sequence[TreeNodeSnapshot]) -> bool:
    return [(each.path, each.depth, each.kind) for each in some] == [
        (each.path, each.depth, each.kind) for each in others
    ]


def _nodes(received_nodes: Sequence[types.TreeNode]) -> list[TreeNodeSnapshot]:
    paths = _Paths()
    nodes: list[TreeNodeSnapshot] = []
    for each in received_nodes:
        paths.next(each.name, each.depth, each.path)
        path = paths.last
        kind = NodeKind[each.kind.name]
        nodes.append(
            TreeNodeSnapshot(path, each.name, each.depth, kind, each.status, each.message or "")
        )
    return nodes


def _changed(
    nodes: Sequence[TreeNodeSnapshot], changes: Sequence[types.NodeChange]
) -> tuple[TreeNodeSnapshot, ...]:
    changed = list(nodes)
    for each in changes:
        if each.index >= len(nodes):
            raise ValueError(f"index {each.index} of a changed node, the tree has {len(nodes)}")
        old = nodes[each.index]
        changed[each.index] = TreeNodeSnapshot(
            old.path, old.name, old.depth, old.kind, each.status, each.message or ""
        )
    return tuple(changed)


class _Paths:
    """Paths of nodes in depth-first order; usually they follow from the names."""

    def __init__(self) -> None:
        self._open: list[str] = []

    @property
    def last(self) -> str:
        """Path of the last node."""
        return self._open[-1]

    def next(self, name: str, depth: int, path: str | None) -> bool:
        """Add the next node; return whether its path follows from its parent's, as None does.

        Raises:
            ValueError: it has no parent.
        """
        if depth > len(self._open):
            raise ValueError(f"node {name} of depth {depth} has no parent")
        del self._open[depth:]
        follows = f"{self.last}{SEPARATOR}{name}" if self._open else name
        self._open.append(follows if path is None else path)
        return path in {None, follows}
