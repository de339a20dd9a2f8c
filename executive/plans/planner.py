"""`Planner` executes requests on plans (submit, activate, suspend, ...), and runs active plans."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Final, assert_never

from executive.commands import (
    PLAN_LINK,
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
from executive.commands.intake import source_of
from executive.commands.lifecycle import (
    Accepted,
    Edge,
    Rejected,
    SubmitResult,
    make_machine,
    terminal_states,
)
from executive.plans.builder import check_plan
from executive.plans.execution import (
    Cancel,
    PlanExecution,
    PlanHost,
    PlanTree,
    RunningPlan,
    StepStatus,
    ended_leaves,
    step_key,
)
from executive.plans.model import PlanNode, nodes, skipped_nodes, steps
from executive.record import Notifications, PlanStore, StepOutcome
from executive.settings import Settings
from executive.state import MotionStatistics
from executive.values.clock import Clock
from executive.values.reasons import Figure, Reason, Refusal
from executive.values.reports import Identity, PlanStatus, PlanUpdate, Severity


class ActivePlans:
    """The executing and suspended plans; written by the planner alone.

    Attributes:
        executing: the plan that controls the rover, if any.
        suspended: the plans that wait to be resumed.
        started_by: source that last activated or resumed each plan, in this process.
    """

    def __init__(self) -> None:
        self.executing: str | None = None
        self.suspended: tuple[str, ...] = ()
        self.started_by: dict[str, str] = {}


class PlanEvent(Enum):
    """Events of a plan's life cycle."""

    ACTIVATE = "activate"
    BEGIN = "begin"
    SUSPEND = "suspend"
    RESUME = "resume"
    COMPLETE = "complete"
    FAIL = "fail"
    ABORT = "abort"


PLAN_EDGES: Final = (
    Edge(PlanEvent.ACTIVATE, PlanStatus.SUBMITTED, PlanStatus.ACTIVATED),
    Edge(PlanEvent.ABORT, PlanStatus.SUBMITTED, PlanStatus.ABORTED),
    Edge(PlanEvent.BEGIN, PlanStatus.ACTIVATED, PlanStatus.EXECUTING),
    Edge(PlanEvent.SUSPEND, PlanStatus.ACTIVATED, PlanStatus.SUSPENDED),
    Edge(PlanEvent.FAIL, PlanStatus.ACTIVATED, PlanStatus.FAILED),
    Edge(PlanEvent.ABORT, PlanStatus.ACTIVATED, PlanStatus.ABORTED),
    Edge(PlanEvent.COMPLETE, PlanStatus.EXECUTING, PlanStatus.COMPLETED),
    Edge(PlanEvent.FAIL, PlanStatus.EXECUTING, PlanStatus.FAILED),
    Edge(PlanEvent.SUSPEND, PlanStatus.EXECUTING, PlanStatus.SUSPENDED),
    Edge(PlanEvent.ABORT, PlanStatus.EXECUTING, PlanStatus.ABORTED),
    Edge(PlanEvent.RESUME, PlanStatus.SUSPENDED, PlanStatus.ACTIVATED),
    Edge(PlanEvent.ABORT, PlanStatus.SUSPENDED, PlanStatus.ABORTED),
)

FINAL_STATUSES: Final = frozenset(terminal_states(PLAN_EDGES))
"""Terminal statuses of a plan."""


_MACHINE: Final = make_machine(PLAN_EDGES, "state")


def source_states(event: PlanEvent) -> tuple[PlanStatus, ...]:
    """Return the statuses that permit an event."""
    return tuple(edge.source for edge in PLAN_EDGES if edge.event is event)


_SEVERITY: Final = {PlanStatus.SUSPENDED: Severity.WARNING, PlanStatus.FAILED: Severity.ALARM}


MAX_PLANS: Final = 100
"""Maximum number of stored plans; chosen, not measured."""

MAX_NAMED: Final = 10
"""Maximum number of skipped nodes that the report of a resume names."""

UNWRITTEN_STEPS: Final = Refusal(
    Reason.PLAN_STATUS, "the last steps of the plan are not stored yet: try again"
)

_REMOVABLE: Final = FINAL_STATUSES | {PlanStatus.SUBMITTED}


@dataclass(frozen=True, slots=True)
class _ActiveRun:
    """The executing plan.

    Attributes:
        statistics: its motion statistics; None after a suspension.
    """

    execution: PlanExecution
    tree: PlanTree
    statistics: MotionStatistics | None

    @property
    def result_figures(self) -> tuple[Figure, ...]:
        """Its measured and predicted figures."""
        return () if self.statistics is None else self.statistics.figures()


PredictPlan = Callable[[str, PlanNode, Callable[[], bool]], MotionStatistics]
"""Predicts a plan by its id, while the callback returns True; returns its statistics."""


class Planner:
    """The plans of one executive.

    A plan never continues by itself: a stop, a hazard or the end of the process suspends it.

    Args:
        active: set to the executing plan and the suspended ones.
        cancel: cancels a command of a plan that has not ended.
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
        predict: PredictPlan,
    ) -> None:
        self._clock = clock
        self._predict_plan = predict
        self._settings = settings
        self._store = store
        self._active = active
        self._host = host
        self._cancel = cancel
        self._notifications = notifications
        self._plans = {last.plan_id: RunningPlan(last) for last in store.plans()}
        self._run: _ActiveRun | None = None
        self._total = 0
        self._skipped: tuple[PlanNode, ...] = ()
        self._ended: set[int] = set()
        self._note()

    def updates(self) -> Sequence[PlanUpdate]:
        """Return the progress of each plan, in the order of submission."""
        return [plan.last for plan in self._plans.values()]

    def definition(self, plan_id: str) -> PlanDefinition | None:
        """Return a plan as submitted; None if there is no such plan."""
        return self._store.definition(plan_id) if plan_id in self._plans else None

    def root(self, plan_id: str) -> PlanNode | None:
        """Return the root node of a plan; None if it no longer fits the settings."""
        root = check_plan(self._store.definition(plan_id), self._settings)
        return None if isinstance(root, Refusal) else root

    def check_request(self, request: PlanRequest) -> Refusal | None:
        """Return a refusal if a request cannot be executed now, or None."""
        if isinstance(request, SubmitPlan):
            return self._check_new(request.plan)
        plan = self._plans.get(request.plan_id)
        if plan is None:
            text = f"there is no plan {request.plan_id[:64]!r}"
            return Refusal(Reason.NO_SUCH_PLAN, text, argument=1, subject=request.plan_id)
        match request:
            case ActivatePlan():
                return self._rover_busy() or _unless(plan, source_states(PlanEvent.ACTIVATE))
            case ResumePlan(step=step):
                busy = self._rover_busy() or _unless(plan, source_states(PlanEvent.RESUME))
                return busy or self._check_step(plan, step)
            case SuspendPlan():
                return _unless(plan, source_states(PlanEvent.SUSPEND))
            case RemovePlan():
                return _unless(plan, _REMOVABLE)
            case AbortPlan():
                return None
            case _:
                assert_never(request)

    def apply(self, request: PlanRequest, by: Identity) -> str:
        """Execute a request after `check_request` returned None; return the text of its report."""
        if isinstance(request, ActivatePlan | ResumePlan):
            self._active.started_by[request.plan_id] = by.source
        match request:
            case SubmitPlan(definition):
                text = f"plan {definition.plan_id} submitted: {self._total} leaves"
                self._add(definition, text)
                return text
            case ActivatePlan(plan_id):
                return self._start(self._plans[plan_id], PlanEvent.ACTIVATE, f"activated by {by}")
            case ResumePlan(plan_id, step):
                at = "" if step is None else f" at {step}"
                return self._resume(self._plans[plan_id], f"resumed by {by}{at}")
            case SuspendPlan(plan_id):
                text = f"suspended by {by}"
                self.suspend(Refusal(Reason.PLAN_SUSPENDED, text))
                return text
            case AbortPlan(plan_id):
                return self._abort(self._plans[plan_id], f"aborted by {by}")
            case RemovePlan(plan_id):
                self._store.remove(plan_id)
                del self._plans[plan_id]
                self._active.started_by.pop(plan_id, None)
                return f"plan {plan_id} removed"
            case _:
                assert_never(request)

    def suspend(self, why: Refusal) -> None:
        """Suspend the executing plan, if any, until it is resumed."""
        plan = self._executing
        if plan is not None:
            self._stop_run(why)
            self._change(plan, PlanEvent.SUSPEND, why.text, why.reason)

    def recover(self) -> None:
        """Suspend the plan that a previous process left executing."""
        plan = self._executing
        if plan is not None:
            self._store.forget_unfinished_steps(plan.plan_id)
            text = "the executive was restarted"
            self._change(plan, PlanEvent.SUSPEND, text, Reason.INTERRUPTED)

    def fail(self, why: Refusal) -> None:
        """Fail the executing plan."""
        plan = self._executing
        if plan is not None:
            became = () if self._run is None else self._run.result_figures
            self._stop_run(why)
            self._end(plan, PlanEvent.FAIL, why.text, why.reason, became)

    def tick(self, plan_id: str, submit: Callable[[Command], SubmitResult]) -> bool:
        """Tick the tree of the executing plan once, and submit the commands that it requests.

        Returns:
            Whether a commit is needed before the commands may start.

        Raises:
            executive.record.ledger.LedgerError: the journal cannot be read.
            LeafError: a leaf raised.
        """
        plan = self._plans[plan_id]
        if self._run is None and not self._store.is_durable(plan.batch):
            return False
        run = self._run or self._begin(plan)
        if run is None:
            return True
        progress = run.tree.tick()
        if progress is StepStatus.RUNNING:
            return self._command(run, submit)
        self._end_run()
        if progress is StepStatus.SUCCESS:
            self._end(plan, PlanEvent.COMPLETE, "completed", figures=run.result_figures)
        else:
            self._end(
                plan, PlanEvent.FAIL, run.execution.why, Reason.PLAN_FAILED, run.result_figures
            )
        return True

    @property
    def _executing(self) -> RunningPlan | None:
        executing = self._active.executing
        return None if executing is None else self._plans[executing]

    def _check_new(self, definition: PlanDefinition) -> Refusal | None:
        if definition.plan_id in self._plans:
            text = f"plan {definition.plan_id} exists: remove it, or use another id"
            return Refusal(Reason.PLAN_EXISTS, text, argument=1)
        if len(self._plans) >= MAX_PLANS:
            text = f"{MAX_PLANS} plans are stored: remove one"
            return Refusal(Reason.TOO_MANY_PLANS, text, (Figure("bound", MAX_PLANS),))
        checked = check_plan(definition, self._settings)
        if isinstance(checked, Refusal):
            return checked
        self._total = len(steps(checked))
        return None

    def _rover_busy(self) -> Refusal | None:
        executing = self._active.executing
        if executing is None:
            return None
        text = f"plan {executing} controls the rover: suspend or abort it first"
        return Refusal(Reason.PLAN_ACTIVE, text)

    def _add(self, definition: PlanDefinition, text: str) -> None:
        """Store the plan that `_check_new` has just checked."""
        utc_s, status = self._clock.utc_s(), PlanStatus.SUBMITTED
        update = PlanUpdate(definition.plan_id, status, utc_s, "", 0, self._total, text)
        self._plans[definition.plan_id] = RunningPlan(update)
        self._store.add(definition, update)
        self._notifications.report_plan_update(update)

    def _start(self, plan: RunningPlan, event: PlanEvent, text: str) -> str:
        self._change(plan, event, text)
        return text

    def _check_step(self, plan: RunningPlan, step: str | None) -> Refusal | None:
        """Return a refusal if a plan cannot be resumed at a step; store which nodes it skips."""
        self._skipped = ()
        root = None if step is None else self.root(plan.plan_id)
        if step is None or root is None:  # a plan that no longer fits fails when it continues
            return None
        if not self._store.is_durable(plan.batch):
            return UNWRITTEN_STEPS
        journal = self._store.journal(plan.plan_id)
        found = skipped_nodes(root, step, plan.node, journal)
        if isinstance(found, Refusal):
            return found
        self._skipped, self._ended = found, ended_leaves(root, journal)
        return None

    def _resume(self, plan: RunningPlan, text: str) -> str:
        """Resume a plan without the nodes that `_check_step` has just found."""
        names = ", ".join(node.location.name for node in self._skipped[:MAX_NAMED])
        more = len(self._skipped) - MAX_NAMED
        text += f", skipping {names}{f' and {more} more' if more > 0 else ''}" if names else ""
        self._change(plan, PlanEvent.RESUME, text)
        for node in self._skipped:
            for each in nodes(node):
                key = step_key(each.location, ())
                self._store.set_outcome(plan.plan_id, key, StepOutcome.SKIPPED)
            self._ended |= {step.location.number for step in steps(node)}
            plan.node, plan.done = node.location.path, len(self._ended)
            self._notify(plan, f"{node.location.path}: skipped")
        return text

    def _abort(self, plan: RunningPlan, text: str) -> str:
        if plan.state in FINAL_STATUSES:
            return f"it has already ended: {plan.state.name}"
        if plan.state.running:
            self._stop_run(Refusal(Reason.PLAN_ABORTED, text))
        return self._end(plan, PlanEvent.ABORT, text)

    def _begin(self, plan: RunningPlan) -> _ActiveRun | None:
        root = check_plan(self._store.definition(plan.plan_id), self._settings)
        if isinstance(root, Refusal):
            self._end(plan, PlanEvent.FAIL, root.text, root.reason)
            return None
        execution = PlanExecution(plan, root, self._clock, self._store, self._cancel)
        tree, is_new = self._host.attach(root, execution), not plan.done
        self._change(plan, PlanEvent.BEGIN, "starts" if is_new else "continues")
        statistics = None
        if is_new:
            statistics = self._predict_plan(plan.plan_id, root, lambda: self._executes(execution))
        self._run = _ActiveRun(execution, tree, statistics)
        return self._run

    def _executes(self, execution: PlanExecution) -> bool:
        return self._run is not None and self._run.execution is execution

    def _command(self, run: _ActiveRun, submit: Callable[[Command], SubmitResult]) -> bool:
        plan, execution = run.execution.plan, run.execution
        wanted = execution.take_requested()
        for key, step in wanted:
            number = self._store.next_number(plan.plan_id)
            identity = Identity(source_of(plan.plan_id), number)
            match submit(Command(identity, step.request, PLAN_LINK)):
                case Accepted(lifecycle):
                    execution.on_started(key, step, lifecycle)
                case Rejected(refusal) if refusal.reason is not Reason.LEDGER_FAILED:
                    execution.on_rejected(key, step, identity, refusal)
        if (plan.node, plan.done) != (plan.last.node, plan.last.done):
            self._notify(plan, execution.why)
        return bool(wanted)

    def _change(
        self,
        plan: RunningPlan,
        event: PlanEvent,
        text: str,
        reason: Reason | None = None,
        figures: tuple[Figure, ...] = (),
    ) -> None:
        """Apply an event to a plan.

        Raises:
            transitions.MachineError: the plan's status does not permit it.
        """
        _MACHINE.events[event.value].trigger(plan)
        self._notify(plan, text)
        if plan.state is not PlanStatus.ACTIVATED:
            severity = _SEVERITY.get(plan.state, Severity.INFORMATIONAL)
            detail = f"plan {plan.plan_id} {plan.state.name}: {text}"
            self._notifications.report_event(severity, detail, reason, figures)
        self._note()

    def _notify(self, plan: RunningPlan, text: str) -> None:
        """Store and publish the progress of a plan."""
        utc_s, total = self._clock.utc_s(), plan.last.total
        plan.last = PlanUpdate(plan.plan_id, plan.state, utc_s, plan.node, plan.done, total, text)
        self._store.update(plan.last)
        plan.batch = self._store.last_batch
        self._notifications.report_plan_update(plan.last)

    def _note(self) -> None:
        states = [(plan_id, plan.state) for plan_id, plan in self._plans.items()]
        self._active.executing = next((i for i, state in states if state.running), None)
        self._active.suspended = tuple(i for i, state in states if state is PlanStatus.SUSPENDED)

    def _end(
        self,
        plan: RunningPlan,
        event: PlanEvent,
        text: str,
        reason: Reason | None = None,
        figures: tuple[Figure, ...] = (),
    ) -> str:
        self._change(plan, event, text, reason, figures)
        self._store.forget(plan.plan_id)
        return text

    def _stop_run(self, why: Refusal) -> None:
        """End the active commands of the executing plan, for a reason."""
        if self._run is not None:
            self._run.execution.cancel_running(why)
            self._end_run()

    def _end_run(self) -> None:
        self._run = None
        self._host.detach()


def _unless(plan: RunningPlan, allowed: Iterable[PlanStatus]) -> Refusal | None:
    if plan.state in allowed:
        return None
    names = ", ".join(sorted(status.name for status in allowed))
    text = f"plan {plan.plan_id} is {plan.state.name}: needs {names}"
    return Refusal(Reason.PLAN_STATUS, text)
