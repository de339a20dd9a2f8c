"""The rover's tree made larger, for measuring what the size of a tree costs."""

from py_trees.composites import Selector

from executive.context import Context
from trees.leaf import Condition
from trees.rover import RoverTree


class Never(Condition):
    """A condition that is looked at in every tick and never holds."""

    def holds(self) -> bool:
        """Return False."""
        return False


class PaddedTree(RoverTree):
    """A rover tree of a given number of nodes: the further ones are asked before all others.

    Args:
        nodes: how many in all; a count below the rover's own adds nothing.
    """

    def __init__(self, context: Context, nodes: int) -> None:
        """Build the rover's tree and put the padding in front."""
        super().__init__(context)
        missing = nodes - len(list(self.root.iterate())) - 1
        if missing > 0:
            conditions = [Never(f"never {number}", context) for number in range(missing)]
            padding = Selector("padding", memory=False, children=list(conditions))
            self.root.prepend_child(padding)
