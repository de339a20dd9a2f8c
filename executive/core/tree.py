"""`Tree`: the interface through which the core ticks the behaviour tree of the package `trees`."""

from collections.abc import Sequence
from enum import Enum
from typing import Protocol

from executive.plans import PlanHost


class TreeNodeView(Protocol):
    """A node of the tree, as of the last tick."""

    @property
    def path(self) -> str:
        """Node names from the root."""

    @property
    def status(self) -> Enum:
        """The node's result."""

    @property
    def message(self) -> str:
        """The node's feedback message."""


class LeafError(Exception):
    """A leaf of the tree raised; the text is its path, the cause is the exception."""


class Tree(PlanHost, Protocol):
    """The behaviour tree as the runner needs it; plans add their trees beside it."""

    def tick(self) -> None:
        """Run every branch that is due once.

        Raises:
            LeafError: a leaf raised.
        """

    def stop(self) -> None:
        """Terminate every running leaf."""

    def nodes(self) -> Sequence[TreeNodeView]:
        """Return all nodes as of the last tick."""
