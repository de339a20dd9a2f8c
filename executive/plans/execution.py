"""The steps of the plan that executes: its commands and its journal.

The tree asks for every step each time it comes to it; what the journal knows is answered at once,
so that a tree that is built again comes by itself to where the plan was. Only the other steps are
commanded.

- A step has a key: the number of its node, and the cycles of the loops around it. Each key is
  commanded at most once.
- The journal holds the number of a step's command, written in the commit in which the command is
  RECEIVED. The outcome is the command's own stage, so the two never disagree.
- Branches that the plan left behind (the rest of a decided `Parallel`, nodes below a `Timeout` that
  ran out) are in the journal, too: on replay they stay RUNNING without a command until the same
  node decides again.
- Suspending drops the steps under way from the journal and ends their commands; they are commanded
  again.

A plan's tree is ticked before the rover's, and its commands start after the commit. A command that
the tree asks for and drops within one tick is never given.
"""

from collections.abc import Callable, Sequence
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
    """How a plan, or a step of it, goes."""

    RUNNING = "running"
    SUCCESS = "success"
    FAILURE = "failure"


class PlanTree(Protocol):
    """The behaviour tree of a plan, as the planner needs it."""

    def tick(self) -> StepStatus:
        """Run every branch that is due once.

        Raises:
            executive.core.tree.LeafError: a leaf raised.
        """


class PlanHost(Protocol):
    """Where the tree of a plan is attached: the behaviour tree of the rover."""

    def attach(self, plan: PlanNode, execution: "PlanExecution") -> PlanTree:
        """Build the tree of a plan, in the place of any other, and return it."""

    def detach(self) -> None:
        """Drop the plan's tree."""


def step_key(place: NodeLocation, cycles: Sequence[int]) -> str:
    """Return the key of a node within the cycles of the loops around it, outermost first."""
    return ":".join([str(place.number), *map(str, cycles)])


class RunningPlan:
    """One plan.

    Attributes:
        state: its status.
        node, done: how far it has come; see `PlanUpdate`.
        last: the update that was last sent of it.
    """

    def __init__(self, last: PlanUpdate) -> None:
        self.plan_id = last.plan_id
        self.state = last.status
        self.node = last.node
        self.done = last.done
        self.last = last


MOST_COMMANDS_A_TICK: Final = 8
"""Of a plan: the core has other work, and a stop that comes would wait for all of them."""
MOST_POLLS_A_TICK: Final = 500
"""Steps asked for, beyond which loops go on in the next tick."""

Cancel = Callable[[CommandLifecycle, Refusal], None]

_ANSWER: Final = {
    StepOutcome.SUCCESS: StepStatus.SUCCESS,
    StepOutcome.FAILURE: StepStatus.FAILURE,
    StepOutcome.HALTED: StepStatus.RUNNING,
}


class PlanExecution:
    """The steps of one plan. A key names a step and the cycles of the loops around it.

    Args:
        plan: whose journal is gone on with, and in which is noted how far it comes.
        root: its root node.
        cancel: ends a command that has not ended.

    Attributes:
        why: what is said of the step that failed last.
    """

    def __init__(
        self, plan: RunningPlan, root: PlanNode, clock: Clock, store: PlanStore, cancel: Cancel
    ) -> None:
        self.plan = plan
        self.clock = clock
        self.why = ""
        self._store = store
        self._known = dict(store.journal(plan.plan_id))
        self._wanted: dict[str, PlanStep] = {}
        self._polls = 0
        self._lives: dict[str, CommandLifecycle] = {}
        self._commands = dict(store.commands(plan.plan_id))
        leaves = {step.place.number for step in steps(root)}
        self._done = {
            number
            for key, outcome in self._known.items()
            if outcome is not StepOutcome.HALTED
            and (number := int(key.partition(":")[0])) in leaves
        }
        plan.done = len(self._done)
        self._cancel = cancel

    @property
    def exhausted(self) -> bool:
        """Whether loops have to wait for the next tick."""
        return self._polls >= MOST_POLLS_A_TICK

    def begin_tick(self) -> None:
        """Begin to count what this tick asks for."""
        self._polls = 0

    def poll(self, key: str, step: PlanStep) -> StepStatus:
        """Return how a step goes; ask for its command, if that was not done."""
        self._polls += 1
        if key in self._known:
            return _ANSWER[self._known[key]]
        if key not in self._lives:
            self._wanted[key] = step
            return StepStatus.RUNNING
        life = self._lives[key]
        if not life.stage.terminal:
            return StepStatus.RUNNING
        del self._lives[key]
        outcome = StepOutcome.SUCCESS if life.stage is Stage.EXECUTED else StepOutcome.FAILURE
        self._note(key, step, outcome)
        if outcome is StepOutcome.FAILURE:
            said = f" ({life.refusal.text})" if life.refusal else ""
            self.why = f"{step.place.path}: {life.stage.name}{said}"
        return _ANSWER[outcome]

    def command_of(self, key: str) -> Identity | None:
        """Return the command that a step asked for last; None if it has asked for none."""
        return self._commands.get(key)

    def take_wanted(self) -> Sequence[tuple[str, PlanStep]]:
        """Return the steps to be commanded in this tick, in the order in which the tree asked."""
        wanted = list(islice(self._wanted.items(), MOST_COMMANDS_A_TICK))
        for key, _ in wanted:
            del self._wanted[key]
        return wanted

    def began(self, key: str, step: PlanStep, life: CommandLifecycle) -> None:
        """Take the life of a step's command, whatever it has come to."""
        self._lives[key] = life
        self._note_command(key, life.command.identity)
        self.plan.node = step.place.path

    def refused(self, key: str, step: PlanStep, identity: Identity, refusal: Refusal) -> None:
        """Let a step fail whose command was refused."""
        self._note_command(key, identity)
        self._note(key, step, StepOutcome.FAILURE)
        self.why = f"{step.place.path}: REJECTED ({refusal.text})"

    def overdue(self, key: str, step: PlanStep, allowed_s: float) -> StepStatus:
        """Let a step fail that took longer than its deadline allows."""
        if key in self._lives:
            text = f"{step.place.path}: not done within {allowed_s:g} s"
            figures = (Figure("bound", allowed_s, "s"),)
            self._cancel(self._lives[key], Refusal(Reason.PLAN_DEADLINE, text, figures))
        return self.poll(key, step)

    def halt(self, key: str) -> None:
        """Go on without a step that is not done."""
        self._wanted.pop(key, None)
        if key in self._known:
            return
        life = self._lives.pop(key, None)
        if life is not None:
            self._cancel(life, Refusal(Reason.PLAN_WENT_ON, "the plan went on without it"))
        self._settle(key, StepOutcome.HALTED)

    def timed_out(self, key: str) -> bool:
        """Whether a time limit is known to have ended its child."""
        return key in self._known

    def time_out(self, key: str, limit: TimeoutNode) -> None:
        """Remember that a time limit ends its child."""
        self.why = f"{limit.place.path}: not done within {limit.duration_s:g} s"
        self._settle(key, StepOutcome.FAILURE)

    def cancel_under_way(self, refusal: Refusal) -> None:
        """End every command under way; what has ended by now stays in the journal."""
        self._wanted.clear()
        self._store.forget_unfinished_steps(self.plan.plan_id)
        for life in self._lives.values():
            self._cancel(life, refusal)
        self._lives.clear()

    def _note_command(self, key: str, identity: Identity) -> None:
        self._commands[key] = identity
        self._store.begin(self.plan.plan_id, key, identity.command_id)

    def _note(self, key: str, step: PlanStep, outcome: StepOutcome) -> None:
        self._known[key] = outcome
        self._done.add(step.place.number)
        self.plan.node, self.plan.done = step.place.path, len(self._done)

    def _settle(self, key: str, outcome: StepOutcome) -> None:
        self._known[key] = outcome
        self._store.settle(self.plan.plan_id, key, outcome)
