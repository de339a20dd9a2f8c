"""The behaviour tree of the rover. py_trees lives only here."""

from trees.rover import RoverTree
from trees.snapshot import Node, NodeStatus, Snapshot, as_svg, branches, line

__all__ = ["Node", "NodeStatus", "RoverTree", "Snapshot", "as_svg", "branches", "line"]
