"""`Planner` executes requests on plans (submit, activate, suspend, ...), and runs active plans."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Final, assert_never

from executive.commands import (
    PLAN_LINK,
    AbortPlan,
    ActivatePlan,
    AnswerQuestion,
    Command,
    HoldAtNode,
    PlanDefinition,
    PlanRequest,
    PlanSteering,
    RemovePlan,
    ResumePlan,
    RetryNode,
    SkipNode,
    SubmitPlan,
    SuspendPlan,
)
from executive.commands.intake import source_of
from executive.commands.lifecycle import Accepted, Rejected, SubmitResult
from executive.plans.active_run import ActiveRun
from executive.plans.builder import check_plan
from executive.plans.execution import (
    Cancel,
    LeafError,
    PlanExecution,
    PlanHost,
    PlanResult,
    RunningPlan,
    Steering,
    Surroundings,
    ended_steps,
)
from executive.plans.model import PlanNode, PlanRoot, digest_of, nodes, skipped_nodes, steps
from executive.plans.node_table import node_reports
from executive.plans.plan_lifecycle import (
    FINAL_STATUSES,
    MACHINE,
    ActivePlans,
    PlanEvent,
    check_status,
    source_states,
)
from executive.plans.recovery import (
    MAX_RESTART_DISTANCE_M,
    MAX_RESTARTS,
    continued_state,
    ended_state,
    has_questions,
    recover_state,
)
from executive.plans.state import PlanState, StateError, decode, encode, shifted
from executive.plans.steering import MAX_NAMED, check_steering, steered
from executive.record import Notifications, PlanStore, StoredState
from executive.settings import Settings
from executive.state import MotionStatistics
from executive.values.clock import Clock
from executive.values.plan_nodes import PlanNodeReport
from executive.values.reasons import Figure, Reason, Refusal
from executive.values.reports import Identity, PlanStatus, PlanUpdate, Severity

_SEVERITY: Final = {PlanStatus.SUSPENDED: Severity.WARNING, PlanStatus.FAILED: Severity.ALARM}


MAX_PLANS: Final = 100
"""Maximum number of stored plans; chosen, not measured."""

RESTART_S: Final = 60.0
"""Time after a start within which a plan continues by itself; chosen."""

_REMOVABLE: Final = FINAL_STATUSES | {PlanStatus.SUBMITTED}


PredictPlan = Callable[[str, PlanNode, Callable[[], bool]], MotionStatistics]
"""Predicts a plan by its id, while the callback returns True; returns its statistics."""


class Planner:
    """The plans of one executive.

    A stop, a hazard or the end of the process suspends a plan. It continues by itself only if its
    text wants that, and the process alone was the cause.

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
        surroundings: Surroundings,
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
        self._run: ActiveRun | None = None
        self._read: tuple[PlanDefinition, PlanRoot | Refusal] | None = None
        """The plan that was read last to show or to steer it: consoles request it each second."""
        self._total = 0
        self._surroundings = surroundings
        self._skipped: tuple[PlanNode, ...] = ()
        self._restarted: str | None = None
        self._restarted_s = clock.now_s()
        self._note()

    def updates(self) -> Sequence[PlanUpdate]:
        """Return the progress of each plan, in the order of submission."""
        return [plan.last for plan in self._plans.values()]

    def definition(self, plan_id: str) -> PlanDefinition | None:
        """Return a plan as submitted; None if there is no such plan."""
        return self._store.definition(plan_id) if plan_id in self._plans else None

    def root(self, plan_id: str) -> PlanRoot | None:
        """Return the root node of a plan; None if it no longer fits the settings."""
        root = check_plan(self._store.definition(plan_id), self._settings)
        return None if isinstance(root, Refusal) else root

    def nodes(self, plan_id: str) -> Sequence[PlanNodeReport] | Refusal:
        """Return the nodes of a plan with their progress, or why they are not known."""
        plan = self._plans.get(plan_id)
        found = _no_plan(plan_id) if plan is None else self._with_state(plan)
        if isinstance(found, Refusal):
            return found
        return node_reports(plan_id, *found, executes=plan is self._executing)

    def check_request(self, request: PlanRequest) -> Refusal | None:
        """Return a refusal if a request cannot be executed now, or None."""
        if isinstance(request, SubmitPlan):
            return self._check_new(request.plan)
        plan = self._plans.get(request.plan_id)
        if plan is None:
            return _no_plan(request.plan_id)
        match request:
            case ActivatePlan():
                return self._rover_busy() or check_status(plan, source_states(PlanEvent.ACTIVATE))
            case ResumePlan(step=step):
                busy = self._rover_busy() or check_status(plan, source_states(PlanEvent.RESUME))
                return busy or self._check_step(plan, step)
            case SuspendPlan(plan_id):
                waits = plan_id == self._restarted
                return None if waits else check_status(plan, source_states(PlanEvent.SUSPEND))
            case RemovePlan():
                return check_status(plan, _REMOVABLE)
            case AbortPlan():
                return None
            case SkipNode() | RetryNode() | HoldAtNode() | AnswerQuestion():
                found = self._steerable(plan, request)
                return found if isinstance(found, Refusal) else None
            case _:
                assert_never(request)

    def apply(self, request: PlanRequest, by: Identity) -> str:
        """Execute a request after `check_request` returned None; return the text of its report."""
        if isinstance(request, ActivatePlan | ResumePlan | SuspendPlan | AbortPlan):
            self._await_operators()
        if isinstance(request, ActivatePlan | ResumePlan):
            self._active.started_by[request.plan_id] = by.source
        match request:
            case SubmitPlan(definition):
                text = f"plan {definition.plan_id} submitted: {self._total} leaves"
                self._add(definition, text)
                return text
            case ActivatePlan(plan_id):
                return self._change(self._plans[plan_id], PlanEvent.ACTIVATE, f"activated by {by}")
            case ResumePlan(plan_id, step):
                at = "" if step is None else f" at {step}"
                return self._resume(self._plans[plan_id], f"resumed by {by}{at}")
            case SuspendPlan(plan_id):
                text = f"suspended by {by}"
                self.suspend(Refusal(Reason.PLAN_SUSPENDED, text))
                return text
            case AbortPlan(plan_id):
                return self._abort(self._plans[plan_id], f"aborted by {by}")
            case SkipNode() | RetryNode() | HoldAtNode() | AnswerQuestion():
                return self._steer(self._plans[request.plan_id], request, by)
            case RemovePlan(plan_id):
                self._store.remove(plan_id)
                del self._plans[plan_id]
                self._active.started_by.pop(plan_id, None)
                return f"plan {plan_id} removed"
            case _:
                assert_never(request)

    def suspend(self, why: Refusal) -> None:
        """Suspend the executing plan, if any, until it is resumed."""
        self._await_operators()
        plan = self._executing
        if plan is not None:
            if self._run is not None:
                self._run.execution.cancel_running(why)
                self._save(self._run, suspended=True)
                self._end_run()
            else:
                self._store.stop_timers(plan.plan_id)
            self._change(plan, PlanEvent.SUSPEND, why.text, why.reason)

    def shut_down(self, why: Refusal) -> None:
        """Suspend the executing plan; one that continues by itself counts as interrupted."""
        run = self._run
        if run is not None and run.resumes:
            run.execution.cancel_running(why)
            self._save(run, suspended=True)
            self._end_run()
        elif self._restarted is None:
            self.suspend(why)

    def recover(self) -> None:
        """Suspend the plan that a previous process left executing, or waiting to continue.

        Commands that have ended stay known; the others are given again. Timers have continued.
        """
        self._recover_questions()
        waiting = filter(self._store.awaits_restart, self._active.suspended)
        executing = self._active.executing
        for plan_id in waiting if executing is None else (executing,):
            root = None if self._surroundings.is_held else self.root(plan_id)
            resumes = root is not None and root.resumes
            self._store.forget_unfinished_steps(plan_id)
            if recover_state(self._store, plan_id, self._clock.utc_s(), resumes):
                self._restarted = plan_id
        if (plan := self._executing) is not None:
            text = "the executive was restarted"
            self._change(plan, PlanEvent.SUSPEND, text, Reason.INTERRUPTED)

    def _await_operators(self) -> None:
        """Let a plan that would continue by itself wait until it is resumed."""
        if self._restarted is not None:
            self._store.stop_timers(self._restarted)
            self._restarted = None

    def _recover_questions(self) -> None:
        """Note the open questions of the plans that a former process left."""
        for plan_id, plan in self._plans.items():
            lasts = plan.state in {PlanStatus.EXECUTING, PlanStatus.SUSPENDED}
            if lasts and has_questions(self._store, plan_id):
                found = self.nodes(plan_id)
                if not isinstance(found, Refusal):
                    questions = (each.question for each in found)
                    self._active.questions[plan_id] = tuple(filter(None, questions))

    def fail(self, why: Refusal) -> None:
        """Fail the executing plan."""
        plan = self._executing
        if plan is not None:
            became = () if self._run is None else self._run.result_figures
            self._stop_run(why)
            self._change(plan, PlanEvent.FAIL, why.text, why.reason, became)

    def tick(self, submit: Callable[[Command], SubmitResult]) -> bool:
        """Tick the tree of the executing plan once, and submit the commands that it requests.

        Returns:
            Whether a commit is needed before the commands may start.

        Raises:
            executive.record.ledger.LedgerError: the state cannot be read.
            LeafError: a leaf raised.
        """
        if self._run is None:
            self._host.detach()  # of a plan that ended: recordings have its last tick
        plan = self._executing
        if plan is None:
            return self._restarted is not None and self._resume_restarted(self._restarted)
        if self._run is None and not self._store.is_durable(plan.batch):
            return False
        run = self._run or self._begin(plan)
        if run is None:
            return True
        result = run.tree.tick()
        if result is PlanResult.RUNNING:
            run.execution.report_questions()
            if (held := run.execution.held) is not None:
                text = f"held at {held.location.path}"
                self.suspend(Refusal(Reason.PLAN_SUSPENDED, text))
                return True
            return self._command(run, submit)
        self._end_run(is_shown=True)
        if result is PlanResult.SUCCESS:
            self._change(plan, PlanEvent.COMPLETE, "completed", figures=run.result_figures)
        else:
            skipped = "skipped: its conditions did not let it run"
            text = skipped if result is PlanResult.SKIPPED else run.execution.why or "failed"
            self._change(plan, PlanEvent.FAIL, text, Reason.PLAN_FAILED, run.result_figures)
        return True

    def _resume_restarted(self, plan_id: str) -> bool:
        """Resume a plan that continues by itself after a restart, as soon as the pose is known."""
        position, plan = self._surroundings.position, self._plans[plan_id]
        if self._surroundings.is_held:
            self._await_operators()
            return False
        late = self._clock.now_s() > self._restarted_s + RESTART_S
        waits = position is None or self._surroundings.awaits_battery
        if (waits and not late) or not self._store.is_durable(plan.batch):
            return False
        found = self._continued(plan_id, None if late else position)
        if isinstance(found, Refusal):
            self._await_operators()
            text = f"plan {plan_id} does not continue by itself: {found.text}"
            self._notifications.report_event(Severity.WARNING, text, found.reason, found.figures)
            return True
        stored, state = found
        self._restarted = None
        self._store.save_state(plan_id, stored)
        text = f"resumed after a restart, {state.restarts} of {MAX_RESTARTS}"
        self._change(plan, PlanEvent.RESUME, text)
        return True

    def _continued(
        self, plan_id: str, position: tuple[float, float] | None
    ) -> tuple[StoredState, PlanState] | Refusal:
        """Return the state of a plan that continues by itself, or why it does not."""
        if position is None:
            text = f"its position was not certain within {RESTART_S:.0f} s"
            return Refusal(Reason.POSE_UNCERTAIN, text)
        found = continued_state(self._store, plan_id, position, self._clock.utc_s())
        root = self.root(plan_id)
        if found is None or root is None:
            text = f"the rover is not within {MAX_RESTART_DISTANCE_M:g} m of a stored position"
            return Refusal(Reason.POSE_UNCERTAIN, text)
        return self._surroundings.check_energy(root, found[1].ended) or found

    def _save(self, run: ActiveRun, suspended: bool = False) -> None:
        stored = run.changed_state(self._clock, suspended)
        if stored is not None:
            plan_id = run.execution.plan.plan_id
            self._active.waits = run.waits
            self._active.questions[plan_id] = run.execution.questions
            self._store.save_state(plan_id, stored)

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
        utc_s, status = self._clock.utc_s(), PlanStatus.SUBMITTED
        update = PlanUpdate(definition.plan_id, status, utc_s, "", 0, self._total, text)
        self._plans[definition.plan_id] = RunningPlan(update)
        self._store.add(definition, update)
        self._notifications.report_plan_update(update)

    def _check_step(self, plan: RunningPlan, step: str | None) -> Refusal | None:
        self._skipped = ()
        root = None if step is None else self.root(plan.plan_id)
        if step is None or root is None:  # a plan that no longer fits fails when it continues
            return None
        try:
            _, state = self._stored(plan.plan_id, root)
        except StateError:
            return None
        letters = "" if state.tree is None else state.tree.statuses
        done = (number for number, letter in enumerate(letters) if letter in "SF")
        found = skipped_nodes(root, step, plan.node, {*state.ended, *done})
        if isinstance(found, Refusal):
            return found
        self._skipped = found
        return None

    def _stored(self, plan_id: str, root: PlanRoot) -> tuple[StoredState, PlanState]:
        """Return the stored state of a plan, or an initial one.

        Raises:
            StateError: it does not belong to the plan.
        """
        digest = digest_of(self._store.definition(plan_id), root)
        stored = self._store.state(plan_id)
        if stored is None:
            ended = tuple(ended_steps(self._store.journal(plan_id)))
            return StoredState(digest, self._clock.utc_s(), True, ""), PlanState(ended=ended)
        if stored.digest != digest:
            raise StateError("the stored state is of another text, of other arguments or nodes")
        return stored, decode(stored.text)

    def _resume(self, plan: RunningPlan, text: str) -> str:
        names = ", ".join(node.location.name for node in self._skipped[:MAX_NAMED])
        more = len(self._skipped) - MAX_NAMED
        text += f", skipping {names}{f' and {more} more' if more > 0 else ''}" if names else ""
        self._change(plan, PlanEvent.RESUME, text)
        root = self.root(plan.plan_id) if self._skipped else None
        if root is None:
            return text
        stored, state = self._stored(plan.plan_id, root)
        leaves, ended = {each.location.number for each in steps(root)}, set(state.ended)
        for node in self._skipped:
            ended |= {each.location.number for each in nodes(node)}
            plan.node, plan.done = node.location.path, len(ended & leaves)
            self._notify(plan, f"{node.location.path}: skipped")
        forced = {each.location.number: Steering.SUCCESS.name for each in self._skipped}
        forced = {**dict(state.forced), **forced}
        state = state._replace(ended=tuple(ended), forced=tuple(forced.items()))
        self._store.save_state(plan.plan_id, replace(stored, text=encode(state)))
        return text

    def _steerable(
        self, plan: RunningPlan, request: PlanSteering
    ) -> tuple[PlanRoot, PlanNode, PlanState] | Refusal:
        """Return the root of a plan, the node that a request steers, and the present state."""
        refusal = check_status(plan, set(PlanStatus) - FINAL_STATUSES)
        found = refusal or self._with_state(plan)
        if isinstance(found, Refusal):
            return found
        node = check_steering(request, *found)
        return node if isinstance(node, Refusal) else (found[0], node, found[1])

    def _with_state(self, plan: RunningPlan) -> tuple[PlanRoot, PlanState] | Refusal:
        if self._run is not None and self._run.execution.plan is plan:
            return self._run.execution.root, self._run.state()
        definition = self._store.definition(plan.plan_id)
        if self._read is None or self._read[0] != definition:
            self._read = definition, check_plan(definition, self._settings)
        root = self._read[1]
        if isinstance(root, Refusal):
            return root
        try:
            return root, self._stored(plan.plan_id, root)[1]
        except StateError as error:
            return Refusal(Reason.PLAN_STATUS, f"{plan.plan_id}: {error}")

    def _steer(self, plan: RunningPlan, request: PlanSteering, by: Identity) -> str:
        found = self._steerable(plan, request)
        assert not isinstance(found, Refusal), found
        root, node, state = found
        state, text = steered(request, node, state)
        text = f"{node.location.path}: {text}, by {by}"
        progress = plan.last.text  # of a suspended plan: the reason of the suspension
        if self._run is not None and self._run.execution.plan is plan:
            progress = text
            self._run.execution.steer(state)
            for each in self._run.execution.forced.items():
                self._run.tree.force(*each)
            self._save(self._run)
        else:
            stored, _ = self._stored(plan.plan_id, root)
            self._store.save_state(plan.plan_id, replace(stored, text=encode(state)))
            known, given = self._active.questions.get(plan.plan_id, ()), dict(state.answers)
            left = (each for each in known if each.key not in given)
            self._active.questions[plan.plan_id] = tuple(left)
        self._notify(plan, progress)
        return text

    def _abort(self, plan: RunningPlan, text: str) -> str:
        if plan.state in FINAL_STATUSES:
            return f"it has already ended: {plan.state.name}"
        if plan.state.running:
            self._stop_run(Refusal(Reason.PLAN_ABORTED, text), halts=True)
        return self._change(plan, PlanEvent.ABORT, text)

    def _begin(self, plan: RunningPlan) -> ActiveRun | None:
        root = check_plan(self._store.definition(plan.plan_id), self._settings)
        if isinstance(root, Refusal):
            self._change(plan, PlanEvent.FAIL, root.text, root.reason)
            return None
        try:
            stored, state = self._stored(plan.plan_id, root)
            journal = self._store.journal(plan.plan_id)
            execution = PlanExecution(
                *(plan, root, self._clock, self._cancel),
                *(self._surroundings, state, journal),
            )
            tree, is_new = self._host.attach(root, execution), state.tree is None and not journal
            if state.tree is not None:
                loaded = shifted(state, self._clock.now_s()).tree
                assert loaded is not None
                tree.load(loaded)
        except StateError as error:
            self._host.detach()
            self._change(plan, PlanEvent.FAIL, f"{plan.plan_id}: {error}", Reason.PLAN_STATUS)
            return None
        for each in execution.forced.items():
            tree.force(*each)
        self._change(plan, PlanEvent.BEGIN, "starts" if is_new else "continues")
        statistics = None
        if is_new:
            statistics = self._predict_plan(plan.plan_id, root, lambda: self._executes(execution))
        self._run = ActiveRun(execution, tree, stored.digest, root.resumes, statistics, PlanState())
        return self._run

    def _executes(self, execution: PlanExecution) -> bool:
        return self._run is not None and self._run.execution is execution

    def _command(self, run: ActiveRun, submit: Callable[[Command], SubmitResult]) -> bool:
        plan, execution = run.execution.plan, run.execution
        wanted = execution.take_requested()
        for step, request in wanted:
            number = self._store.next_number(plan.plan_id)
            identity = Identity(source_of(plan.plan_id), number)
            match submit(Command(identity, request, PLAN_LINK)):
                case Accepted(lifecycle):
                    execution.on_started(step, lifecycle)
                case Rejected(refusal) if refusal.reason is not Reason.LEDGER_FAILED:
                    execution.on_rejected(step, identity, refusal)
        self._save(run)
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
    ) -> str:
        """Apply an event to a plan and drop its state at its end; return the text.

        Raises:
            transitions.MachineError: the plan's status does not permit it.
        """
        MACHINE.events[event.value].trigger(plan)
        if plan.state in FINAL_STATUSES:
            final = plan.final_state or ended_state(self._store, plan.plan_id)
            self._store.end(plan.plan_id, final)
            self._active.questions.pop(plan.plan_id, None)
        self._notify(plan, text)
        if plan.state is not PlanStatus.ACTIVATED:
            severity = _SEVERITY.get(plan.state, Severity.INFORMATIONAL)
            detail = f"plan {plan.plan_id} {plan.state.name}: {text}"
            self._notifications.report_event(severity, detail, reason, figures)
        self._note()
        return text

    def _notify(self, plan: RunningPlan, text: str) -> None:
        utc_s, total = self._clock.utc_s(), plan.last.total
        plan.last = PlanUpdate(plan.plan_id, plan.state, utc_s, plan.node, plan.done, total, text)
        self._store.update(plan.last)
        plan.batch = self._store.last_batch
        self._notifications.report_plan_update(plan.last)

    def _note(self) -> None:
        states = [(plan_id, plan.state) for plan_id, plan in self._plans.items()]
        self._active.executing = next((i for i, state in states if state.running), None)
        self._active.suspended = tuple(i for i, state in states if state is PlanStatus.SUSPENDED)

    def _stop_run(self, why: Refusal, halts: bool = False) -> None:
        if self._run is not None:
            self._run.execution.cancel_running(why)
            if halts:
                with suppress(LeafError):
                    self._run.tree.halt()
            self._end_run()

    def _end_run(self, is_shown: bool = False) -> None:
        """End the run; its tree is detached at once, or shown until the next tick."""
        if self._run is not None:
            self._run.execution.plan.final_state = self._run.final_state(self._clock)
        self._run, self._active.waits = None, ""
        if not is_shown:
            self._host.detach()


def _no_plan(plan_id: str) -> Refusal:
    text = f"there is no plan {plan_id[:64]!r}"
    return Refusal(Reason.NO_SUCH_PLAN, text, argument=1, subject=plan_id)
