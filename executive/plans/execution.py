"""`PlanExecution`: the executive's side of a running plan: its commands, telemetry, questions.

The tree of a plan requests a command when a leaf begins, polls it, and halts it. A tick of the tree
precedes that of the rover, and its commands start after the commit; a command that the tree
requests and drops within one tick is never submitted.

- A node has one command at a time. Its number is stored with the state of the tree, in the commit
  of its stage RECEIVED. The outcome is the command's own stage, so the two never disagree.
- A suspension ends the running commands and forgets them; the nodes stay RUNNING, and command
  again when the plan continues.
- A plan of version 0.1 has a journal of its steps instead of a state: it answers for the steps
  that are done, by their number and the cycles of the loops around them.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import islice
from typing import Final, Protocol

from executive.commands import Request
from executive.commands.intake import source_of
from executive.commands.lifecycle import CommandLifecycle
from executive.plans.dialect import BATTERY_CHARGE, ENERGY_USED
from executive.plans.model import NodeLocation, PlanNode, PlanRoot, PlanStep, nodes, steps
from executive.plans.node_records import NodeDetail, NodeRecords
from executive.plans.scripting import Cells
from executive.plans.state import PlanState, StateCommand, TreeState
from executive.plans.syntax import Value
from executive.record import StepOutcome, StoredState
from executive.values.clock import Clock
from executive.values.plan_nodes import Question
from executive.values.reasons import Figure, Reason, Refusal
from executive.values.reports import Identity, PlanUpdate, Stage


class PlanResult(Enum):
    """Result of a tick of a plan; SKIPPED if the root was skipped."""

    RUNNING = "running"
    SUCCESS = "success"
    FAILURE = "failure"
    SKIPPED = "skipped"


class Steering(Enum):
    """Request of the operators that a node obeys at its next tick.

    SUCCESS and FAILURE end it without running it, RETRY begins it again, HOLD suspends the plan
    before it begins.
    """

    SUCCESS = "success"
    FAILURE = "failure"
    RETRY = "retry"
    HOLD = "hold"


class LeafError(Exception):
    """A leaf of the tree raised; the text is its path, the cause is the exception."""


@dataclass(frozen=True, slots=True)
class CommandOutcome:
    """End of a step's command, with the values of its output ports.

    Attributes:
        reason: number of the refusal; 0 after success.
        file: path of the stored file; empty for none.
    """

    succeeded: bool
    reason: Value = 0.0
    file: str = ""


class RoverView(Protocol):
    """The rover, as queried by the nodes of a plan."""

    def telemetry(self, name: str) -> Value | None:
        """Return a value of `dialect.TELEMETRY`; None if it is not known."""

    def check_target(self, x_m: float, y_m: float) -> Refusal | None:
        """Return why a motion to a point from here would be refused, or None."""

    def fault_active(self, name: str) -> bool:
        """Return whether a fault is active."""


class PlanPort(RoverView, Protocol):
    """The executive, as the tree of a plan needs it.

    Attributes:
        why: description of the last failure.
    """

    clock: Clock
    why: str

    @property
    def records(self) -> NodeRecords | None:
        """The records of the nodes; None if they are not needed."""

    def request(self, step: PlanStep, cycles: tuple[int, ...], cells: Cells) -> None:
        """Request the command of a step; see `PlanStep.request_from`."""

    def poll(self, step: PlanStep) -> CommandOutcome | None:
        """Return how the command of a step has ended, and forget it; None while it is active."""

    def fail_overdue(self, step: PlanStep, allowed_s: float) -> CommandOutcome | None:
        """Cancel the command of a step that exceeded its deadline; see `poll`."""

    def halt_step(self, step: PlanStep) -> None:
        """Abandon the command of a step that has not ended."""

    def command_text(self, step: PlanStep) -> str:
        """Return the last command of a step as SOURCE:NUMBER; empty before its first."""

    def has_expired(self, node: PlanNode, cycles: tuple[int, ...]) -> bool:
        """Return whether the journal of a plan of version 0.1 has the end of a time limit."""

    def take_answer(self, question: Question) -> str | None:
        """Open a question once; remove and return its answer, if there is one."""

    def withdraw(self, question: Question, answer: str = "") -> None:
        """End a question that needs no answer any longer, or has one of its own."""

    def note_failure(self, node: PlanNode, text: str, unknown: int | None = None) -> None:
        """Note why a node fails, with the cell that is not known, if that is why."""

    def on_forced(self, node: PlanNode, steering: Steering) -> None:
        """Note that a node obeyed."""


class PlanTree(Protocol):
    """The behaviour tree of a plan, as the planner needs it."""

    def tick(self) -> PlanResult:
        """Run every branch that is due once.

        Raises:
            LeafError: a leaf raised.
        """

    def state(self) -> TreeState:
        """Return all that a tick changes."""

    def load(self, state: TreeState) -> None:
        """Continue from a state.

        Raises:
            StateError: it is of another tree.
        """

    def force(self, number: int, steering: Steering) -> None:
        """Let a node obey at its next tick."""

    def details(self) -> Iterable[NodeDetail]:
        """Yield the present knowledge of its nodes beside their state."""

    def waits(self) -> str:
        """Return the present waits and questions as text; empty without any."""

    def halt(self) -> None:
        """Halt all nodes that are RUNNING."""


class PlanHost(Protocol):
    """Host of a plan's tree: the behaviour tree of the rover."""

    def attach(self, plan: PlanRoot, execution: "PlanExecution") -> PlanTree:
        """Build the tree of a plan, replacing any other, and return it."""

    def detach(self) -> None:
        """Remove the plan's tree."""


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


class Surroundings(RoverView, Protocol):
    """The rover and its surroundings, as plans see them."""

    def telemetry(self, name: str) -> float | None:
        """Return a value as a number."""

    def energy_used_j(self, charge_ratio: float | None) -> float | None:
        """Return the energy used since the battery had a charge; None if it is not known."""

    @property
    def awaits_battery(self) -> bool:
        """Whether the battery is still to report its charge after the start."""

    def check_energy(self, plan: PlanRoot, done: Sequence[int]) -> Refusal | None:
        """Return why the battery lacks energy for the other steps and the return, or None."""

    def report_question(self, plan_id: str, question: Question, end: str = "") -> None:
        """Report a question to the operators, or how it ended without them."""

    def file_of(self, command: Identity) -> str:
        """Return the path of the file that a command stored; empty if there is none."""

    @property
    def position(self) -> tuple[float, float] | None:
        """The position x, y of the rover in m; None if it is not known well enough to move."""

    @property
    def is_held(self) -> bool:
        """Whether a stop or a fault holds the rover."""


def step_key(location: NodeLocation, cycles: Sequence[int]) -> str:
    """Return the key of a node in the journal of a plan of version 0.1."""
    return ":".join([str(location.number), *map(str, cycles)])


class RunningPlan:
    """A plan and its progress.

    Attributes:
        batch: number of the ledger's batch with its last change; it begins once that is committed.
        node, done: its progress; see `PlanUpdate`.
        last: the last update sent.
        final_state: its state at the end of its last run, to be stored.
    """

    def __init__(self, last: PlanUpdate) -> None:
        self.plan_id = last.plan_id
        self.state = last.status
        self.batch = 0
        self.node = last.node
        self.done = last.done
        self.last = last
        self.final_state: StoredState | None = None


MAX_COMMANDS_PER_TICK: Final = 8
"""Maximum commands of a plan in one tick: a stop that arrives waits for all of them; chosen."""

Cancel = Callable[[CommandLifecycle, Refusal], None]

_REPLAYED: Final = {
    StepOutcome.SUCCESS: CommandOutcome(True),
    StepOutcome.FAILURE: CommandOutcome(False),
    StepOutcome.SKIPPED: CommandOutcome(True),
}


@dataclass(slots=True)
class _StepCommand:
    """The command of a step.

    Attributes:
        request: the request until it is commanded; then None.
        given: the command as it was given, or as it ended in an earlier process.
        refusal: why it was rejected.
        replayed: its end by the journal of a plan of version 0.1.
    """

    step: PlanStep
    request: Request | None = None
    given: StateCommand | None = None
    lifecycle: CommandLifecycle | None = None
    refusal: Refusal | None = None
    replayed: CommandOutcome | None = None

    @property
    def state(self) -> StateCommand | None:
        """The command as it is stored; None before it is given."""
        lifecycle = self.lifecycle
        if self.given is None or lifecycle is None or not lifecycle.stage.terminal:
            return self.given
        reason = 0 if lifecycle.refusal is None else lifecycle.refusal.reason.value
        return self.given._replace(stage=lifecycle.stage.value, reason=reason)

    def cancel(self, cancel: Cancel, refusal: Refusal) -> None:
        """Cancel it if it is active."""
        if self.lifecycle is not None and not self.lifecycle.stage.terminal:
            cancel(self.lifecycle, refusal)


class PlanExecution:
    """The commands and the knowledge of one running plan.

    Args:
        plan: the plan; its progress is updated.
        root: its root node.
        state: its state; it continues there.
        journal: outcomes of its steps, if it is a plan of version 0.1.
        cancel: cancels a command that has not ended.

    Attributes:
        why: description of the last failure.
        forced: requests that nodes obey at their next tick, by their numbers.
        held: the node before which the plan is to be suspended now, if any.
    """

    def __init__(
        self,
        plan: RunningPlan,
        root: PlanRoot,
        clock: Clock,
        cancel: Cancel,
        surroundings: Surroundings,
        state: PlanState,
        journal: Mapping[str, StepOutcome],
    ) -> None:
        self.plan = plan
        self.root = root
        self.clock = clock
        self.why = ""
        self.records: NodeRecords = NodeRecords(state.records, clock)
        self.held: PlanNode | None = None
        self._cancel = cancel
        self._surroundings = surroundings
        self.check_target = surroundings.check_target
        self.fault_active = surroundings.fault_active
        leaves = {step.location.number: step for step in steps(root)}
        self._leaves = leaves.keys()
        self._journal = journal
        self._commands = {
            each.node: _StepCommand(leaves[each.node], given=each)
            for each in state.commands
            if each.stage
        }
        self._last = dict(state.last)
        self._ended = {*state.ended, *ended_steps(journal)}
        self.forced = {number: Steering[name] for number, name in state.forced}
        self.forced |= {
            each.location.number: Steering.SUCCESS
            for each in nodes(root)
            if journal.get(step_key(each.location, ())) is StepOutcome.SKIPPED
        }
        self._answers = dict(state.answers)
        self._open_questions: dict[str, Question | None] = dict.fromkeys(state.questions)
        self._new_questions: dict[str, Question] = {}
        self._settled_questions = dict(state.settled)
        self.restarts = state.restarts
        self._charge_ratio = state.charge_ratio
        if state.tree is None:
            self._charge_ratio = surroundings.telemetry(BATTERY_CHARGE)
        plan.done = len(self._ended & self._leaves)

    def telemetry(self, name: str) -> float | None:
        """Return a value; see `PlanPort`."""
        if name == ENERGY_USED:
            return self._surroundings.energy_used_j(self._charge_ratio)
        return self._surroundings.telemetry(name)

    def request(self, step: PlanStep, cycles: tuple[int, ...], cells: Cells) -> None:
        """Request a command; see `PlanPort`."""
        outcome = self._journal and self._journal.get(step_key(step.location, cycles))
        if outcome:
            command = _StepCommand(step, replayed=_REPLAYED.get(outcome))
            self._commands[step.location.number] = command
        elif step.location.number not in self._commands:
            command = _StepCommand(step, step.request_from(cells))
            self._commands[step.location.number] = command

    def poll(self, step: PlanStep) -> CommandOutcome | None:
        """Return how a command has ended; see `PlanPort`."""
        command = self._commands[step.location.number]
        if command.replayed is not None:
            del self._commands[step.location.number]
            return command.replayed
        state, lifecycle = command.state, command.lifecycle
        if state is None or not state.stage:
            return None
        refusal = command.refusal if lifecycle is None else lifecycle.refusal
        return self._end(step, Stage(state.stage), state.reason, refusal)

    def command_text(self, step: PlanStep) -> str:
        """Return the last command of a step as text."""
        number = self._last.get(step.location.number)
        return "" if number is None else str(Identity(source_of(self.plan.plan_id), number))

    def take_requested(self) -> Sequence[tuple[PlanStep, Request]]:
        """Return the steps to command in this tick, in the tree's order."""
        commands = self._commands.values()
        wanted = ((each.step, each.request) for each in commands if each.request is not None)
        return tuple(islice(wanted, MAX_COMMANDS_PER_TICK))

    def on_started(self, step: PlanStep, lifecycle: CommandLifecycle) -> None:
        """Record the life cycle of a step's command, in any stage."""
        self._note_given(step, lifecycle.command.identity).lifecycle = lifecycle
        self.plan.node = step.location.path

    def on_rejected(self, step: PlanStep, identity: Identity, refusal: Refusal) -> None:
        """Fail a step after the rejection of its command."""
        command = self._note_given(step, identity, Stage.REJECTED.value, refusal.reason.value)
        command.refusal = refusal

    def fail_overdue(self, step: PlanStep, allowed_s: float) -> CommandOutcome | None:
        """Fail a step that exceeded its deadline."""
        command = self._commands[step.location.number]
        text = f"{step.location.path}: not done within {allowed_s:g} s"
        refusal = Refusal(Reason.PLAN_DEADLINE, text, (Figure("bound", allowed_s, "s"),))
        if command.request is not None:
            return self._end(step, Stage.CANCELLED, refusal.reason.value, refusal)
        command.cancel(self._cancel, refusal)
        return self.poll(step)

    def halt_step(self, step: PlanStep) -> None:
        """Abandon the command of a step."""
        command = self._commands.pop(step.location.number, None)
        if command is not None:
            command.cancel(
                self._cancel, Refusal(Reason.STEP_HALTED, "the plan continued without it")
            )

    def has_expired(self, node: PlanNode, cycles: tuple[int, ...]) -> bool:
        """Return whether the journal has the end of a time limit."""
        return bool(self._journal) and step_key(node.location, cycles) in self._journal

    def take_answer(self, question: Question) -> str | None:
        """Open a question, and return its answer; see `PlanPort`."""
        answer = self._answers.pop(question.key, None)
        if answer is not None:
            self._settle(question, answer)
            return answer
        if question.key not in self._open_questions:
            self._settled_questions.pop(question.key, None)
            self._new_questions[question.key] = question
        self._open_questions[question.key] = question
        return answer

    @property
    def questions(self) -> tuple[Question, ...]:
        """The open questions."""
        return tuple(filter(None, self._open_questions.values()))

    def report_questions(self) -> None:
        """Report the questions that were opened in this tick, and still are."""
        for question in self._new_questions.values():
            self._surroundings.report_question(self.plan.plan_id, question)
        self._new_questions.clear()

    def withdraw(self, question: Question, answer: str = "") -> None:
        """End a question; see `PlanPort`."""
        self._answers.pop(question.key, None)
        if question.key in self._open_questions and question.key not in self._new_questions:
            end = f"no answer, the default is {answer}" if answer else "ends without an answer"
            self._surroundings.report_question(self.plan.plan_id, question, end)
        self._settle(question, answer)

    def _settle(self, question: Question, answer: str) -> None:
        self._open_questions.pop(question.key, None)
        self._new_questions.pop(question.key, None)
        self._settled_questions[question.key] = answer

    def steer(self, state: PlanState) -> None:
        """Take requests and answers of the operators from a state."""
        self.forced = {number: Steering[name] for number, name in state.forced}
        self._answers = dict(state.answers)

    def note_failure(self, node: PlanNode, text: str, unknown: int | None = None) -> None:
        """Note why a node fails; see `PlanPort`."""
        self.why = f"{node.location.path}: {text}"

    def on_forced(self, node: PlanNode, steering: Steering) -> None:
        """Note that a node obeyed."""
        self.forced.pop(node.location.number, None)
        match steering:
            case Steering.HOLD:
                self.held = node
            case Steering.SUCCESS | Steering.FAILURE:
                self._ended |= {each.location.number for each in nodes(node)}
                self.plan.node, self.plan.done = node.location.path, len(self._ended & self._leaves)
                if steering is Steering.FAILURE:
                    self.note_failure(node, "skipped with FAILURE")
            case Steering.RETRY:
                self.records.note(node, True, "", "")

    def state(self, tree: TreeState) -> PlanState:
        """Return the state of the plan."""
        commands = (each.state for each in self._commands.values())
        return PlanState(
            tree,
            tuple(each for each in commands if each is not None),
            tuple(self._last.items()),
            tuple(sorted(self._ended)),
            tuple((number, result.name) for number, result in self.forced.items()),
            tuple(self._answers.items()),
            tuple(sorted(self._open_questions)),
            self._charge_ratio,
            self.restarts,
            self._surroundings.position,
            tuple(self._settled_questions.items()),
        )

    def cancel_running(self, refusal: Refusal) -> None:
        """Cancel every active command and forget it; one that has ended stays known."""
        for number, command in tuple(self._commands.items()):
            if command.state is None or not command.state.stage:
                del self._commands[number]
                command.cancel(self._cancel, refusal)
        self._ended |= self._commands.keys()

    def _note_given(
        self, step: PlanStep, identity: Identity, stage: int = 0, reason: int = 0
    ) -> _StepCommand:
        number, command_id = step.location.number, identity.command_id
        command = self._commands[number]
        command.request, command.given = None, StateCommand(number, command_id, stage, reason)
        self._last[number] = command_id
        return command

    def _end(
        self, step: PlanStep, stage: Stage, reason: int, refusal: Refusal | None
    ) -> CommandOutcome:
        """Forget the command of a step that has ended, and return its outcome."""
        number, path = step.location.number, step.location.path
        given = self._commands.pop(number).given
        self._ended.add(number)
        self.plan.node, self.plan.done = path, len(self._ended & self._leaves)
        if stage is not Stage.EXECUTED:
            text = f" {reason} ({refusal.text.removeprefix(f'{path}: ')})" if refusal else ""
            self.why = f"{path}: {stage.name}{text}"
            self.records.note_reason(number, reason)
            return CommandOutcome(False, float(reason))
        file = ""
        if given is not None and step.kind.port("file") is not None:
            identity = Identity(source_of(self.plan.plan_id), given.command_id)
            file = self._surroundings.file_of(identity)
        return CommandOutcome(True, float(reason), file)


def ended_steps(journal: Mapping[str, StepOutcome]) -> set[int]:
    """Return the numbers of the nodes that have ended by the journal of a plan of version 0.1."""
    return {
        int(key.partition(":")[0])
        for key, outcome in journal.items()
        if outcome is not StepOutcome.HALTED
    }
