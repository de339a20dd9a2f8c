"""`rover-executive` with a tree of 40 nodes whose tick can be made to hang, for benchmarks."""

import sys
import time
from functools import partial
from pathlib import Path

from adapters.onboard.service import ExecutiveOptions, serve
from adapters.process import log_to_stderr
from executive.goals import Context
from executive.settings import config_folder, load_settings
from trees import RoverTree
from trees.composites import Selector
from trees.leaf import Condition

TREE_NODES = 40
HANG = "hang"
"""A file in the folder of the executive, with the seconds that the next tick is to take."""


class PaddedTree(RoverTree):
    """A rover tree of 40 nodes: the further ones are asked before all others.

    Args:
        data: the folder of the executive.
    """

    def __init__(self, context: Context, data: Path) -> None:
        super().__init__(context)
        missing = TREE_NODES - len(list(self.root.iterate())) - 2
        conditions = [Condition(f"never {number}", lambda: False) for number in range(missing)]
        hang = Condition("hang", lambda: hang_on_request(data / HANG))
        padding = Selector("padding", hang, *conditions)
        self.root.remove_all_children()
        self.root = Selector(self.root.name, padding, *self.root.nodes)


def hang_on_request(path: Path) -> bool:
    if path.exists():
        requested_s = float(path.read_text(encoding="ascii"))
        path.unlink()
        time.sleep(requested_s)
    return False


def main(data: Path) -> None:
    """Serve on a free port, with the ledger in a folder."""
    log_to_stderr("warning")
    parameters = config_folder() / "jackal.ros.yaml"
    serve(
        ExecutiveOptions(load_settings("jackal"), "127.0.0.1", 0, data, parameters, ()),
        build_tree=partial(PaddedTree, data=data),
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
