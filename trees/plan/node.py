"""`PlanBehaviour`, base of the nodes of a plan: its tick with conditions, halting, and state.

The semantics are those of BehaviorTree.CPP v4. Nodes are ticked by `execute`. SKIPPED is an answer
to the parent and never a status: a node that answers it does not change its status. A node that
is reset is halted if it is RUNNING, and IDLE (INVALID of py_trees) in any case.
"""

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from enum import Enum
from math import inf
from typing import ClassVar, Final, Protocol

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from executive.plans import (
    ArgumentError,
    CellReference,
    EvaluationError,
    LeafError,
    NodeRecords,
    PlanNode,
    PlanPort,
    Script,
    Steering,
    UnknownValueError,
    Value,
    text_of,
)
from executive.values.reports import TERMINAL

IDLE: Final = Status.INVALID
RUNNING: Final = Status.RUNNING
SUCCESS: Final = Status.SUCCESS
FAILURE: Final = Status.FAILURE


class _Skip(Enum):
    SKIPPED = "skipped"


SKIPPED: Final = _Skip.SKIPPED
Answer = Status | _Skip
"""Result of a tick, for the parent."""

ANSWERS: Final[Mapping[str, Answer]] = {
    "SUCCESS": SUCCESS,
    "FAILURE": FAILURE,
    "RUNNING": RUNNING,
    "SKIPPED": SKIPPED,
}
"""Answers by their names in a plan."""


def time_text(utc_s: float) -> str:
    """Return the time of day as text."""
    minutes, seconds = divmod(int(utc_s) % 86_400, 60)
    text = f"{minutes // 60:02}:{minutes % 60:02}"
    return f"{text}:{seconds:02} UTC" if seconds else f"{text} UTC"


class PlanRun(Protocol):
    """Data that the nodes of a tree share.

    Attributes:
        port: the executive's side of the plan.
        cells: the blackboard.
        cell_names: names of its cells.
        yielded: whether a node requests another tick at once.
        executed: number of nodes executed in this tick.
        measured: cells with telemetry.
    """

    port: PlanPort
    cells: list[Value | None]
    cell_names: tuple[str, ...]
    yielded: bool
    executed: int
    measured: frozenset[int]

    @property
    def records(self) -> NodeRecords | None:
        """See `PlanPort`."""


class PlanBehaviour(Behaviour):
    """A node of a plan.

    Attributes:
        plan: the node as it was read.
        nodes: its children.
        number: number of the node in the plan.
        memory: names of the attributes that are part of its state, beside the status.
        timers: names of those that are times on the executive's clock; None if not running.
        forced: request of the operators that it obeys at its next tick.
        loops: the loops with a count around it, outermost first.
        unknown: name of the telemetry or variable that it needs and that is not known.
    """

    memory: ClassVar[tuple[str, ...]] = ()
    timers: ClassVar[tuple[str, ...]] = ()
    loops: tuple["PlanBehaviour", ...] = ()
    unknown = ""
    _choice: object = None
    _noted = ""
    _last: Status | None = None
    _decided = False

    def __init__(self, plan: PlanNode, run: PlanRun, nodes: Sequence["PlanBehaviour"]) -> None:
        super().__init__(plan.location.name)
        self.plan = plan
        self.number = plan.location.number
        self.context = run
        self.nodes = tuple(nodes)
        self.children = list(nodes)
        for child in nodes:
            child.parent = self
        self.forced: Steering | None = None
        self._conditions = plan.conditions
        self._guarded = bool(plan.conditions)

    @abstractmethod
    def run(self) -> Answer:
        """Do the work of one tick, and return the answer."""

    def execute(self) -> Answer:
        """Tick the node, and return its answer.

        Raises:
            LeafError: it raised.
        """
        if self._guarded and self.forced is Steering.HOLD and self.status is IDLE:
            self.context.port.on_forced(self.plan, Steering.HOLD)
            return RUNNING  # it stays IDLE, so that it begins when the plan continues
        self.context.executed += 1
        before = self.status
        if before is IDLE and (self._decided or self.unknown):
            self._choice, self._decided, self.unknown, self.feedback_message = None, False, "", ""
        answer = self._execute_guarded() if self._guarded else self._run_contained()
        if self._noted and before is IDLE and not self._decided:
            self._note_decision("")  # that of the last time
        if answer is not SKIPPED:
            self.status = answer
            if answer is not before and (before is not IDLE or answer is not self._last):
                self._note_change(before is IDLE)
        return answer

    def halt(self) -> None:
        """Halt the node, which is RUNNING, with all below it."""
        self.on_halt()
        self.reset_children()
        self.status, self._choice = IDLE, None
        if (records := self.context.records) is not None:
            records.note_halt(self.plan)
        self._run_script("_onHalted")

    @property
    def cycles(self) -> tuple[int, ...]:
        """The present cycle of each loop around it, from 1."""
        return tuple(getattr(each, "count", 0) + 1 for each in self.loops)

    @property
    def waits(self) -> str:
        """Its wait or question as text, while it is RUNNING; empty for none."""
        return ""

    @property
    def next_utc_s(self) -> float | None:
        """End of its wait, deadline or window while it is RUNNING, seconds since 1970 UTC."""
        return None

    def utc_of(self, time_s: float | None) -> float | None:
        """Return the UTC of a time on the executive's clock; None if it has passed."""
        clock = self.context.port.clock
        left_s = inf if time_s is None else time_s - clock.now_s()
        return clock.utc_s() + left_s if 0.0 <= left_s < inf else None

    def overdue_s(self, time_s: float) -> float:
        """Return the seconds since a time on the executive's clock; negative before it."""
        return self.context.port.clock.now_s() - time_s

    def past_s(self, utc_s: float) -> float:
        """Return the seconds since an absolute time; negative before it."""
        return self.context.port.clock.utc_s() - utc_s

    def on_load(self) -> None:
        """Continue after its state was loaded, with the decision that it took."""
        records = self.context.records
        decision = "" if records is None else records.decision(self.plan)
        self._noted, self._choice, self._decided = decision, decision or None, bool(decision)
        if self.status is RUNNING:
            self.feedback_message = decision

    def on_halt(self) -> None:
        """Give the attributes of its state their initial values."""
        for name in (*self.memory, *self.timers):
            setattr(self, name, getattr(type(self), name))

    def reset(self) -> None:
        """Halt the node if it is RUNNING, and make it IDLE."""
        if self.status is RUNNING:
            self.halt()
        self.status = IDLE

    def reset_children(self) -> None:
        """Reset all children."""
        for child in self.nodes:
            if child.status is not IDLE:
                child.reset()

    def update(self) -> Status:
        """Return the status; the node is ticked by `execute`."""
        return self.status

    def tick(self) -> Iterator[Behaviour]:
        """Tick as any behaviour of py_trees."""
        self.execute()
        yield self

    def force(self, steering: Steering) -> None:
        """Obey at the next tick."""
        self.forced, self._guarded = steering, True

    def read(self, port: str) -> Value:
        """Return the value of an input port.

        Raises:
            UnknownValueError: its variable has no known value.
        """
        value = self.plan.ports[port]
        if isinstance(value, CellReference):
            found = self.context.cells[value.cell]
            if found is None:
                raise UnknownValueError(value.cell)
            return found
        assert isinstance(value, float | int | str)
        return value

    def read_text(self, port: str) -> str:
        """Return an input port as text; see `read`."""
        return text_of(self.read(port))

    def write(self, port: str, value: Value | None) -> None:
        """Write an output port, if the plan gives it."""
        target = self.plan.ports.get(port)
        if isinstance(target, CellReference):
            self.context.cells[target.cell] = value

    def script(self, port: str) -> Script:
        """Return the script of a port."""
        found = self.plan.ports[port]
        assert isinstance(found, Script)
        return found

    def holds(self, script: Script) -> bool | None:
        """Return whether a condition holds; None if it is not known, which the message names.

        Raises:
            LeafError: it cannot be evaluated.
        """
        try:
            holds = script.holds(self.context.cells)
            self.unknown = ""
            return holds
        except UnknownValueError as unknown:
            self.note_unknown(unknown)
            return None
        except EvaluationError as error:
            raise LeafError(self.plan.location.path) from error

    def note_unknown(self, unknown: UnknownValueError) -> None:
        """Name the value that is not known in the message, and in the reason of a failure."""
        self.unknown = self.context.cell_names[unknown.cell]
        self.feedback_message = f"{self.unknown} is not known"
        self.context.port.note_failure(self.plan, self.feedback_message, unknown.cell)

    def decide(self, choice: object, text: str) -> None:
        """Note a choice once until the node ends, for the operators.

        Args:
            choice: the choice; it is noted if it differs from the last one.
            text: the choice and its cause; it begins with one of `DECISIONS`.
        """
        self._decided, self.feedback_message = True, text
        if choice != self._choice:
            self._choice = choice
            if text != self._noted:
                self._note_decision(text)

    def branch_text(self, at: int) -> str:
        """Return which child it chose, as the begin of a text of a choice."""
        return f"took the {_ORDINALS.get(at, f'{at + 1}th')} branch {self.nodes[at].name}"

    def cause_of(self, child: "PlanBehaviour", answer: Answer) -> str:
        """Return why a child gave an answer, with the name of a node instead of its path."""
        if answer is not FAILURE:
            return f"{child.name} {'was skipped' if answer is SKIPPED else 'succeeded'}"
        path, _, text = self.context.port.why.partition(": ")
        link = " was " if text.partition(" ")[0] in _STAGES else ": "
        return f"{path.rpartition('/')[2]}{link}{text}"

    def _note_change(self, begins: bool) -> None:
        """Note that it began, or ended."""
        records, result = self.context.records, _RESULTS[self.status]
        if result:
            self._last = self.status
        if records is not None:
            records.note(self.plan, begins, result, self.context.port.why)

    def _note_decision(self, text: str) -> None:
        self._noted = text
        if (records := self.context.records) is not None:
            records.note_decision(self.plan, text)

    def _run_contained(self) -> Answer:
        """Run; a value that is not known or not valid fails the node."""
        try:
            return self.run()
        except UnknownValueError as unknown:
            self.note_unknown(unknown)
        except ArgumentError as error:
            self.context.port.note_failure(self.plan, str(error))
        return FAILURE

    def _execute_guarded(self) -> Answer:
        answer: Answer | None = None
        if self.forced not in {None, Steering.HOLD}:
            answer = self._obey()
        if answer is None:
            answer = self._precondition()
            if answer is None:
                answer = self._run_contained()
        if answer is SUCCESS or answer is FAILURE:
            ended = "_onSuccess" if answer is SUCCESS else "_onFailure"
            if not (self._run_script(ended) and self._run_script("_post")):
                return FAILURE
        return answer

    def _obey(self) -> Answer | None:
        steering = self.forced
        assert steering is not None
        self.reset()
        self.forced, self._guarded = None, bool(self._conditions)
        self.context.port.on_forced(self.plan, steering)
        if steering is Steering.RETRY:
            self.decide(steering, "begins again: requested by an operator")
            return None
        self.decide(steering, f"skipped with {steering.name}: requested by an operator")
        self._last = SUCCESS if steering is Steering.SUCCESS else FAILURE
        if (records := self.context.records) is not None:  # it has not begun: no try
            records.note(self.plan, False, _RESULTS[self._last], self.context.port.why)
        return self._last

    def _precondition(self) -> Answer | None:
        conditions = self._conditions
        if self.status is IDLE:
            for name, met in _BEFORE:
                script = conditions.get(name)
                if script is None:
                    continue
                holds = self.holds(script)
                if holds is None:
                    return FAILURE
                if holds and met is FAILURE:
                    self.context.port.note_failure(self.plan, f"{name}: {script.text}")
                if holds:
                    result = "" if met is SKIPPED else f" with {met.name}"
                    self.decide(name, f"skipped{result}: {name} {script.text}")
                    return met
        if (script := conditions.get("_while")) is None or self.status not in _WHILE:
            return None
        if holds := self.holds(script):
            return None
        text = f"_while {script.text}" if holds is False else self.feedback_message
        if self.status is RUNNING:
            self.halt()
            self.decide("_while", f"ended: {text}")
        else:
            self.decide("_while", f"skipped: {text}")
        return SKIPPED

    def _run_script(self, name: str) -> bool:
        """Run a script after the end, if any; return whether all its values were known."""
        script = self._conditions.get(name)
        return script is None or self.holds(script) is not None


_BEFORE: Final[tuple[tuple[str, Answer], ...]] = (
    ("_failureIf", FAILURE),
    ("_successIf", SUCCESS),
    ("_skipIf", SKIPPED),
)
_WHILE: Final = (IDLE, RUNNING)
_RESULTS: Final = {RUNNING: "", SUCCESS: "S", FAILURE: "F"}
_ORDINALS: Final = {0: "first", 1: "second", 2: "third"}
_STAGES: Final = {each.name for each in TERMINAL}
