"""Plans: behaviour trees that mission control sends, and what becomes of them."""

from executive.plans.builder import check_plan, most_commands
from executive.plans.execution import PlanExecution, PlanHost, Progress, step_key
from executive.plans.model import (
    DEADLINE,
    LEAVES,
    FallbackNode,
    InverterNode,
    LoopNode,
    ParallelNode,
    PlanNode,
    RepeatOn,
    SequenceNode,
    Step,
    TimeoutEnd,
    TimeoutNode,
    expected_course,
    help_of,
    steps,
)
from executive.plans.plan_xml import FORMAT
from executive.plans.planner import FINAL_STATUSES, ActivePlans, Planner

__all__ = [
    "DEADLINE",
    "FINAL_STATUSES",
    "FORMAT",
    "LEAVES",
    "ActivePlans",
    "FallbackNode",
    "InverterNode",
    "LoopNode",
    "ParallelNode",
    "PlanExecution",
    "PlanHost",
    "PlanNode",
    "Planner",
    "Progress",
    "RepeatOn",
    "SequenceNode",
    "Step",
    "TimeoutEnd",
    "TimeoutNode",
    "check_plan",
    "expected_course",
    "help_of",
    "most_commands",
    "step_key",
    "steps",
]
