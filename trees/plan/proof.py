"""`prove`: explores all outcomes of a plan within a bound, and judges the graph of its states."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import takewhile
from typing import Final

from executive.plans import (
    CellReference,
    Finding,
    Level,
    PlanNode,
    PlanResult,
    PlanRoot,
    Role,
    Script,
    cells_of_script,
    nodes,
)
from trees.plan.exploration import MAX_VALUES, Exploration, ExploredState

MAX_WORK: Final = 1_000_000
"""Maximum number of nodes that are loaded or run: about 5 s; chosen."""


@dataclass(frozen=True, slots=True)
class Proof:
    """Result of an exploration.

    Attributes:
        states, ticks: their numbers.
        limits: parts not explored exactly; without any, and without findings, the plan is proved.
    """

    states: int
    ticks: int
    findings: tuple[Finding, ...]
    limits: tuple[str, ...]

    @property
    def verdict(self) -> str:
        """`proved`, `no fault found` if it has limits, or `faults`."""
        if self.findings:
            return "faults"
        return "no fault found" if self.limits else "proved"


@dataclass(slots=True)
class _State:
    """A state in the graph.

    Attributes:
        running: numbers of the nodes that are RUNNING.
        next: numbers of the states after it, each with the nodes that were commanded.
        is_left: whether the plan can end from here, or it was not explored.
    """

    running: frozenset[int]
    next: list[tuple[int, frozenset[int]]]
    is_left: bool = True


def prove(
    plan: PlanRoot, max_work: int = MAX_WORK, is_over: Callable[[], bool] = lambda: False
) -> Proof:
    """Explore a plan, until `max_work` is reached or `is_over` returns True."""
    exploration = Exploration(plan)
    numbers: dict[ExploredState, int] = {exploration.begin: 0}
    graph = [_State(frozenset(), [])]
    todo, results, ticks, at = [exploration.begin], set[PlanResult](), 0, 0
    size, is_cut = sum(1 for _ in nodes(plan)), False
    while at < len(todo) and not is_cut:
        state, leaves = graph[at], False
        for tick in exploration.transitions(todo[at]):
            ticks += 1
            if tick.state is None:
                leaves = True
                results.add(tick.result)
                continue
            number = numbers.setdefault(tick.state, len(todo))
            if number == len(todo):
                todo.append(tick.state)
                letters = enumerate(tick.state.tree.statuses)
                graph.append(_State(frozenset(i for i, each in letters if each == "R"), []))
            if not tick.is_stop:
                state.next.append((number, tick.begun))
            is_cut = ticks * size + exploration.runs >= max_work or is_over()
            if is_cut:
                break
        state.is_left = leaves or is_cut
        at += not is_cut
    is_cut = at < len(todo)
    limits = [f"{ticks} ticks: {len(todo) - at} states were not explored"] * is_cut
    limits += [f"line {line}: {text}" for line, text in sorted(exploration.limits)]
    limits += [
        f"{name}: explored with any value after {MAX_VALUES}"
        for name in sorted(exploration.widened)
    ]
    judge = _Judge(plan, exploration)
    judge.judge_graph(graph)
    if not is_cut:
        judge.judge_results(results)
    return Proof(len(todo), ticks, judge.findings, tuple(limits))


def _cells_waited_for(node: PlanNode) -> Iterator[int]:
    script = node.ports["if"]
    assert isinstance(script, Script)
    return cells_of_script(script.statements)


class _Judge:
    def __init__(self, plan: PlanRoot, exploration: Exploration) -> None:
        self._plan = plan
        self._nodes = {each.location.number: each for each in nodes(plan)}
        self._above = {
            child.location.number: each for each in nodes(plan) for child in each.children
        }
        self._exploration = exploration
        self._found: dict[tuple[int, str], Finding] = {}
        done_again = (self._nodes[number] for number in exploration.repeated)
        for node in (each for each in done_again if not each.kind.name.startswith("set")):
            self._add(
                Level.WARNING,
                node,
                "it can be done again after it succeeded: a SequenceWithMemory, or a variable and "
                "_skipIf, remember it",
            )
        files = {
            target.cell
            for each in nodes(plan)
            if each.kind.command is not None
            and isinstance(target := each.ports.get("file"), CellReference)
        }
        for (cell, _), node in exploration.unwritten.items():
            name = plan.blackboard.names[cell].rpartition("/")[2]
            text = f"{name} can be read before it is written: set it at the begin by a Script"
            if cell in files:
                text = f"{name} is not known after its step failed: note its success in another"
                text += " variable by _onSuccess"
            self._add(Level.WARNING, node, text)
        paths = {each.location.path: each for each in nodes(plan)}
        for path, text in exploration.errors.items():
            self._add(Level.ERROR, paths[path], f"its script can fail the plan: {text}")

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The findings by line."""
        return tuple(sorted(self._found.values(), key=lambda each: (each.line, each.text)))

    def _add(self, level: Level, node: PlanNode, text: str) -> None:
        finding = Finding.of(level, node, text)
        self._found.setdefault((finding.line, text), finding)

    def judge_results(self, results: set[PlanResult]) -> None:
        """Judge the ends of a plan that was explored to them, and the nodes that it never runs."""
        top = self._plan.children[0]
        if results and PlanResult.SUCCESS not in results:
            self._add(Level.ERROR, top, "it can never succeed: all outcomes of its steps fail")
        elif PlanResult.SKIPPED in results:
            remedy = "put it into a Sequence, with an AlwaysSuccess after it"
            text = f"the plan can end skipped, which is FAILED: {remedy}"
            self._add(Level.WARNING, top, text)
        measured = {cell for cell, _ in self._plan.blackboard.telemetry}
        reached, succeeded = self._exploration.reached, self._exploration.succeeded
        satisfied = {self._position(self._nodes[number]) for number in succeeded}
        lines = {self._position(self._nodes[number]) for number in reached}
        for number, node in self._nodes.items():
            waited = node.kind.name == "WaitFor" and number in reached
            # By telemetry it can hold aboard: here a guard with the same condition precedes it.
            waited = waited and measured.isdisjoint(_cells_waited_for(node))
            if waited and self._position(node) not in satisfied:
                self._add(Level.ERROR, node, "it waits for nothing: its condition never holds")
            above = self._above.get(number)
            if above is None or above.location.number not in reached or number in reached:
                continue
            is_default = above.kind.name.startswith("Switch") and node is above.children[-1]
            plain = node.kind.name in {"AlwaysSuccess", "AlwaysFailure"}
            if not is_default and not plain and self._position(node) not in lines:
                text = "it is never reached: no outcome of the steps before it lets it run"
                self._add(Level.WARNING, node, text)

    def _position(self, node: PlanNode) -> tuple[int | str, ...]:
        """Return the line of a node and its names below its tree: one for all runs of the tree."""
        found: tuple[int | str, ...] = node.location.line, node.location.name
        above = self._above.get(node.location.number)
        while above is not None and above.kind.role is not Role.SUBTREE:
            found += (above.location.name,)
            above = self._above.get(above.location.number)
        return found

    def judge_graph(self, graph: Sequence[_State]) -> None:
        """Judge the cycles of the states."""
        for component in _components([[each for each, _ in state.next] for state in graph]):
            inside = set(component)
            edges = [edge for at in component for edge in graph[at].next]
            inner = [begun for after, begun in edges if after in inside]
            if not inner:
                continue
            never_ends = len(inner) == len(edges) and not any(graph[i].is_left for i in component)
            running = frozenset.intersection(*(graph[at].running for at in component))
            commanded = frozenset[int]().union(*inner)
            if commanded and not any(map(self._is_limit, running)):
                names = " and ".join(sorted(self._nodes[i].location.name for i in commanded))
                again = "to and fro between" if len(commanded) > 1 else "over and over"
                ends = "never ends" if never_ends else "need not end"
                self._add(
                    Level.ERROR if never_ends else Level.WARNING,
                    self._common(commanded),
                    f"it {ends}: {again} {names}: put it below a Timeout or a Window with until",
                )
            elif never_ends and not commanded:
                self._add(
                    Level.ERROR,
                    self._nodes[max(running)],
                    "it waits for ever: no active step could change its condition",
                )

    def _is_limit(self, number: int) -> bool:
        node = self._nodes[number]
        return node.kind.name == "Timeout" or (node.kind.name == "Window" and "until" in node.ports)

    def _common(self, numbers: Iterable[int]) -> PlanNode:
        """Return the deepest node above all of several nodes."""
        above = [self._nodes[each].location.path.split("/")[:-1] for each in numbers]
        columns = takewhile(lambda names: len({*names}) == 1, zip(*above, strict=False))
        path = "/".join(names[0] for names in columns)
        return next(each for each in self._nodes.values() if each.location.path == path)


def _components(after: Sequence[Sequence[int]]) -> list[list[int]]:
    """Return the strongly connected components of a graph; Kosaraju's algorithm."""
    before: list[list[int]] = [[] for _ in after]
    for at, following in enumerate(after):
        for each in following:
            before[each].append(at)
    last_first = [each for found in _searches(range(len(after)), after) for each in found]
    return list(_searches(reversed(last_first), before))


def _searches(begins: Iterable[int], after: Sequence[Sequence[int]]) -> Iterator[list[int]]:
    """Yield the nodes of each depth-first search, in the order of their ends."""
    seen: set[int] = set()
    for begin in begins:
        found: list[int] = []
        work = [] if begin in seen else [(begin, iter(after[begin]))]
        seen.add(begin)
        while work:
            following = work[-1][1]
            child = next((each for each in following if each not in seen), None)
            if child is None:
                found.append(work.pop()[0])
            else:
                seen.add(child)
                work.append((child, iter(after[child])))
        if found:
            yield found
