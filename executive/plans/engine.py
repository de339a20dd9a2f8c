"""What may be asked of plans, and the one that executes: its tree, its commands, its journal.

The tree asks for every step each time it comes to it; what the journal knows is answered at once,
so that a tree that is built again comes by itself to where the plan was.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Final, Protocol, assert_never

from executive.clock import Clock
from executive.commands import (
    AbortPlan,
    ActivatePlan,
    Command,
    PlanDefinition,
    PlanRequest,
    RemovePlan,
    ResumePlan,
    SubmitPlan,
    SuspendPlan,
)
from executive.commands.intake import PLAN_LINK, source_of
from executive.commands.lifecycle import Admitted, Life, Refused, SubmitResult
from executive.notifications import Notifications
from executive.plans.builder import check_plan
from executive.plans.model import Place, PlanNode, Step, TimeoutNode, steps
from executive.plans.register import FINAL_STATUSES, ActivePlans, Plan, PlanEvent, Register, sources
from executive.reasons import Figure, Reason, Refusal
from executive.record import Outcome, PlanStore
from executive.reports import Identity, PlanStatus, PlanUpdate, Stage
from executive.settings import Settings


class Progress(Enum):
    """How a plan, or a step of it, goes."""

    RUNNING = "running"
    SUCCESS = "success"
    FAILURE = "failure"


class PlanTree(Protocol):
    """The behaviour tree of a plan, as the planner needs it."""

    def tick(self) -> Progress:
        """Run every branch that is due once.

        Raises:
            executive.runner.LeafError: a leaf raised.
        """
        ...


class PlanHost(Protocol):
    """Where the tree of a plan is attached: the behaviour tree of the rover."""

    def attach(self, plan: PlanNode, execution: "PlanExecution") -> PlanTree:
        """Build the tree of a plan, in the place of any other, and return it."""
        ...

    def detach(self) -> None:
        """Drop the plan's tree."""
        ...


def step_key(place: Place, cycles: Sequence[int]) -> str:
    """Return the key of a node within the cycles of the loops around it, outermost first."""
    return ":".join([str(place.number), *map(str, cycles)])


def _number(key: str) -> int:
    return int(key.partition(":")[0])


Cancel = Callable[[Life, Refusal], None]

_ANSWER: Final = {
    Outcome.SUCCESS: Progress.SUCCESS,
    Outcome.FAILURE: Progress.FAILURE,
    Outcome.HALTED: Progress.RUNNING,
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
        self, plan: Plan, root: PlanNode, clock: Clock, store: PlanStore, cancel: Cancel
    ) -> None:
        self.plan = plan
        self.clock = clock
        self.why = ""
        self._plan_id = plan.plan_id
        self._store = store
        self._known = dict(store.journal(plan.plan_id))
        self._wanted: dict[str, Step] = {}
        self._lives: dict[str, Life] = {}
        leaves = {step.place.number for step in steps(root)}
        self._done = {
            number
            for key, outcome in self._known.items()
            if outcome is not Outcome.HALTED and (number := _number(key)) in leaves
        }
        plan.done = len(self._done)
        self._cancel = cancel

    def poll(self, key: str, step: Step) -> Progress:
        """Return how a step goes; ask for its command, if that was not done."""
        if key in self._known:
            return _ANSWER[self._known[key]]
        if key not in self._lives:
            self._wanted[key] = step
            return Progress.RUNNING
        life = self._lives[key]
        if not life.stage.terminal:
            return Progress.RUNNING
        return _ANSWER[self._end(key, step, life)]

    def take_wanted(self) -> Sequence[tuple[str, Step]]:
        """Return the steps that are to be commanded now, in the order in which the tree asked."""
        wanted = list(self._wanted.items())
        self._wanted.clear()
        return wanted

    def began(self, key: str, step: Step, life: Life) -> None:
        """Take the life of a step's command, whatever it has come to."""
        self._lives[key] = life
        self._store.begin(self._plan_id, key, life.command.identity.command_id)
        self.plan.node = step.place.path

    def refused(self, key: str, step: Step, number: int, refusal: Refusal) -> None:
        """Let a step fail whose command was refused."""
        self._store.begin(self._plan_id, key, number)
        self._note(key, step, Outcome.FAILURE)
        self.why = f"{step.place.path}: REJECTED ({refusal.text})"

    def overdue(self, key: str, step: Step, allowed_s: float) -> Progress:
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
        self._settle(key, Outcome.HALTED)

    def timed_out(self, key: str) -> bool:
        """Whether a time limit is known to have ended its child."""
        return key in self._known

    def time_out(self, key: str, limit: TimeoutNode) -> None:
        """Remember that a time limit ends its child."""
        self.why = f"{limit.place.path}: not done within {limit.duration_s:g} s"
        self._settle(key, Outcome.FAILURE)

    def cancel_under_way(self, refusal: Refusal) -> None:
        """End every command under way; what has ended by now stays in the journal."""
        self._wanted.clear()
        self._store.forget_unfinished_steps(self._plan_id)
        for life in self._lives.values():
            self._cancel(life, refusal)
        self._lives.clear()

    def _end(self, key: str, step: Step, life: Life) -> Outcome:
        del self._lives[key]
        outcome = Outcome.SUCCESS if life.stage is Stage.EXECUTED else Outcome.FAILURE
        self._note(key, step, outcome)
        if outcome is Outcome.FAILURE:
            said = f" ({life.refusal.text})" if life.refusal else ""
            self.why = f"{step.place.path}: {life.stage.name}{said}"
        return outcome

    def _note(self, key: str, step: Step, outcome: Outcome) -> None:
        self._known[key] = outcome
        self._done.add(step.place.number)
        self.plan.node, self.plan.done = step.place.path, len(self._done)

    def _settle(self, key: str, outcome: Outcome) -> None:
        self._known[key] = outcome
        self._store.settle(self._plan_id, key, outcome)


MOST_PLANS: Final = 100
"""Plans that are kept at the same time."""

_REMOVABLE: Final = FINAL_STATUSES | {PlanStatus.SUBMITTED}


@dataclass(frozen=True, slots=True)
class _Run:
    execution: PlanExecution
    tree: PlanTree


class Planner:
    """The plans of one executive.

    A plan never goes on by itself: a stop, a hazard or the end of the process suspends it.

    Args:
        settings: the asset's bounds, against which plans are checked.
        store: where plans and their journals are kept.
        active: is told which plan executes, and which wait to go on.
        host: where their trees are attached.
        cancel: ends a command of a plan that has not ended.
    """

    def __init__(
        self,
        clock: Clock,
        settings: Settings,
        store: PlanStore,
        notifications: Notifications,
        active: ActivePlans,
        host: PlanHost,
        cancel: Cancel,
    ) -> None:
        self._clock = clock
        self._settings = settings
        self._store = store
        self._active = active
        self._host = host
        self._cancel = cancel
        self._plans = Register(clock, store, notifications, active)
        self._run: _Run | None = None
        self._total = 0

    def updates(self) -> Sequence[PlanUpdate]:
        """Return how far each plan has come, in the order in which they were submitted."""
        return self._plans.updates()

    def obstacle(self, request: PlanRequest) -> Refusal | None:
        """Return why a request cannot be granted now, or None."""
        if isinstance(request, SubmitPlan):
            return self._check_new(request.plan)
        plan = self._plans.find(request.plan_id)
        if plan is None:
            text = f"there is no plan {request.plan_id[:64]!r}"
            return Refusal(Reason.NO_SUCH_PLAN, text, argument=1, subject=request.plan_id)
        match request:
            case ActivatePlan():
                return self._rover_taken() or _unless(plan, sources(PlanEvent.ACTIVATE))
            case ResumePlan():
                return self._rover_taken() or _unless(plan, sources(PlanEvent.RESUME))
            case SuspendPlan():
                return _unless(plan, sources(PlanEvent.SUSPEND))
            case RemovePlan():
                return _unless(plan, _REMOVABLE)
            case AbortPlan():
                return None
            case _:
                assert_never(request)

    def grant(self, request: PlanRequest, by: Identity) -> str:
        """Do what was asked, after `obstacle` returned None; return what is to be said of it."""
        match request:
            case SubmitPlan(definition):
                return self._add(definition)
            case ActivatePlan(plan_id):
                return self._start(self._plans[plan_id], PlanEvent.ACTIVATE, f"activated by {by}")
            case ResumePlan(plan_id):
                return self._start(self._plans[plan_id], PlanEvent.RESUME, f"resumed by {by}")
            case SuspendPlan(plan_id):
                text = f"suspended by {by}"
                self.suspend(Refusal(Reason.PLAN_SUSPENDED, text))
                return text
            case AbortPlan(plan_id):
                return self._abort(self._plans[plan_id], f"aborted by {by}")
            case RemovePlan(plan_id):
                self._plans.remove(plan_id)
                return f"plan {plan_id} removed"
            case _:
                assert_never(request)

    def suspend(self, why: Refusal) -> None:
        """Take the rover from the plan that has it, if one does, until it is resumed."""
        plan = self._plans.executing
        if plan is not None:
            self._stop_run(why)
            self._plans.change(plan, PlanEvent.SUSPEND, why.text, why.reason)

    def take_over(self) -> None:
        """Suspend what a process before this one left executing."""
        plan = self._plans.executing
        if plan is not None:
            self._store.forget_unfinished_steps(plan.plan_id)
            text = "the executive was restarted"
            self._plans.change(plan, PlanEvent.SUSPEND, text, Reason.INTERRUPTED)

    def fail(self, why: Refusal) -> None:
        """End the plan that executes, as failed."""
        plan = self._plans.executing
        if plan is not None:
            self._stop_run(why)
            self._end(plan, PlanEvent.FAIL, why.text, why.reason)

    def tick(self, submit: Callable[[Command], SubmitResult]) -> bool:
        """Run the tree of the plan that executes once, and submit the commands that it wants.

        Returns:
            Whether there is something to write down before the commands may start.

        Raises:
            executive.record.ledger.LedgerError: the journal cannot be read.
            executive.runner.LeafError: a leaf raised.
        """
        plan = self._plans.executing
        if plan is None:
            return False
        run = self._run or self._begin(plan)
        if run is None:
            return True
        progress = run.tree.tick()
        if progress is Progress.RUNNING:
            return self._command(run, submit)
        self._end_run()
        if progress is Progress.SUCCESS:
            self._end(plan, PlanEvent.COMPLETE, "completed")
        else:
            self._end(plan, PlanEvent.FAIL, run.execution.why, Reason.PLAN_FAILED)
        return True

    def _check_new(self, definition: PlanDefinition) -> Refusal | None:
        if self._plans.find(definition.plan_id) is not None:
            text = f"there is a plan {definition.plan_id} already: remove it, or take another id"
            return Refusal(Reason.PLAN_EXISTS, text, argument=1)
        if len(self._plans) >= MOST_PLANS:
            text = f"{MOST_PLANS} plans are kept: remove one"
            return Refusal(Reason.TOO_MANY_PLANS, text, (Figure("bound", MOST_PLANS),))
        checked = check_plan(definition, self._settings)
        if isinstance(checked, Refusal):
            return checked
        self._total = len(steps(checked))
        return None

    def _rover_taken(self) -> Refusal | None:
        executing = self._active.executing
        if executing is None:
            return None
        text = f"plan {executing} has the rover: suspend or abort it first"
        return Refusal(Reason.PLAN_ACTIVE, text)

    def _add(self, definition: PlanDefinition) -> str:
        """Keep the plan that `_check_new` has just checked."""
        text = f"plan {definition.plan_id} submitted: {self._total} leaves"
        self._plans.add(definition, self._total, text)
        return text

    def _start(self, plan: Plan, event: PlanEvent, text: str) -> str:
        self._plans.change(plan, event, text)
        return text

    def _abort(self, plan: Plan, text: str) -> str:
        if plan.state in FINAL_STATUSES:
            return f"it had ended before: {plan.state.name}"
        if plan.state.running:
            self._stop_run(Refusal(Reason.PLAN_ABORTED, text))
        return self._end(plan, PlanEvent.ABORT, text)

    def _begin(self, plan: Plan) -> _Run | None:
        root = check_plan(self._store.definition(plan.plan_id), self._settings)
        if isinstance(root, Refusal):
            self._end(plan, PlanEvent.FAIL, root.text, root.reason)
            return None
        execution = PlanExecution(plan, root, self._clock, self._store, self._cancel)
        self._run = _Run(execution, self._host.attach(root, execution))
        self._plans.change(plan, PlanEvent.BEGIN, "goes on" if plan.done else "begins")
        return self._run

    def _command(self, run: _Run, submit: Callable[[Command], SubmitResult]) -> bool:
        plan, execution = run.execution.plan, run.execution
        wanted = execution.take_wanted()
        for key, step in wanted:
            number = self._store.next_number(plan.plan_id)
            identity = Identity(source_of(plan.plan_id), number)
            match submit(Command(identity, step.request, PLAN_LINK)):
                case Admitted(life):
                    execution.began(key, step, life)
                case Refused(refusal) if refusal.reason is not Reason.LEDGER_FAILED:
                    execution.refused(key, step, number, refusal)
        if (plan.node, plan.done) != (plan.last.node, plan.last.done):
            self._plans.tell(plan, execution.why)
        return bool(wanted)

    def _end(self, plan: Plan, event: PlanEvent, text: str, reason: Reason | None = None) -> str:
        self._plans.change(plan, event, text, reason)
        self._store.forget(plan.plan_id)
        return text

    def _stop_run(self, why: Refusal) -> None:
        """End what the plan that executes has under way, for a reason."""
        if self._run is not None:
            self._run.execution.cancel_under_way(why)
            self._end_run()

    def _end_run(self) -> None:
        self._run = None
        self._host.detach()


def _unless(plan: Plan, allowed: Iterable[PlanStatus]) -> Refusal | None:
    if plan.state in allowed:
        return None
    names = ", ".join(sorted(status.name for status in allowed))
    text = f"plan {plan.plan_id} is {plan.state.name}: this is for plans that are {names}"
    return Refusal(Reason.PLAN_STATUS, text)
