"""`PlanTree`: the tree of one plan: its tick, its state as one flat value."""

from collections.abc import Callable, Iterator, Mapping
from typing import Final, TypeVar

from executive.plans import (
    LeafError,
    NodeDetail,
    PlanNode,
    PlanPort,
    PlanResult,
    PlanRoot,
    StateError,
    Steering,
    TreeState,
    Value,
)
from trees.plan import controls, decorators, leaves, mission
from trees.plan.node import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, Answer, PlanBehaviour

MAX_EXECUTED_NODES: Final = 2000
"""Number of executed nodes after which a tick is not repeated; chosen."""
MAX_REPEATED_TICKS: Final = 50
"""Maximum number of ticks at once while a node yields: two reactive nodes could yield for ever."""

T = TypeVar("T")
NodeClass = type[PlanBehaviour]

_NAMES: Final[Mapping[NodeClass, str]] = {
    decorators.SubTree: "SubTree",
    controls.OrderedBranch: "Sequence Fallback AsyncSequence AsyncFallback SequenceWithMemory",
    controls.ReactiveBranch: "ReactiveSequence ReactiveFallback",
    controls.ParallelBranch: "Parallel ParallelAll",
    controls.ConditionalBranch: "IfThenElse",
    controls.RepeatedBranch: "WhileDoElse",
    controls.Switch: "Switch2 Switch3 Switch4 Switch5 Switch6",
    controls.TryCatch: "TryCatch",
    decorators.MappedResult: "Inverter ForceSuccess ForceFailure KeepRunningUntilFailure",
    decorators.LoopDecorator: "Repeat RetryUntilSuccessful",
    decorators.RunOnce: "RunOnce",
    decorators.Timeout: "Timeout",
    decorators.Delay: "Delay",
    decorators.Precondition: "Precondition",
    decorators.QueueLoop: "LoopString LoopDouble LoopPlace",
    decorators.Window: "Window",
    leaves.ScriptAction: "Script",
    leaves.ScriptCondition: "ScriptCondition",
    leaves.SetBlackboard: "SetBlackboard",
    leaves.FixedResult: "AlwaysSuccess AlwaysFailure",
    leaves.Sleep: "Sleep",
    mission.WaitUntil: "WaitUntil",
    mission.WaitFor: "WaitFor",
    mission.OperatorQuestion: "Ask",
    mission.RoverCondition: "Near Reachable FaultActive",
}
NODES: Final = {name: kind for kind, names in _NAMES.items() for name in names.split()}
"""Classes of the nodes by their names; a leaf with a command is a `CommandLeaf`."""

_LETTERS: Final = {IDLE: "I", RUNNING: "R", SUCCESS: "S", FAILURE: "F"}
_STATUS_OF: Final = {letter: status for status, letter in _LETTERS.items()}


class PlanTree:
    """The tree of one plan, and the data that its nodes share; see `PlanRun`.

    Args:
        plan: its root.
        port: the executive's side of the plan.
        classes: classes of further kinds of nodes.

    Attributes:
        root: the root node.
        nodes: all nodes by number.
    """

    def __init__(
        self, plan: PlanRoot, port: PlanPort, classes: Mapping[str, NodeClass] | None = None
    ) -> None:
        self.port, self.records = port, port.records
        self.cells: list[Value | None] = list(plan.blackboard.initial)
        self.cell_names = plan.blackboard.names
        self.yielded = False
        self._classes = {**NODES, **(classes or {})}
        self._telemetry = plan.blackboard.telemetry
        self.executed, self.measured = 0, frozenset(cell for cell, _ in self._telemetry)
        self.root = self._built(plan)
        found = (each for each in self.root.iterate() if isinstance(each, PlanBehaviour))
        self.nodes = tuple(sorted(found, key=lambda each: each.number))
        self._memory = [(each, name) for each in self.nodes for name in each.memory]
        self._timers = [(each, name) for each in self.nodes for name in each.timers]
        cells = range(len(self.cells))
        self._saved_cells = [cell for cell in cells if cell not in self.measured]

    def tick(self) -> PlanResult:
        """Tick from the root, and again at once as long as a node yields.

        Raises:
            LeafError: a node raised.
        """
        self._measure()
        answer: Answer = RUNNING
        self.executed = 0
        for _ in range(MAX_REPEATED_TICKS):
            self.yielded = False
            answer = self._contained(self.root.execute)
            if answer is not RUNNING or not self.yielded or self.executed > MAX_EXECUTED_NODES:
                break
        if answer is SKIPPED:
            return PlanResult.SKIPPED
        if answer is not RUNNING:
            self.root.status = IDLE
        return PlanResult[answer.name]

    def state(self) -> TreeState:
        """Return all that a tick changes."""
        return TreeState(
            "".join(_LETTERS[each.status] for each in self.nodes),
            tuple(getattr(node, name) for node, name in self._memory),
            tuple(getattr(node, name) for node, name in self._timers),
            tuple(self.cells[cell] for cell in self._saved_cells),
        )

    def load(self, state: TreeState) -> None:
        """Continue from a state.

        Raises:
            StateError: it is of another tree.
        """
        found = (len(state.statuses), len(state.memory), len(state.timers), len(state.cells))
        wanted = (len(self.nodes), len(self._memory), len(self._timers), len(self._saved_cells))
        if found != wanted:
            raise StateError(f"the stored state has {found[0]} nodes, the plan has {wanted[0]}")
        for node, letter in zip(self.nodes, state.statuses, strict=True):
            node.status = _STATUS_OF[letter]
        for (node, name), stored in zip(self._memory, state.memory, strict=True):
            setattr(node, name, tuple(stored) if isinstance(stored, list) else stored)
        for (node, name), time_s in zip(self._timers, state.timers, strict=True):
            setattr(node, name, time_s)
        for cell, value in zip(self._saved_cells, state.cells, strict=True):
            self.cells[cell] = value
        for node in self.nodes:
            node.on_load()

    def force(self, number: int, steering: Steering) -> None:
        """Let a node obey at its next tick."""
        self.nodes[number].force(steering)

    def waits(self) -> str:
        """Return the present waits and questions as text; empty without any."""
        running = (each for each in self.nodes if each.status is RUNNING)
        return "; ".join(filter(None, (each.waits for each in running)))

    def details(self) -> Iterator[NodeDetail]:
        """Yield the present knowledge of its nodes beside their state."""
        for each in self.nodes:
            next_utc_s = each.next_utc_s if each.status is RUNNING else None
            if each.unknown or next_utc_s is not None:
                yield NodeDetail(each.number, each.unknown, next_utc_s)

    def halt(self) -> None:
        """Halt all nodes that are RUNNING; their scripts run.

        Raises:
            LeafError: a node raised.
        """
        self._measure()
        if self.root.status is RUNNING:
            self._contained(self.root.halt)

    def _contained(self, work: Callable[[], T]) -> T:
        """Return the result of work; its exceptions become those of the plan."""
        try:
            return work()
        except LeafError:
            raise
        except Exception as error:
            raise LeafError(self.root.plan.location.path) from error

    def _measure(self) -> None:
        for cell, name in self._telemetry:
            self.cells[cell] = self.port.telemetry(name)

    def _built(self, plan: PlanNode) -> PlanBehaviour:
        children = [self._built(each) for each in plan.children]
        make = (
            leaves.CommandLeaf if plan.kind.command is not None else self._classes[plan.kind.name]
        )
        node = make(plan, self, children)
        if isinstance(node, decorators.LoopDecorator):
            for each in children[0].iterate():
                assert isinstance(each, PlanBehaviour)
                each.loops = (node, *each.loops)
        return node
