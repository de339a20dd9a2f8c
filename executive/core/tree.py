"""The behaviour tree as the core uses it; `trees` has the tree itself."""

from collections.abc import Sequence
from enum import Enum
from typing import Protocol

from executive.plans import PlanHost


class TreeNodeView(Protocol):
    """A node of the tree, as of the last tick."""

    @property
    def path(self) -> str:
        """Names from the root."""

    @property
    def status(self) -> Enum:
        """Its result."""

    @property
    def message(self) -> str:
        """Its message."""


class LeafError(Exception):
    """A leaf of the tree raised; the text is its path, the cause is what it raised."""


class Tree(PlanHost, Protocol):
    """The behaviour tree, as the runner needs it, beside which the trees of plans grow."""

    def tick(self) -> None:
        """Run every branch that is due once.

        Raises:
            LeafError: a leaf raised.
        """

    def stop(self) -> None:
        """End every running leaf."""

    def nodes(self) -> Sequence[TreeNodeView]:
        """Return all nodes as of the last tick."""
