"""`rover-executive` with a tree of 40 nodes, for the benchmark of the stop."""

import sys
from functools import partial
from pathlib import Path

from adapters.onboard.service import Options, serve
from adapters.process.logs import log_to_stderr
from executive.settings import config_folder, load_settings
from trees.padded import PaddedTree

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
