"""Owns all plans: what may happen to each, what becomes of them, and who has the rover."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final, assert_never

from executive.admission import Admission, Admitted, Refused
from executive.commands import Command, Identity
from executive.context import Context
from executive.notifications import Notifications
from executive.plans.agenda import PLAN_LINK, source_of
from executive.plans.checking import check
from executive.plans.definition import PlanDefinition, PlanStatus, PlanUpdate
from executive.plans.lifecycle import FINAL, PlanEvent, change, sources
from executive.plans.nodes import steps
from executive.plans.requests import (
    AbortPlan,
    ActivatePlan,
    PlanRequest,
    RemovePlan,
    ResumePlan,
    SubmitPlan,
    SuspendPlan,
)
from executive.plans.store import PlanStore
from executive.plans.work import Garden, PlanTree, Progress, Work
from executive.reasons import Figure, Reason, Refusal
from executive.reports import Severity

MOST_PLANS: Final = 100
"""Plans that are kept at the same time."""

_REMOVABLE: Final = FINAL | {PlanStatus.SUBMITTED}
_SEVERITY: Final = {
    PlanStatus.SUSPENDED: Severity.WARNING,
    PlanStatus.FAILED: Severity.ALARM,
}


class Plan:
    """One plan.

    Attributes:
        state: its status.
        last: what was last told of it.
    """

    def __init__(self, last: PlanUpdate) -> None:
        """Take it as it was last told of."""
        self.state = last.status
        self.last = last


@dataclass(frozen=True, slots=True)
class _Run:
    work: Work
    tree: PlanTree


class Planner:
    """The plans of one executive.

    A plan never goes on by itself: a stop, a hazard or the end of the process suspends it.

    Args:
        store: where plans and their journals are kept.
        garden: where their trees grow.
    """

    def __init__(
        self, context: Context, store: PlanStore, notifications: Notifications, garden: Garden
    ) -> None:
        """Know the plans of the ledger."""
        self._context = context
        self._store = store
        self._notifications = notifications
        self._garden = garden
        self._plans = {last.plan_id: Plan(last) for last in store.plans()}
        self._run: _Run | None = None
        self._note()

    def updates(self) -> Sequence[PlanUpdate]:
        """Return how far each plan has come, in the order in which they were submitted."""
        return [plan.last for plan in self._plans.values()]

    def obstacle(self, request: PlanRequest) -> Refusal | None:
        """Return why a request cannot be granted now, or None."""
        if isinstance(request, SubmitPlan):
            return self._unfit(request.plan)
        plan = self._plans.get(request.plan_id)
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
                return self._change(self._plans[plan_id], PlanEvent.ACTIVATE, f"activated by {by}")
            case ResumePlan(plan_id):
                return self._change(self._plans[plan_id], PlanEvent.RESUME, f"resumed by {by}")
            case SuspendPlan(plan_id):
                text = f"suspended by {by}"
                self.suspend(Refusal(Reason.PLAN_SUSPENDED, text))
                return text
            case AbortPlan(plan_id):
                return self._abort(self._plans[plan_id], f"aborted by {by}")
            case RemovePlan(plan_id):
                self._store.remove(plan_id)
                del self._plans[plan_id]
                return f"plan {plan_id} removed"
            case _:
                assert_never(request)

    def suspend(self, why: Refusal) -> None:
        """Take the rover from the plan that has it, if one does, until it is resumed."""
        plan = self._executing()
        if plan is not None:
            self._leave(why)
            self._change(plan, PlanEvent.SUSPEND, why.text, why.reason)

    def take_over(self) -> None:
        """Suspend what a process before this one left executing."""
        plan = self._executing()
        if plan is not None:
            self._store.forget_under_way(plan.last.plan_id)
            text = "the executive was restarted"
            self._change(plan, PlanEvent.SUSPEND, text, Reason.INTERRUPTED)

    def fail(self, why: Refusal) -> None:
        """End the plan that executes, as failed."""
        plan = self._executing()
        if plan is not None:
            self._leave(why)
            self._end(plan, PlanEvent.FAIL, why.text, why.reason)

    def tick(self, submit: Callable[[Command], Admission]) -> bool:
        """Run the tree of the plan that executes once, and submit the commands that it wants.

        Returns:
            Whether there is something to write down before the commands may start.

        Raises:
            executive.ledger.LedgerError: the journal cannot be read.
            executive.runner.LeafError: a leaf raised.
        """
        plan = self._executing()
        if plan is None:
            return False
        run = self._run or self._begin(plan)
        if run is None:
            return True
        match run.tree.tick():
            case Progress.RUNNING:
                return self._command(plan, run.work, submit)
            case Progress.SUCCESS:
                self._end(plan, PlanEvent.COMPLETE, "completed")
            case Progress.FAILURE:
                self._end(plan, PlanEvent.FAIL, run.work.why, Reason.PLAN_FAILED)
        return True

    def _unfit(self, definition: PlanDefinition) -> Refusal | None:
        if definition.plan_id in self._plans:
            text = f"there is a plan {definition.plan_id} already: remove it, or take another id"
            return Refusal(Reason.PLAN_EXISTS, text, argument=1)
        if len(self._plans) >= MOST_PLANS:
            text = f"{MOST_PLANS} plans are kept: remove one"
            return Refusal(Reason.TOO_MANY_PLANS, text, (Figure("bound", MOST_PLANS),))
        checked = check(definition, self._context.settings)
        return checked if isinstance(checked, Refusal) else None

    def _taken(self) -> Refusal | None:
        executing = self._context.agenda.executing
        if executing is None:
            return None
        text = f"plan {executing} has the rover: suspend or abort it first"
        return Refusal(Reason.PLAN_ACTIVE, text)

    def _add(self, definition: PlanDefinition) -> str:
        checked = check(definition, self._context.settings)
        total = 0 if isinstance(checked, Refusal) else len(steps(checked))
        text = f"plan {definition.plan_id} submitted: {total} leaves"
        utc_s = self._context.clock.utc_s()
        update = PlanUpdate(definition.plan_id, PlanStatus.SUBMITTED, utc_s, "", 0, total, text)
        self._plans[definition.plan_id] = Plan(update)
        self._store.add(definition, update)
        self._notifications.plan(update)
        return text

    def _abort(self, plan: Plan, text: str) -> str:
        if plan.state in FINAL:
            return f"it had ended before: {plan.state.name}"
        if plan.state.running:
            self._leave(Refusal(Reason.PLAN_ABORTED, text))
        return self._end(plan, PlanEvent.ABORT, text)

    def _begin(self, plan: Plan) -> _Run | None:
        plan_id = plan.last.plan_id
        grown = check(self._store.definition(plan_id), self._context.settings)
        if isinstance(grown, Refusal):
            self._end(plan, PlanEvent.FAIL, grown.text, grown.reason)
            return None
        work = Work(plan.last, grown, self._context.clock, self._store, self._context.cancel)
        self._run = _Run(work, self._garden.grow(grown, work))
        self._change(plan, PlanEvent.BEGIN, "goes on" if work.done else "begins")
        return self._run

    def _command(self, plan: Plan, work: Work, submit: Callable[[Command], Admission]) -> bool:
        wanted = work.take_wanted()
        for key, step in wanted:
            source = source_of(plan.last.plan_id)
            number = self._store.next_number(plan.last.plan_id)
            match submit(Command(Identity(source, number), step.request, PLAN_LINK)):
                case Admitted(life):
                    work.began(key, step, life)
                case Refused(refusal) if refusal.reason is not Reason.LEDGER_FAILED:
                    work.refused(key, step, number, refusal)
        if (plan.last.node, plan.last.done) != (work.node, work.done):
            self._tell(plan, work.why)
        return bool(wanted)

    def _end(self, plan: Plan, event: PlanEvent, text: str, reason: Reason | None = None) -> str:
        self._change(plan, event, text, reason)
        self._store.forget(plan.last.plan_id)
        return text

    def _leave(self, why: Refusal) -> None:
        if self._run is not None:
            self._run.work.leave(why)

    def _change(self, plan: Plan, event: PlanEvent, text: str, reason: Reason | None = None) -> str:
        had_rover = plan.state.running
        change(plan, event)
        self._tell(plan, text)
        if plan.state is not PlanStatus.ACTIVATED:
            severity = _SEVERITY.get(plan.state, Severity.INFORMATIONAL)
            said = f"plan {plan.last.plan_id} {plan.state.name}: {text}"
            self._notifications.event(severity, said, reason)
        if had_rover and not plan.state.running:
            self._run = None
            self._garden.prune()
        self._note()
        return text

    def _tell(self, plan: Plan, text: str) -> None:
        """Write down and send how far a plan has come."""
        last, utc_s = plan.last, self._context.clock.utc_s()
        plan.last = replace(last, status=plan.state, utc_s=utc_s, text=text)
        if self._run is not None and last.status.running:
            work = self._run.work
            plan.last = replace(plan.last, node=work.node, done=work.done)
        self._store.update(plan.last)
        self._notifications.plan(plan.last)

    def _note(self) -> None:
        """Let the agenda say what the plans do."""
        agenda = self._context.agenda
        states = [(plan_id, plan.state) for plan_id, plan in self._plans.items()]
        agenda.executing = next((plan_id for plan_id, state in states if state.running), None)
        agenda.suspended = tuple(i for i, state in states if state is PlanStatus.SUSPENDED)

    def _executing(self) -> Plan | None:
        executing = self._context.agenda.executing
        return None if executing is None else self._plans[executing]


def _unless(plan: Plan, allowed: Iterable[PlanStatus]) -> Refusal | None:
    if plan.state in allowed:
        return None
    names = ", ".join(sorted(status.name for status in allowed))
    text = f"plan {plan.last.plan_id} is {plan.state.name}: this is for plans that are {names}"
    return Refusal(Reason.PLAN_STATUS, text)
