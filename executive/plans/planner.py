"""What may be asked of plans, and the one that executes: its tree, its commands."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Final, assert_never

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
from executive.commands.lifecycle import Admitted, Refused, SubmitResult
from executive.notifications import Notifications
from executive.plans.execution import (
    Cancel,
    PlanExecution,
    PlanHost,
    PlanTree,
    Progress,
)
from executive.plans.model import PlanNode, steps
from executive.plans.register import FINAL_STATUSES, ActivePlans, Plan, PlanEvent, Register, sources
from executive.reasons import Figure, Reason, Refusal
from executive.record import PlanStore
from executive.reports import Identity, PlanStatus, PlanUpdate
from executive.settings import Settings

MOST_PLANS: Final = 100
"""Plans that are kept at the same time."""

_REMOVABLE: Final = FINAL_STATUSES | {PlanStatus.SUBMITTED}


@dataclass(frozen=True, slots=True)
class _Run:
    plan: Plan
    work: PlanExecution
    tree: PlanTree


class Planner:
    """The plans of one executive.

    A plan never goes on by itself: a stop, a hazard or the end of the process suspends it.

    Args:
        settings: the asset's bounds, against which plans are checked.
        store: where plans and their journals are kept.
        agenda: is told which plan executes, and which wait to go on.
        garden: where their trees grow.
        cancel: ends a command of a plan that has not ended.
    """

    def __init__(
        self,
        clock: Clock,
        settings: Settings,
        store: PlanStore,
        notifications: Notifications,
        agenda: ActivePlans,
        garden: PlanHost,
        cancel: Cancel,
    ) -> None:
        self._clock = clock
        self._settings = settings
        self._store = store
        self._agenda = agenda
        self._garden = garden
        self._cancel = cancel
        self._plans = Register(clock, store, notifications, agenda)
        self._run: _Run | None = None
        self._total = 0

    def updates(self) -> Sequence[PlanUpdate]:
        """Return how far each plan has come, in the order in which they were submitted."""
        return self._plans.updates()

    def obstacle(self, request: PlanRequest) -> Refusal | None:
        """Return why a request cannot be granted now, or None."""
        if isinstance(request, SubmitPlan):
            return self._unfit(request.plan)
        plan = self._plans.find(request.plan_id)
        if plan is None:
            text = f"there is no plan {request.plan_id[:64]!r}"
            return Refusal(Reason.NO_SUCH_PLAN, text, argument=1, subject=request.plan_id)
        match request:
            case ActivatePlan():
                return self._taken() or _unless(plan, sources(PlanEvent.ACTIVATE))
            case ResumePlan():
                return self._taken() or _unless(plan, sources(PlanEvent.RESUME))
            case SuspendPlan():
                return _unless(plan, sources(PlanEvent.SUSPEND))
            case RemovePlan():
                return _unless(plan, _REMOVABLE)
            case AbortPlan():
                return None
            case _:
                assert_never(request)

    def grant(self, request: PlanRequest, by: Identity) -> str:
        """Do what `obstacle` has nothing against; return what is to be said of it."""
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
            self._leave(why)
            self._plans.change(plan, PlanEvent.SUSPEND, why.text, why.reason)

    def take_over(self) -> None:
        """Suspend what a process before this one left executing."""
        plan = self._plans.executing
        if plan is not None:
            self._store.forget_under_way(plan.plan_id)
            text = "the executive was restarted"
            self._plans.change(plan, PlanEvent.SUSPEND, text, Reason.INTERRUPTED)

    def fail(self, why: Refusal) -> None:
        """End the plan that executes, as failed."""
        plan = self._plans.executing
        if plan is not None:
            self._leave(why)
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
        self._let_go()
        if progress is Progress.SUCCESS:
            self._end(plan, PlanEvent.COMPLETE, "completed")
        else:
            self._end(plan, PlanEvent.FAIL, run.work.why, Reason.PLAN_FAILED)
        return True

    def _unfit(self, definition: PlanDefinition) -> Refusal | None:
        if self._plans.find(definition.plan_id) is not None:
            text = f"there is a plan {definition.plan_id} already: remove it, or take another id"
            return Refusal(Reason.PLAN_EXISTS, text, argument=1)
        if len(self._plans) >= MOST_PLANS:
            text = f"{MOST_PLANS} plans are kept: remove one"
            return Refusal(Reason.TOO_MANY_PLANS, text, (Figure("bound", MOST_PLANS),))
        checked = self._checked(definition)
        if isinstance(checked, Refusal):
            return checked
        self._total = len(steps(checked))
        return None

    def _checked(self, definition: PlanDefinition) -> PlanNode | Refusal:
        from executive.plans.builder import check_plan  # late: most rovers never hear of a plan

        return check_plan(definition, self._settings)

    def _taken(self) -> Refusal | None:
        executing = self._agenda.executing
        if executing is None:
            return None
        text = f"plan {executing} has the rover: suspend or abort it first"
        return Refusal(Reason.PLAN_ACTIVE, text)

    def _add(self, definition: PlanDefinition) -> str:
        """Keep the plan that `_unfit` had nothing against just now."""
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
            self._leave(Refusal(Reason.PLAN_ABORTED, text))
        return self._end(plan, PlanEvent.ABORT, text)

    def _begin(self, plan: Plan) -> _Run | None:
        plan_id = plan.plan_id
        grown = self._checked(self._store.definition(plan_id))
        if isinstance(grown, Refusal):
            self._end(plan, PlanEvent.FAIL, grown.text, grown.reason)
            return None
        work = PlanExecution(plan.last, grown, self._clock, self._store, self._cancel)
        self._run = _Run(plan, work, self._garden.grow(grown, work))
        plan.node, plan.done = work.node, work.done
        self._plans.change(plan, PlanEvent.BEGIN, "goes on" if work.done else "begins")
        return self._run

    def _command(self, run: _Run, submit: Callable[[Command], SubmitResult]) -> bool:
        plan, work = run.plan, run.work
        wanted = work.take_wanted()
        for key, step in wanted:
            number = self._store.next_number(plan.plan_id)
            identity = Identity(source_of(plan.plan_id), number)
            match submit(Command(identity, step.request, PLAN_LINK)):
                case Admitted(life):
                    work.began(key, step, life)
                case Refused(refusal) if refusal.reason is not Reason.LEDGER_FAILED:
                    work.refused(key, step, number, refusal)
        if (plan.node, plan.done) != (work.node, work.done):
            plan.node, plan.done = work.node, work.done
            self._plans.tell(plan, work.why)
        return bool(wanted)

    def _end(self, plan: Plan, event: PlanEvent, text: str, reason: Reason | None = None) -> str:
        self._plans.change(plan, event, text, reason)
        self._store.forget(plan.plan_id)
        return text

    def _leave(self, why: Refusal) -> None:
        """End what the plan that executes has under way, for a reason."""
        if self._run is not None:
            self._run.work.leave(why)
            self._let_go()

    def _let_go(self) -> None:
        if self._run is not None:
            work = self._run.work
            self._run.plan.node, self._run.plan.done = work.node, work.done
            self._run = None
            self._garden.prune()


def _unless(plan: Plan, allowed: Iterable[PlanStatus]) -> Refusal | None:
    if plan.state in allowed:
        return None
    names = ", ".join(sorted(status.name for status in allowed))
    text = f"plan {plan.plan_id} is {plan.state.name}: this is for plans that are {names}"
    return Refusal(Reason.PLAN_STATUS, text)
