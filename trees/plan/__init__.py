"""The trees of plans, with the semantics of BehaviorTree.CPP v4."""

from trees.plan.decorators import PlanDecorator as PlanDecorator
from trees.plan.leaves import PlanLeaf as PlanLeaf
from trees.plan.leaves import TimedLeaf as TimedLeaf
from trees.plan.node import FAILURE as FAILURE
from trees.plan.node import IDLE as IDLE
from trees.plan.node import RUNNING as RUNNING
from trees.plan.node import SKIPPED as SKIPPED
from trees.plan.node import SUCCESS as SUCCESS
from trees.plan.node import Answer as Answer
from trees.plan.node import PlanBehaviour as PlanBehaviour
from trees.plan.proof import Proof as Proof
from trees.plan.proof import prove as prove
from trees.plan.tree import NODES as NODES
from trees.plan.tree import PlanTree as PlanTree
