"""`Exploration`: the tree of a plan, ticked with every outcome of leaves, timers and conditions.

The nodes are those that run aboard. The results of commands, conditions on telemetry, timers and
answers are choices; a tick is repeated from the same state until each combination has been made.
"""

from collections.abc import Iterator, Mapping
from math import inf
from typing import Final, NamedTuple

from executive.plans import (
    ANY,
    Abstraction,
    CellReference,
    Cells,
    CommandOutcome,
    LeafError,
    PlanNode,
    PlanResult,
    PlanRoot,
    PlanStep,
    Steering,
    TreeState,
    UnknownValueError,
    Value,
    input_cells,
    nodes,
    written_cells,
)
from executive.values.clock import Clock, ManualClock
from executive.values.plan_nodes import Question
from executive.values.reasons import Refusal
from trees.plan.controls import Switch
from trees.plan.decorators import QueueLoop
from trees.plan.leaves import PlanLeaf
from trees.plan.node import FAILURE, RUNNING, SUCCESS, Answer, PlanBehaviour
from trees.plan.tree import NODES, NodeClass, PlanTree

MAX_VALUES: Final = 8
"""Maximum number of explored values of a variable; after that it is `ANY`."""
EXPIRED_S: Final = 1e15
"""A time after all timers."""

_REPEATING: Final = frozenset(
    {"ReactiveSequence", "ReactiveFallback", "WhileDoElse", *(f"Switch{n}" for n in range(2, 7))}
)
"""Nodes that can begin a child again after it succeeded, apart from the cycles of loops."""

Active = tuple[tuple[int, tuple[int, ...]], ...]


class ExploredState(NamedTuple):
    """State of the exploration between two ticks.

    Attributes:
        active: nodes with an active command, each with the cycles of the loops around it.
        done: those with a command that succeeded since the loops around them began a cycle, if
            they can be done again.
        past: the latest absolute time of a node that has passed, with its number.
    """

    tree: TreeState
    active: Active
    done: frozenset[tuple[int, tuple[int, ...]]]
    past: frozenset[tuple[int, float]]


class Transition(NamedTuple):
    """A tick.

    Attributes:
        state: the state after it; None at the end of the plan.
        begun: nodes that were commanded.
        is_stop: whether a stop or a restart precedes it.
    """

    result: PlanResult
    state: ExploredState | None
    begun: frozenset[int]
    is_stop: bool


class Exploration:
    """Explores one plan; the executive's side of its tree.

    Attributes:
        runs: number of runs of nodes.
        reached: numbers of the nodes that ran.
        repeated: nodes that were commanded again after they succeeded.
        succeeded: numbers of those that succeeded.
        unwritten: variables that were read before they were written, each with the node.
        errors: paths of nodes with a script that could not be evaluated, with the reason.
        limits: lines and texts of parts that were not explored exactly.
        widened: variables that had too many values, and were explored with any.
    """

    def __init__(self, plan: PlanRoot) -> None:
        self.clock: Clock = ManualClock()
        self.why = ""
        self.records = None
        self.runs = 0
        self.reached: set[int] = set()
        self.repeated: set[int] = set()
        self.succeeded: set[int] = set()
        self.unwritten: dict[tuple[int, int], PlanNode] = {}
        self.errors: dict[str, str] = {}
        abstraction = Abstraction(plan, self)
        self._plan = abstraction.root()
        self.limits = abstraction.limits
        self.widened: set[str] = set()
        self._names = plan.blackboard.names
        again = (each for each in nodes(plan) if each.kind.name in _REPEATING)
        self._repeatable = {below.location.number for each in again for below in nodes(each)}
        self._active: dict[int, tuple[int, ...]] = {}
        self._done: set[tuple[int, tuple[int, ...]]] = set()
        self._past: dict[int, float] = {}
        self._begun: set[int] = set()
        self._taken: list[list[int]] = []
        self._at = 0
        self._alike: dict[object, int] = {}
        self._tree = PlanTree(self._plan, self, CLASSES)
        values = self._tree.cells
        self._values: list[set[Value | None]] = [{each} for each in values]
        self.begin = ExploredState(self._tree.state(), (), frozenset(), frozenset())

    def transitions(self, state: ExploredState) -> Iterator[Transition]:
        """Yield each tick from a state."""
        self._taken = []
        while True:
            yield self._tick(state)
            while self._taken and self._taken[-1][0] + 1 == self._taken[-1][1]:
                self._taken.pop()
            if not self._taken:
                return
            self._taken[-1][0] += 1

    def _tick(self, state: ExploredState) -> Transition:
        self._at = 0
        self._alike.clear()
        self._begun.clear()
        self._active, self._done = dict(state.active), set(state.done)
        self._past = dict(state.past)
        self._tree.load(state.tree)
        is_stop = bool(self._active) and self.choose(2) == 1
        if is_stop:
            self._active.clear()
        try:
            result = self._tree.tick()
        except LeafError as error:
            self.errors[str(error)] = str(error.__cause__)
            return Transition(PlanResult.FAILURE, None, frozenset(self._begun), is_stop)
        begun = frozenset(self._begun)
        if result is not PlanResult.RUNNING:
            return Transition(result, None, begun, is_stop)
        self._widen()
        active, past = tuple(sorted(self._active.items())), frozenset(self._past.items())
        after = ExploredState(self._tree.state(), active, frozenset(self._done), past)
        return Transition(result, after, begun, is_stop)

    def _widen(self) -> None:
        for cell, value in enumerate(self._tree.cells):
            values = self._values[cell]
            if value in values or value == ANY:
                continue
            if len(values) > MAX_VALUES:
                self._tree.cells[cell] = ANY
                self.widened.add(self._names[cell].rpartition("/")[2])
            else:
                values.add(value)

    def choose(self, options: int, key: object = None) -> int:
        """Return a choice from 0; the same one for the same key within a tick."""
        if key is not None and key in self._alike:
            return self._alike[key]
        if self._at == len(self._taken):
            self._taken.append([0, options])
        choice = self._taken[self._at][0]
        self._at += 1
        if key is not None:
            self._alike[key] = choice
        return choice

    def has_passed(self, node: PlanNode, utc_s: float) -> bool:
        """Choose whether a time has passed; an absolute one that has is past from then on."""
        number, absolute = node.location.number, node.kind.name in {"Window", "WaitUntil"}
        has_passed = self._past.get(number, -inf) >= utc_s or self.choose(2) == 1
        if has_passed and absolute:
            self._past[number] = max(utc_s, self._past.get(number, -inf))
        return has_passed

    def forget(self, node: PlanNode) -> None:
        """Begin a new cycle of a loop: its steps may be done again."""
        below = {each.location.number for each in nodes(node)}
        self._done = {each for each in self._done if each[0] not in below}

    def telemetry(self, name: str) -> Value:
        """Return any value."""
        return ANY

    def check_target(self, x_m: float, y_m: float) -> Refusal | None:
        """Accept a motion; `Reachable` is a choice of its own."""
        return None

    def fault_active(self, name: str) -> bool:
        """Choose."""
        return self.choose(2, ("fault", name)) == 1

    def request(self, step: PlanStep, cycles: tuple[int, ...], cells: Cells) -> None:
        """Note a command; see `PlanPort`."""
        number = step.location.number
        self.reached.add(number)
        if number in self._active:
            return
        read = {each.cell: cells[each.cell] for each in input_cells(step)}
        if read:
            text = "bounds of arguments from variables are checked aboard"
            self.limits.add((step.location.line, text))
        unknown = next((cell for cell, value in read.items() if value is None), None)
        if unknown is not None:
            raise UnknownValueError(unknown)
        if ANY not in read.values():
            step.request_from(cells)
        if (number, cycles) in self._done:
            self.repeated.add(number)
        self._active[number] = cycles
        self._begun.add(number)

    def poll(self, step: PlanStep) -> CommandOutcome | None:
        """Choose whether a command continues, succeeds or fails."""
        number = step.location.number
        choice = 0 if number in self._begun else self.choose(3)
        if choice == 0:
            return None
        cycles = self._active.pop(number, ())
        if choice == 2:
            return CommandOutcome(False, ANY)
        if number in self._repeatable:
            self._done.add((number, cycles))
        return CommandOutcome(True, file=ANY)

    def fail_overdue(self, step: PlanStep, allowed_s: float) -> CommandOutcome:
        """Fail a step."""
        self.halt_step(step)
        return CommandOutcome(False, ANY)

    def halt_step(self, step: PlanStep) -> None:
        """Abandon the command of a step."""
        self._active.pop(step.location.number, None)
        self._begun.discard(step.location.number)

    def command_text(self, step: PlanStep) -> str:
        """Return no text."""
        return ""

    def has_expired(self, node: PlanNode, cycles: tuple[int, ...]) -> bool:
        """Return that no time limit expired before the plan began."""
        return False

    def take_answer(self, question: Question) -> str | None:
        """Choose no answer, or one of the options."""
        return (None, *question.options)[self.choose(len(question.options) + 1)]

    def withdraw(self, question: Question, answer: str = "") -> None:
        """End a question."""

    def note_failure(self, node: PlanNode, text: str, unknown: int | None = None) -> None:
        """Note a variable that was not known."""
        if unknown is None or unknown in self._tree.measured or node.kind.name == "WaitFor":
            return
        self.unwritten[unknown, node.location.line] = node

    def on_forced(self, node: PlanNode, steering: Steering) -> None:
        """Never called: no node is forced."""


def _exploration(node: PlanBehaviour) -> Exploration:
    port = node.context.port
    assert isinstance(port, Exploration)
    return port


class _Explored(PlanBehaviour):
    """A node that notes its runs, and has choices for times."""

    def run(self) -> Answer:
        exploration, queue = _exploration(self), self.plan.ports.get("queue")
        exploration.runs += 1
        exploration.reached.add(self.number)
        if isinstance(queue, CellReference) and self.context.cells[queue.cell] == ANY:
            exploration.limits.add((self.plan.location.line, "its queue may be any"))
        answer: Answer = super().run()  # type: ignore[safe-super]
        if answer is SUCCESS:
            exploration.succeeded.add(self.number)
        repeats = isinstance(self, QueueLoop) or self.plan.kind.name == "KeepRunningUntilFailure"
        if repeats and self.nodes[0].status is not RUNNING:
            exploration.forget(self.plan)
        return answer

    def read(self, port: str) -> Value:
        try:
            return super().read(port)
        except UnknownValueError as unknown:
            _exploration(self).note_failure(self.plan, "", unknown.cell)
            raise

    def overdue_s(self, time_s: float) -> float:
        return EXPIRED_S if time_s != inf and _exploration(self).choose(2) else -EXPIRED_S

    def past_s(self, utc_s: float) -> float:
        return EXPIRED_S if _exploration(self).has_passed(self.plan, utc_s) else -EXPIRED_S


class _Position(PlanLeaf):
    def run(self) -> Answer:
        key = self.plan.kind.name, self.read("x"), self.read("y"), self.plan.ports.get("within")
        return (SUCCESS, FAILURE)[_exploration(self).choose(2, key)]


_CONCURRENT: Final = frozenset(
    {"Parallel", "ParallelAll", "ReactiveSequence", "ReactiveFallback", "WhileDoElse"}
)


class _Switch(Switch):
    def _selected(self) -> int:
        variable = self.plan.ports.get("variable")
        if self.running != -1 and isinstance(variable, CellReference):
            any_value = self.context.cells[variable.cell] == ANY
            if any_value and not self._can_change(variable.cell):
                return self.running
        return super()._selected()

    def _can_change(self, cell: int) -> bool:
        """Return whether the value of a cell can change while a child runs."""
        top, above = self.plan, self.parent
        while isinstance(above, PlanBehaviour):
            top = above.plan if above.plan.kind.name in _CONCURRENT else top
            above = above.parent
        return cell in self.context.measured or any(
            cell in written_cells(each) for each in nodes(top)
        )

    def _is_case(self, at: int, variable: Value) -> bool:
        if ANY in {variable, self.read(f"case_{at + 1}")}:
            return _exploration(self).choose(2, (self.number, at)) == 1
        return super()._is_case(at, variable)


_OTHERS: Final[Mapping[str, NodeClass]] = {
    "Near": _Position,
    "Reachable": _Position,
    **{f"Switch{cases}": _Switch for cases in range(2, 7)},
}
CLASSES: Final[Mapping[str, NodeClass]] = {
    name: type(name, (_Explored, _OTHERS.get(name, base)), {}) for name, base in NODES.items()
}
