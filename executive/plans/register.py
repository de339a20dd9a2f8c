"""All plans that are kept, and the life of each as one table of edges, driven by `transitions`."""

from collections.abc import Sequence
from enum import Enum
from typing import Final

from executive.clock import Clock
from executive.commands import PlanDefinition
from executive.commands.lifecycle import Edge, final_states, make_machine
from executive.notifications import Notifications
from executive.reasons import Reason
from executive.record import PlanStore
from executive.reports import PlanStatus, PlanUpdate, Severity


class ActivePlans:
    """Set by the planner alone.

    Attributes:
        executing: the plan that has the rover, if any.
        suspended: the plans that wait to be resumed.
    """

    def __init__(self) -> None:
        self.executing: str | None = None
        self.suspended: tuple[str, ...] = ()


class PlanEvent(Enum):
    """What can happen to a plan."""

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

FINAL_STATUSES: Final = frozenset(final_states(PLAN_EDGES))
"""Statuses that a plan does not leave."""


_MACHINE: Final = make_machine(PLAN_EDGES)


def sources(event: PlanEvent) -> tuple[PlanStatus, ...]:
    """Return the statuses in which something can happen."""
    return tuple(edge.source for edge in PLAN_EDGES if edge.event is event)


_SEVERITY: Final = {
    PlanStatus.SUSPENDED: Severity.WARNING,
    PlanStatus.FAILED: Severity.ALARM,
}


class Plan:
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


class Register:
    """The plans of one ledger.

    Args:
        active: is told which plan executes, and which wait to go on.
    """

    def __init__(
        self, clock: Clock, store: PlanStore, notifications: Notifications, active: ActivePlans
    ) -> None:
        self._clock = clock
        self._store = store
        self._notifications = notifications
        self._active = active
        self._plans = {last.plan_id: Plan(last) for last in store.plans()}
        self._note()

    def __len__(self) -> int:
        return len(self._plans)

    def __getitem__(self, plan_id: str) -> Plan:
        return self._plans[plan_id]

    def find(self, plan_id: str) -> Plan | None:
        """Return a plan, if it is kept."""
        return self._plans.get(plan_id)

    @property
    def executing(self) -> Plan | None:
        """The plan that has the rover, if one does."""
        executing = self._active.executing
        return None if executing is None else self._plans[executing]

    def updates(self) -> Sequence[PlanUpdate]:
        """Return how far each plan has come, in the order in which they were submitted."""
        return [plan.last for plan in self._plans.values()]

    def add(self, definition: PlanDefinition, total: int, text: str) -> None:
        """Keep a new plan, with so many leaves."""
        utc_s, status = self._clock.utc_s(), PlanStatus.SUBMITTED
        update = PlanUpdate(definition.plan_id, status, utc_s, "", 0, total, text)
        self._plans[definition.plan_id] = Plan(update)
        self._store.add(definition, update)
        self._notifications.plan(update)

    def remove(self, plan_id: str) -> None:
        """Forget a plan."""
        self._store.remove(plan_id)
        del self._plans[plan_id]

    def change(self, plan: Plan, event: PlanEvent, text: str, reason: Reason | None = None) -> None:
        """Let something happen to a plan.

        Raises:
            transitions.MachineError: it cannot, from the plan's status.
        """
        _MACHINE.events[event.value].trigger(plan)
        self.tell(plan, text)
        if plan.state is not PlanStatus.ACTIVATED:
            severity = _SEVERITY.get(plan.state, Severity.INFORMATIONAL)
            said = f"plan {plan.plan_id} {plan.state.name}: {text}"
            self._notifications.event(severity, said, reason)
        self._note()

    def tell(self, plan: Plan, text: str) -> None:
        """Write down and send how far a plan has come."""
        utc_s, total = self._clock.utc_s(), plan.last.total
        plan.last = PlanUpdate(plan.plan_id, plan.state, utc_s, plan.node, plan.done, total, text)
        self._store.update(plan.last)
        self._notifications.plan(plan.last)

    def _note(self) -> None:
        states = [(plan_id, plan.state) for plan_id, plan in self._plans.items()]
        self._active.executing = next((i for i, state in states if state.running), None)
        self._active.suspended = tuple(i for i, state in states if state is PlanStatus.SUSPENDED)
