"""Plans: behaviour trees that mission control sends; their check, execution and results."""

from executive.plans.builder import check_plan as check_plan
from executive.plans.builder import max_commands as max_commands
from executive.plans.execution import PlanExecution as PlanExecution
from executive.plans.execution import PlanHost as PlanHost
from executive.plans.execution import StepStatus as StepStatus
from executive.plans.execution import step_key as step_key
from executive.plans.model import DEADLINE as DEADLINE
from executive.plans.model import LEAVES as LEAVES
from executive.plans.model import FallbackNode as FallbackNode
from executive.plans.model import InverterNode as InverterNode
from executive.plans.model import LoopNode as LoopNode
from executive.plans.model import ParallelNode as ParallelNode
from executive.plans.model import PlanNode as PlanNode
from executive.plans.model import PlanStep as PlanStep
from executive.plans.model import RepeatOn as RepeatOn
from executive.plans.model import SequenceNode as SequenceNode
from executive.plans.model import TimeoutEnd as TimeoutEnd
from executive.plans.model import TimeoutNode as TimeoutNode
from executive.plans.model import attribute_help as attribute_help
from executive.plans.model import nominal_steps as nominal_steps
from executive.plans.model import steps as steps
from executive.plans.plan_xml import FORMAT as FORMAT
from executive.plans.planner import FINAL_STATUSES as FINAL_STATUSES
from executive.plans.planner import ActivePlans as ActivePlans
from executive.plans.planner import Planner as Planner
