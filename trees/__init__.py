"""The behaviour tree of the rover. Only this package imports py_trees."""

import trees.bare_py_trees  # noqa: F401 - before all that import py_trees
from executive.values.plan_nodes import NodeStatus as NodeStatus
from trees.rover import RoverTree as RoverTree
from trees.rover import leaf_paths as leaf_paths
from trees.rover import preview as preview
from trees.rover import snapshot_of as snapshot_of
from trees.snapshot import COLOURS as COLOURS
from trees.snapshot import DisplayStatus as DisplayStatus
from trees.snapshot import FaultSnapshot as FaultSnapshot
from trees.snapshot import NodeKind as NodeKind
from trees.snapshot import TreeNodeSnapshot as TreeNodeSnapshot
from trees.snapshot import TreeSnapshot as TreeSnapshot
from trees.snapshot import as_svg as as_svg
from trees.snapshot import branches as branches
from trees.snapshot import commands_by_node as commands_by_node
from trees.snapshot import display_statuses as display_statuses
from trees.snapshot import line as line
