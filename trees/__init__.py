"""The behaviour tree of the rover. py_trees lives only here."""

from trees.rover import RoverTree, branch_of, preview, snapshot_of
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
    "branch_of",
    "branches",
    "line",
    "looks",
    "preview",
    "snapshot_of",
]
