"""`CountingTree`: a tree of the rover that counts the choices of the nodes of its plans."""

from collections import Counter
from typing import Final

from executive.goals import Context
from executive.plans import NodeRecords, PlanExecution, PlanNode, PlanRoot
from executive.values.clock import Clock
from trees import RoverTree
from trees.plan import PlanTree

EXPIRED: Final = "expired"
NOTHING: Final = "none of them"
FIRST: Final = "took the first branch {}"
_LIMITED: Final = ("Timeout", "Window", "WaitFor", "WaitUntil", "Ask")

Choices = Counter[tuple[int, str]]
"""How often a node, by its number, ended with a choice: a branch, an answer, a deadline."""


class CountingTree(RoverTree):
    """A tree of the rover; its plans add to the choices."""

    def __init__(self, choices: Choices, context: Context) -> None:
        super().__init__(context)
        self._choices = choices

    def attach(self, plan: PlanRoot, execution: PlanExecution) -> PlanTree:
        """Build the tree of a plan; see `PlanHost`."""
        stored = execution.records.encoded(())
        execution.records = _CountingRecords(stored, execution.clock, self._choices)
        return super().attach(plan, execution)


class _CountingRecords(NodeRecords):
    """Records that count; of ends at once with the same result, the first one counts."""

    def __init__(self, stored: str, clock: Clock, choices: Choices) -> None:
        super().__init__(stored, clock)
        self._choices = choices

    def note(self, node: PlanNode, begins: bool, result: str, why: str) -> None:
        super().note(node, begins, result, why)
        if not result:
            return
        choice = self.decision(node).partition(": ")[0]
        if result == "F" and node.kind.name in _LIMITED:
            choice = EXPIRED if why.startswith(f"{node.location.path}: ") else ""
        elif "Fallback" in node.kind.name:
            first = FIRST.format(node.children[0].location.name)
            choice = NOTHING if result == "F" else choice or first
        if choice:
            self._choices[node.location.number, choice] += 1
