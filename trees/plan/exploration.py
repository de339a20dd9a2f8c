"""`Exploration`: the tree of a plan, ticked with every outcome of leaves, timers and conditions.

The nodes are those that run aboard. The results of commands, conditions on telemetry, timers and
answers are choices; a tick is repeated from the same state until each combination has been made.
"""

from collections.abc import Iterator
from typing import Any, Final, NamedTuple

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
    Question,
    Steering,
    TreeState,
    UnknownValueError,
    Value,
    input_cells,
    nodes,
)
from executive.values.clock import Clock
from executive.values.reasons import Refusal
from trees.plan.controls import Switch
from trees.plan.decorators import Delay, QueueLoop, RunUntilFailure, Timeout, Window
from trees.plan.leaves import PlanLeaf, Sleep
from trees.plan.mission import OperatorQuestion, WaitFor, WaitUntil
from trees.plan.node import FAILURE, IDLE, RUNNING, SUCCESS, Answer, PlanBehaviour
from trees.plan.tree import NODES, NodeClass, PlanTree

MAX_VALUES: Final = 8
"""Maximum number of explored values of a variable; after that it is `ANY`."""
EXPIRED_S: Final = 1e15
"""A time after all timers."""

Active = tuple[tuple[int, tuple[int, ...]], ...]


class ExploredState(NamedTuple):
    """State of the exploration between two ticks.

    Attributes:
        active: nodes with an active command, each with the cycles of the loops around it.
        done: those with a command that succeeded since the loops around them began a cycle.
    """

    tree: TreeState
    active: Active
    done: frozenset[tuple[int, tuple[int, ...]]]


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


class _Clock:
    """Gives the chosen time once, else 0."""

    next_s = 0.0

    def now_s(self) -> float:
        """Return seconds."""
        time_s, self.next_s = self.next_s, 0.0
        return time_s

    def utc_s(self) -> float:
        """Return the same, as UTC."""
        return self.now_s()


class Exploration:
    """Explores one plan; the executive's side of its tree.

    Attributes:
        runs: number of runs of nodes.
        reached: numbers of the nodes that ran.
        repeated: nodes that were commanded again after they succeeded.
        satisfied: lines of `WaitFor` nodes that succeeded.
        unwritten: variables that were read before they were written, each with the node.
        errors: paths of nodes with a script that could not be evaluated, with the reason.
        limits: lines and texts of parts that were not explored exactly.
        widened: variables that had too many values, and were explored with any.
    """

    def __init__(self, plan: PlanRoot) -> None:
        self.time = _Clock()
        self.clock: Clock = self.time
        self.why = ""
        self.runs = 0
        self.reached: set[int] = set()
        self.repeated: set[int] = set()
        self.satisfied: set[int] = set()
        self.unwritten: dict[tuple[int, int], PlanNode] = {}
        self.errors: dict[str, str] = {}
        abstraction = Abstraction(plan, self)
        self._plan = abstraction.root()
        self.limits = abstraction.limits
        self.widened: set[str] = set()
        self._names = plan.blackboard.names
        self._measured = {cell for cell, _ in plan.blackboard.telemetry}
        self._active: dict[int, tuple[int, ...]] = {}
        self._done: set[tuple[int, tuple[int, ...]]] = set()
        self._begun: set[int] = set()
        self._taken: list[list[int]] = []
        self._at = 0
        self._alike: dict[object, int] = {}
        self._tree = PlanTree(self._plan, self, CLASSES)
        values = self._tree.cells
        self._values: list[set[Value | None]] = [{each} for each in values]
        self.begin = ExploredState(self._tree.state(), (), frozenset())

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
        self._at, self.time.next_s = 0, 0.0
        self._alike.clear()
        self._begun.clear()
        self._active, self._done = dict(state.active), set(state.done)
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
        active = tuple(sorted(self._active.items()))
        after = ExploredState(self._tree.state(), active, frozenset(self._done))
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

    def forget(self, node: PlanNode) -> None:
        """Begin a new cycle of a loop: its steps may be done again."""
        below = {each.location.number for each in nodes(node)}
        self._done = {each for each in self._done if each[0] not in below}

    def telemetry(self, name: str) -> Value:
        """Return any value."""
        del name
        return ANY

    def check_target(self, x_m: float, y_m: float) -> Refusal | None:
        """Accept a motion; `Reachable` is a choice of its own."""
        del x_m, y_m
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
        self._done.add((number, cycles))
        return CommandOutcome(True, file=ANY)

    def fail_overdue(self, step: PlanStep, allowed_s: float) -> CommandOutcome:
        """Fail a step."""
        del allowed_s
        self.halt_step(step)
        return CommandOutcome(False, ANY)

    def halt_step(self, step: PlanStep) -> None:
        """Abandon the command of a step."""
        self._active.pop(step.location.number, None)
        self._begun.discard(step.location.number)

    def command_text(self, step: PlanStep) -> str:
        """Return no text."""
        del step
        return ""

    def has_expired(self, node: PlanNode, cycles: tuple[int, ...]) -> bool:
        """Return that no time limit expired before the plan began."""
        del node, cycles
        return False

    def take_answer(self, question: Question) -> str | None:
        """Choose no answer, or one of the options."""
        return (None, *question.options)[self.choose(len(question.options) + 1)]

    def withdraw(self, question: Question, answer: str = "") -> None:
        """End a question."""

    def note_failure(self, node: PlanNode, text: str, unknown: int | None = None) -> None:
        """Note a variable that was not known."""
        del text
        if unknown is None or unknown in self._measured or node.kind.name == "WaitFor":
            return
        self.unwritten[unknown, node.location.line] = node

    def on_forced(self, node: PlanNode, steering: Steering) -> None:
        """Never called: no node is forced."""


def _exploration(node: PlanBehaviour) -> Exploration:
    port = node.context.port
    assert isinstance(port, Exploration)
    return port


class _Sleep(Sleep):
    def proceed(self) -> Answer:
        _exploration(self).time.next_s = EXPIRED_S * _exploration(self).choose(2)
        return super().proceed()


class _Delay(Delay):
    def run(self) -> Answer:
        if self.until_s is not None and self.nodes[0].status is IDLE:
            _exploration(self).time.next_s = EXPIRED_S * _exploration(self).choose(2)
        elif self.until_s is not None:
            _exploration(self).time.next_s = EXPIRED_S
        return super().run()


class _Timeout(Timeout):
    def run(self) -> Answer:
        if self.until_s is not None:
            _exploration(self).time.next_s = EXPIRED_S * _exploration(self).choose(2)
        return super().run()


class _Window(Window):
    """A window; its time continues over halts.

    Attributes:
        phase: 0 before it opens, 1 while it is open, 2 after it has closed.
    """

    memory = ("phase",)
    phase = 0

    def run(self) -> Answer:
        first = max(self.phase, int("from" not in self.plan.ports))
        last = 1 + int("until" in self.plan.ports)
        self.phase = min(first + _exploration(self).choose(last - first + 1), 2)
        _exploration(self).time.next_s = (-EXPIRED_S, self._open_s, EXPIRED_S)[self.phase]
        return super().run()

    def on_halt(self) -> None:
        """Leave the time as it is."""

    @property
    def _open_s(self) -> float:
        return self.plan.number("from") if "from" in self.plan.ports else -EXPIRED_S


class _WaitUntil(WaitUntil):
    """A wait; its time continues over halts.

    Attributes:
        past: whether its time is over.
    """

    memory = ("past",)
    past = False

    def begin(self) -> Answer:
        answers = [SUCCESS] if self.past else [RUNNING, SUCCESS]
        answers += [FAILURE] * ("late_s" in self.plan.ports)
        return self._ended(answers[_exploration(self).choose(len(answers))])

    def proceed(self) -> Answer:
        return self._ended((RUNNING, SUCCESS)[_exploration(self).choose(2)])

    def _ended(self, answer: Answer) -> Answer:
        self.past = self.past or answer is not RUNNING
        return answer

    def on_halt(self) -> None:
        """Leave the time as it is."""


class _WaitFor(WaitFor):
    @property
    def is_overdue(self) -> bool:
        return self.until_utc_s is not None and _exploration(self).choose(2) == 1

    def proceed(self) -> Answer:
        answer = super().proceed()
        if answer is SUCCESS:
            _exploration(self).satisfied.add(self.plan.location.line)
        return answer


class _Question(OperatorQuestion):
    @property
    def is_overdue(self) -> bool:
        if self.until_utc_s is None or "default" in self.plan.ports:
            return False
        return _exploration(self).choose(2) == 1


class _Position(PlanLeaf):
    """`Near` or `Reachable`."""

    def run(self) -> Answer:
        key = self.plan.kind.name, self.read("x"), self.read("y"), self.plan.ports.get("within")
        return (SUCCESS, FAILURE)[_exploration(self).choose(2, key)]


class _Switch(Switch):
    def _selected(self) -> int:
        variable = self.plan.ports.get("variable")
        if isinstance(variable, CellReference) and self.context.cells[variable.cell] is None:
            _exploration(self).note_failure(self.plan, "", variable.cell)
        return super()._selected()

    def _is_case(self, at: int, variable: Value) -> bool:
        if ANY in {variable, self.read(f"case_{at + 1}")}:
            return _exploration(self).choose(2, (self.number, at)) == 1
        return super()._is_case(at, variable)


class _QueueLoop(QueueLoop):
    def run(self) -> Answer:
        queue = self.plan.ports["queue"]
        if isinstance(queue, CellReference) and self.context.cells[queue.cell] == ANY:
            _exploration(self).limits.add((self.plan.location.line, "its queue may be any"))
        return _new_cycle(self, super().run())


class _RunUntilFailure(RunUntilFailure):
    def run(self) -> Answer:
        return _new_cycle(self, super().run())


def _new_cycle(loop: PlanBehaviour, answer: Answer) -> Answer:
    if loop.nodes[0].status is not RUNNING:
        _exploration(loop).forget(loop.plan)
    return answer


def _noted(base: Any) -> NodeClass:
    """Return a class of nodes that note when they run."""

    def run(self: PlanBehaviour) -> Answer:
        _exploration(self).runs += 1
        _exploration(self).reached.add(self.number)
        answer: Answer = base.run(self)
        return answer

    made: NodeClass = type(base.__name__, (base,), {"run": run})
    return made


_EXPLORED: Final = {
    "Sleep": _Sleep,
    "Delay": _Delay,
    "Timeout": _Timeout,
    "Window": _Window,
    "WaitUntil": _WaitUntil,
    "WaitFor": _WaitFor,
    "Ask": _Question,
    "Near": _Position,
    "Reachable": _Position,
    "KeepRunningUntilFailure": _RunUntilFailure,
    **dict.fromkeys(("LoopString", "LoopDouble", "LoopPlace"), _QueueLoop),
    **{f"Switch{cases}": _Switch for cases in range(2, 7)},
}
CLASSES: Final = {name: _noted(_EXPLORED.get(name, base)) for name, base in NODES.items()}
