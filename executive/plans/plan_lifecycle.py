"""The life cycle of a plan: its statuses, and the events between them."""

from collections.abc import Iterable
from enum import Enum
from typing import Final

from executive.commands.lifecycle import Edge, make_machine, terminal_states
from executive.plans.execution import RunningPlan
from executive.values.plan_nodes import Question
from executive.values.reasons import Reason, Refusal
from executive.values.reports import PlanStatus


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

MACHINE: Final = make_machine(PLAN_EDGES, "state")
"""Applies an event to the attribute `state` of a plan."""


def source_states(event: PlanEvent) -> tuple[PlanStatus, ...]:
    """Return the statuses that permit an event."""
    return tuple(edge.source for edge in PLAN_EDGES if edge.event is event)


def check_status(plan: RunningPlan, allowed: Iterable[PlanStatus]) -> Refusal | None:
    """Return a refusal unless a plan is in one of some statuses."""
    if plan.state in allowed:
        return None
    names = ", ".join(sorted(status.name for status in allowed))
    text = f"plan {plan.plan_id} is {plan.state.name}: needs {names}"
    return Refusal(Reason.PLAN_STATUS, text)


class ActivePlans:
    """The executing and suspended plans; written by the planner alone.

    Attributes:
        executing: the plan that controls the rover, if any.
        suspended: the plans that wait to be resumed.
        started_by: source that last activated or resumed each plan, in this process.
        waits: the present waits and questions of the executing plan, as text; empty without any.
        questions: the open questions of the executing and suspended plans, by their ids.
    """

    def __init__(self) -> None:
        self.executing: str | None = None
        self.suspended: tuple[str, ...] = ()
        self.started_by: dict[str, str] = {}
        self.waits = ""
        self.questions: dict[str, tuple[Question, ...]] = {}
