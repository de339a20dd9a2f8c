"""What can be asked of plans: the commands of the MRS service Plan."""

from dataclasses import dataclass

from executive.plans.definition import PlanDefinition


@dataclass(frozen=True, slots=True)
class SubmitPlan:
    """Check a plan whole, and keep it."""

    plan: PlanDefinition


@dataclass(frozen=True, slots=True)
class ActivatePlan:
    """Give the rover to a plan."""

    plan_id: str


@dataclass(frozen=True, slots=True)
class SuspendPlan:
    """Take the rover from a plan, until it is resumed."""

    plan_id: str


@dataclass(frozen=True, slots=True)
class ResumePlan:
    """Let a suspended plan go on where it was."""

    plan_id: str


@dataclass(frozen=True, slots=True)
class AbortPlan:
    """End a plan for good."""

    plan_id: str


@dataclass(frozen=True, slots=True)
class RemovePlan:
    """Forget a plan that has ended or never began."""

    plan_id: str


PlanRequest = SubmitPlan | ActivatePlan | SuspendPlan | ResumePlan | AbortPlan | RemovePlan
