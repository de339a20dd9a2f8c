"""`rover-executive` with a tree of 40 nodes, for the benchmark of the stop."""

import sys
from functools import partial
from pathlib import Path

from py_trees.composites import Selector

from adapters.onboard.service import Options, serve
from adapters.process import log_to_stderr
from executive.goals import Context
from executive.settings import config_folder, load_settings
from trees import RoverTree
from trees.leaf import Condition


class PaddedTree(RoverTree):
    """A rover tree of a given number of nodes: the further ones are asked before all others.

    Args:
        nodes: how many in all; a count below the rover's own adds nothing.
    """

    def __init__(self, context: Context, nodes: int) -> None:
        super().__init__(context)
        missing = nodes - len(list(self.root.iterate())) - 1
        if missing > 0:
            conditions = [Condition(f"never {number}", lambda: False) for number in range(missing)]
            padding = Selector("padding", memory=False, children=list(conditions))
            self.root.prepend_child(padding)


TREE_NODES = 40


def main(data: Path) -> None:
    """Serve on a free port, with the ledger in a folder."""
    log_to_stderr("warning")
    parameters = config_folder() / "jackal.ros.yaml"
    serve(
        Options(load_settings("jackal"), "127.0.0.1", 0, data, parameters, ()),
        build_tree=partial(PaddedTree, nodes=TREE_NODES),
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
