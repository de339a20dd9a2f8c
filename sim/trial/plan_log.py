"""`PlanLog`: the results of the nodes of a plan while it runs, as its tree gives them."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, unique
from functools import partial
from typing import Any, Final

from executive.goals import Context
from executive.plans import CellReference, PlanExecution, PlanNode, PlanRoot, parts_of, text_of
from trees import RoverTree
from trees.plan import PlanTree

NOTHING: Final = "none of them"
EXPIRED: Final = "expired"
UNANSWERED: Final = "no answer"
DEFAULT: Final = "{} (default)"
_SELECTING: Final = ("Fallback", "Switch", "Else")
"""Parts of the names of the nodes that select one of their children."""
_LIMITED: Final = ("Timeout", "Window", "WaitFor", "WaitUntil")


@unique
class NodeResult(Enum):
    """Last result of a node in a run."""

    SUCCESS = "success"
    FAILURE = "failure"
    SKIPPED = "skipped"
    HALTED = "halted"
    RUNNING = "running"
    """It had not ended when the run did."""


@dataclass(frozen=True, slots=True)
class OpenedQuestion:
    """A question that a plan has opened.

    Attributes:
        path: of its node.
        options: its possible answers.
        deadline_s: time until its deadline; None without one.
    """

    path: str
    options: tuple[str, ...]
    deadline_s: float | None


class PlanLog:
    """Results of the nodes of a plan, also over restarts of its executive.

    Attributes:
        results: last result of each node that was reached, by its number.
        choices: number of times that a node ended with a choice: a branch, an answer, a deadline.
        answered: keys of the questions that the operators have answered since they were opened.
    """

    def __init__(self) -> None:
        self.results: dict[int, NodeResult] = {}
        self.choices: Counter[tuple[int, str]] = Counter()
        self.answered: set[str] = set()
        self._opened: list[OpenedQuestion] = []
        self._selected: dict[int, str] = {}
        self._ends: Counter[int] = Counter()

    def build_tree(self, context: Context) -> RoverTree:
        """Return a tree of the rover; the plans that it gets are logged."""
        return _LoggedTree(context, self)

    def take_opened(self) -> list[OpenedQuestion]:
        """Return the questions opened since the last call."""
        opened, self._opened = self._opened, []
        return opened

    def watch(self, tree: PlanTree) -> None:
        """Log a plan's tree from now on."""
        parents = {child.number: each.plan for each in tree.nodes for child in each.nodes}
        for node in tree.nodes:
            parent = parents.get(node.number)
            own: dict[str, Callable[[], Any]] = {
                "execute": partial(self._execute, tree, node, parent, node.execute),
                "halt": partial(self._halt, node, node.halt),
            }
            for name, method in own.items():
                setattr(node, name, method)

    def _execute(
        self, tree: PlanTree, node: Any, parent: PlanNode | None, execute: Callable[[], Any]
    ) -> Any:
        plan: PlanNode = node.plan
        children = [each.plan.location.number for each in node.nodes]
        ended = sum(self._ends[number] for number in children)
        begins = node.status.name != NodeResult.RUNNING.name
        if begins:
            self._selected.pop(plan.location.number, None)
        answer = execute()
        self.results[plan.location.number] = result = NodeResult[answer.name]
        if parent is not None and result is not NodeResult.SKIPPED:
            self._select(parent, plan)
        if result is NodeResult.RUNNING:
            if begins and plan.kind.name == "Ask":
                self._open(plan)
        else:
            self._ends[plan.location.number] += 1
            expires = sum(self._ends[number] for number in children) == ended
            choice = self._choice(tree, plan, result, expires)
            if choice is not None:
                self.choices[plan.location.number, choice] += 1
        return answer

    def _select(self, parent: PlanNode, child: PlanNode) -> None:
        """Note that a node runs one of its branches; the condition of a choice is none."""
        is_condition = "Else" in parent.kind.name and child is parent.children[0]
        if any(part in parent.kind.name for part in _SELECTING):
            chosen = NOTHING if is_condition else child.location.name
            self._selected[parent.location.number] = chosen

    def _open(self, plan: PlanNode) -> None:
        self.answered.discard(plan.location.path)
        deadline_s = plan.number("deadline_s") if "deadline_s" in plan.ports else None
        options = parts_of(plan.text("options"))
        self._opened.append(OpenedQuestion(plan.location.path, options, deadline_s))

    def _choice(
        self, tree: PlanTree, plan: PlanNode, result: NodeResult, expires: bool
    ) -> str | None:
        """Return the choice of a node that has ended; None for nodes without one."""
        if result is NodeResult.SKIPPED:
            return None
        name, failed = plan.kind.name, result is NodeResult.FAILURE
        if name == "Ask":
            target = plan.ports.get("answer")
            if failed or not isinstance(target, CellReference):
                return UNANSWERED
            answer = text_of(tree.cells[target.cell] or "")
            return answer if plan.location.path in self.answered else DEFAULT.format(answer)
        if name in _LIMITED:
            return EXPIRED if failed and expires else None
        if "Fallback" in name and failed:
            return NOTHING
        return self._selected.get(plan.location.number)

    def _halt(self, node: Any, halt: Callable[[], None]) -> None:
        halt()
        self.results[node.number] = NodeResult.HALTED


class _LoggedTree(RoverTree):
    def __init__(self, context: Context, log: PlanLog) -> None:
        super().__init__(context)
        self._log = log

    def attach(self, plan: PlanRoot, execution: PlanExecution) -> PlanTree:
        tree = super().attach(plan, execution)
        self._log.watch(tree)
        return tree
