"""Plans: behaviour trees that mission control sends, and what becomes of them."""

from executive.plans.execution import PlanExecution, PlanHost, Progress, step_key
from executive.plans.leaves import DEADLINE, LEAVES, Kind, Parameter
from executive.plans.model import (
    Branch,
    Inversion,
    Loop,
    Order,
    Parallel,
    PlanNode,
    RepeatOn,
    Step,
    Timeout,
    steps,
)
from executive.plans.plan_xml import FORMAT
from executive.plans.planner import Planner
from executive.plans.register import FINAL_STATUSES, ActivePlans

__all__ = [
    "DEADLINE",
    "FINAL_STATUSES",
    "FORMAT",
    "LEAVES",
    "ActivePlans",
    "Branch",
    "Inversion",
    "Kind",
    "Loop",
    "Order",
    "Parallel",
    "Parameter",
    "PlanExecution",
    "PlanHost",
    "PlanNode",
    "Planner",
    "Progress",
    "RepeatOn",
    "Step",
    "Timeout",
    "step_key",
    "steps",
]
