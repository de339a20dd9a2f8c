"""The life of a plan as one table of edges, driven by `transitions`."""

from dataclasses import dataclass
from enum import Enum
from functools import cache
from typing import Final, Protocol

from transitions import Machine

from executive.reports import PlanStatus


class PlanEvent(Enum):
    """What can happen to a plan."""

    ACTIVATE = "activate"
    BEGIN = "begin"
    SUSPEND = "suspend"
    RESUME = "resume"
    COMPLETE = "complete"
    FAIL = "fail"
    ABORT = "abort"


@dataclass(frozen=True, slots=True)
class PlanEdge:
    """One allowed change of status."""

    event: PlanEvent
    source: PlanStatus
    target: PlanStatus


EDGES: Final = (
    PlanEdge(PlanEvent.ACTIVATE, PlanStatus.SUBMITTED, PlanStatus.ACTIVATED),
    PlanEdge(PlanEvent.ABORT, PlanStatus.SUBMITTED, PlanStatus.ABORTED),
    PlanEdge(PlanEvent.BEGIN, PlanStatus.ACTIVATED, PlanStatus.EXECUTING),
    PlanEdge(PlanEvent.SUSPEND, PlanStatus.ACTIVATED, PlanStatus.SUSPENDED),
    PlanEdge(PlanEvent.FAIL, PlanStatus.ACTIVATED, PlanStatus.FAILED),
    PlanEdge(PlanEvent.ABORT, PlanStatus.ACTIVATED, PlanStatus.ABORTED),
    PlanEdge(PlanEvent.COMPLETE, PlanStatus.EXECUTING, PlanStatus.COMPLETED),
    PlanEdge(PlanEvent.FAIL, PlanStatus.EXECUTING, PlanStatus.FAILED),
    PlanEdge(PlanEvent.SUSPEND, PlanStatus.EXECUTING, PlanStatus.SUSPENDED),
    PlanEdge(PlanEvent.ABORT, PlanStatus.EXECUTING, PlanStatus.ABORTED),
    PlanEdge(PlanEvent.RESUME, PlanStatus.SUSPENDED, PlanStatus.ACTIVATED),
    PlanEdge(PlanEvent.ABORT, PlanStatus.SUSPENDED, PlanStatus.ABORTED),
)

FINAL: Final = frozenset(
    status for status in PlanStatus if status not in {edge.source for edge in EDGES}
)
"""Statuses that a plan does not leave."""


class HasStatus(Protocol):
    """What `change` changes."""

    state: PlanStatus


def sources(event: PlanEvent) -> tuple[PlanStatus, ...]:
    """Return the statuses in which something can happen."""
    return tuple(edge.source for edge in EDGES if edge.event is event)


def change(plan: HasStatus, event: PlanEvent) -> None:
    """Let something happen to a plan.

    Raises:
        transitions.MachineError: it cannot, from the plan's status.
    """
    _machine().events[event.value].trigger(plan)


@cache
def _machine() -> Machine:
    return Machine(
        model=None,
        states=PlanStatus,
        initial=PlanStatus.SUBMITTED,
        transitions=[
            {"trigger": edge.event.value, "source": edge.source, "dest": edge.target}
            for edge in EDGES
        ],
        auto_transitions=False,
        queued=True,
    )


def mermaid() -> str:
    """Return the life of a plan as a Mermaid state diagram, drawn from `EDGES`."""
    lines = ["stateDiagram-v2", "    [*] --> SUBMITTED"]
    lines += [f"    {e.source.name} --> {e.target.name}: {e.event.value}" for e in EDGES]
    lines += [f"    {status.name} --> [*]" for status in PlanStatus if status in FINAL]
    return "\n".join(lines) + "\n"
