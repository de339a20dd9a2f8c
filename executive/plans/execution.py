"""`PlanExecution` commands each step of a running plan at most once, and writes its journal.

The tree polls every step each time it reaches it. Steps known to the journal are answered
immediately, so that a rebuilt tree reaches the state of the plan by itself. Only the other steps
are commanded.

- A step has a key: the number of its node, and the cycles of the loops around it. Each key is
  commanded at most once.
- The journal holds the number of a step's command, written in the commit of its stage
  RECEIVED. The outcome is the command's own stage, so the two never disagree.
- Abandoned branches (the rest of a decided `Parallel`, nodes below an expired `Timeout`) are in the
  journal, too: on replay they stay RUNNING without a command until the same node decides again.
- Suspending removes the active steps from the journal and ends their commands; they are commanded
  again.

A plan's tree is ticked before the rover's, and its commands start after the commit. A command that
the tree requests and drops within one tick is never submitted.
"""

from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from itertools import islice
from typing import Final, Protocol

from executive.commands.lifecycle import CommandLifecycle
from executive.plans.model import NodeLocation, PlanNode, PlanStep, TimeoutNode, steps
from executive.record import PlanStore, StepOutcome
from executive.values.clock import Clock
from executive.values.reasons import Figure, Reason, Refusal
from executive.values.reports import Identity, PlanUpdate, Stage


class StepStatus(Enum):
    """Status of a plan, or of a step of it."""

    RUNNING = "running"
    SUCCESS = "success"
    FAILURE = "failure"


class LeafError(Exception):
    """A leaf of the tree raised; the text is its path, the cause is the exception."""


class PlanTree(Protocol):
    """The behaviour tree of a plan, as the planner needs it."""

    def tick(self) -> StepStatus:
        """Run every branch that is due once.

        Raises:
            LeafError: a leaf raised.
        """


class PlanHost(Protocol):
    """Host of a plan's tree: the behaviour tree of the rover."""

    def attach(self, plan: PlanNode, execution: "PlanExecution") -> PlanTree:
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


def step_key(location: NodeLocation, cycles: Sequence[int]) -> str:
    """Return the key of a node within the cycles of the loops around it, outermost first."""
    return ":".join([str(location.number), *map(str, cycles)])


class RunningPlan:
    """A plan and its progress.

    Attributes:
        batch: number of the ledger's batch with its last change; it begins once that is committed.
        node, done: its progress; see `PlanUpdate`.
        last: the last update sent.
    """

    def __init__(self, last: PlanUpdate) -> None:
        self.plan_id = last.plan_id
        self.state = last.status
        self.batch = 0
        self.node = last.node
        self.done = last.done
        self.last = last


MAX_COMMANDS_PER_TICK: Final = 8
"""Maximum commands of a plan in one tick: a stop that arrives waits for all of them; chosen."""
MAX_POLLS_PER_TICK: Final = 500
"""Number of polled steps after which loops continue in the next tick; chosen, not measured."""

Cancel = Callable[[CommandLifecycle, Refusal], None]

_ANSWER: Final = {
    StepOutcome.SUCCESS: StepStatus.SUCCESS,
    StepOutcome.FAILURE: StepStatus.FAILURE,
    StepOutcome.HALTED: StepStatus.RUNNING,
    StepOutcome.SKIPPED: StepStatus.SUCCESS,
}


def ended_leaves(root: PlanNode, journal: Mapping[str, StepOutcome]) -> set[int]:
    """Return the numbers of the leaves that have ended at least once, or were skipped."""
    leaves = {step.location.number for step in steps(root)}
    ended = {
        int(key.partition(":")[0])
        for key, outcome in journal.items()
        if outcome is not StepOutcome.HALTED
    }
    return ended & leaves


class PlanExecution:
    """The steps of one plan. A key names a step and the cycles of the loops around it.

    Args:
        plan: the plan; its journal is continued, and its progress updated.
        root: its root node.
        cancel: cancels a command that has not ended.

    Attributes:
        why: description of the last failed step.
    """

    def __init__(
        self, plan: RunningPlan, root: PlanNode, clock: Clock, store: PlanStore, cancel: Cancel
    ) -> None:
        self.plan = plan
        self.clock = clock
        self.why = ""
        self._store = store
        self._known = dict(store.journal(plan.plan_id))
        self._requested: dict[str, PlanStep] = {}
        self._polls = 0
        self._lifecycles: dict[str, CommandLifecycle] = {}
        self._commands = dict(store.commands(plan.plan_id))
        self._done = ended_leaves(root, self._known)
        plan.done = len(self._done)
        self._cancel = cancel

    @property
    def exhausted(self) -> bool:
        """Whether loops must wait for the next tick."""
        return self._polls >= MAX_POLLS_PER_TICK

    def begin_tick(self) -> None:
        """Reset the count of polled steps for this tick."""
        self._polls = 0

    def poll(self, key: str, step: PlanStep) -> StepStatus:
        """Return the status of a step; request its command on the first poll."""
        self._polls += 1
        if key in self._known:
            return _ANSWER[self._known[key]]
        if key not in self._lifecycles:
            self._requested[key] = step
            return StepStatus.RUNNING
        lifecycle = self._lifecycles[key]
        if not lifecycle.stage.terminal:
            return StepStatus.RUNNING
        del self._lifecycles[key]
        outcome = StepOutcome.SUCCESS if lifecycle.stage is Stage.EXECUTED else StepOutcome.FAILURE
        self._note(key, step, outcome)
        if outcome is StepOutcome.FAILURE:
            text = f" ({lifecycle.refusal.text})" if lifecycle.refusal else ""
            self.why = f"{step.location.path}: {lifecycle.stage.name}{text}"
        return _ANSWER[outcome]

    def skips(self, location: NodeLocation) -> bool:
        """Whether an operator skipped a node."""
        return self._known.get(step_key(location, ())) is StepOutcome.SKIPPED

    def command_of(self, key: str) -> Identity | None:
        """Return the last command of a step; None before its first."""
        return self._commands.get(key)

    def take_requested(self) -> Sequence[tuple[str, PlanStep]]:
        """Remove and return the steps to command in this tick, in the tree's order."""
        wanted = list(islice(self._requested.items(), MAX_COMMANDS_PER_TICK))
        for key, _ in wanted:
            del self._requested[key]
        return wanted

    def on_started(self, key: str, step: PlanStep, lifecycle: CommandLifecycle) -> None:
        """Record the life cycle of a step's command, in any stage."""
        self._lifecycles[key] = lifecycle
        self._note_command(key, lifecycle.command.identity)
        self.plan.node = step.location.path

    def on_rejected(self, key: str, step: PlanStep, identity: Identity, refusal: Refusal) -> None:
        """Fail a step after the rejection of its command."""
        self._note_command(key, identity)
        self._note(key, step, StepOutcome.FAILURE)
        self.why = f"{step.location.path}: REJECTED ({refusal.text})"

    def fail_overdue(self, key: str, step: PlanStep, allowed_s: float) -> StepStatus:
        """Fail a step that exceeded its deadline."""
        if key in self._lifecycles:
            text = f"{step.location.path}: not done within {allowed_s:g} s"
            figures = (Figure("bound", allowed_s, "s"),)
            self._cancel(self._lifecycles[key], Refusal(Reason.PLAN_DEADLINE, text, figures))
        return self.poll(key, step)

    def halt_step(self, key: str) -> None:
        """Abandon a step that has not ended."""
        self._requested.pop(key, None)
        if key in self._known:
            return
        lifecycle = self._lifecycles.pop(key, None)
        if lifecycle is not None:
            self._cancel(lifecycle, Refusal(Reason.STEP_HALTED, "the plan continued without it"))
        self._settle(key, StepOutcome.HALTED)

    def timed_out(self, key: str) -> bool:
        """Whether the journal records that this time limit expired."""
        return key in self._known

    def time_out(self, key: str, limit: TimeoutNode) -> None:
        """Record that a time limit expired."""
        self.why = f"{limit.location.path}: not done within {limit.duration_s:g} s"
        self._settle(key, StepOutcome.FAILURE)

    def cancel_running(self, refusal: Refusal) -> None:
        """Cancel every active command; steps that have ended stay in the journal."""
        self._requested.clear()
        self._store.forget_unfinished_steps(self.plan.plan_id)
        for lifecycle in self._lifecycles.values():
            self._cancel(lifecycle, refusal)
        self._lifecycles.clear()

    def _note_command(self, key: str, identity: Identity) -> None:
        self._commands[key] = identity
        self._store.begin(self.plan.plan_id, key, identity.command_id)

    def _note(self, key: str, step: PlanStep, outcome: StepOutcome) -> None:
        self._known[key] = outcome
        self._done.add(step.location.number)
        self.plan.node, self.plan.done = step.location.path, len(self._done)

    def _settle(self, key: str, outcome: StepOutcome) -> None:
        self._known[key] = outcome
        self._store.set_outcome(self.plan.plan_id, key, outcome)
