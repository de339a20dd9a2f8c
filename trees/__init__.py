"""The behaviour tree of the rover. py_trees lives only here."""

from trees.rover import RoverTree, leaf_paths, preview, snapshot_of
from trees.snapshot import (
    COLOURS,
    Look,
    Node,
    NodeKind,
    NodeStatus,
    Snapshot,
    as_svg,
    branches,
    line,
    looks,
    served,
)

__all__ = [
    "COLOURS",
    "Look",
    "Node",
    "NodeKind",
    "NodeStatus",
    "RoverTree",
    "Snapshot",
    "as_svg",
    "branches",
    "leaf_paths",
    "line",
    "looks",
    "preview",
    "served",
    "snapshot_of",
]
