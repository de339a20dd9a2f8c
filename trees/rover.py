"""The static tree of a rover: priority stop over safety over work over idle."""

from py_trees.behaviour import Behaviour
from py_trees.common import ParallelPolicy, Status
from py_trees.composites import Parallel, Selector, Sequence

from executive.context import Context
from executive.plans.nodes import PlanNode
from executive.plans.work import Work
from trees.camera import Capture, PanTilt, WantsAngles, WantsPicture
from trees.errands import Errand, WantsErrand
from trees.guards import Hold, Stop, Stopping, Unsafe
from trees.leaf import Condition
from trees.motion import (
    Drive,
    FinishLeg,
    HoldVelocity,
    LegSlot,
    PlanLeg,
    Rest,
    Turn,
    WantsLeg,
    WantsVelocity,
)
from trees.plan import PlanTree
from trees.snapshot import Node, nodes


class AnyGoal(Condition):
    """Whether any goal waits or is under way."""

    def holds(self) -> bool:
        """Look at the queues."""
        context = self.context
        return len(context.motion) + len(context.camera) + len(context.errands) > 0


class RoverTree:
    """The tree as the runner needs it.

    Attributes:
        root: its root node.
        ticks: how often it was ticked.
        ticked: the nodes that the last tick came to.
        plan: the tree of the plan that executes, if one does.
    """

    def __init__(self, context: Context) -> None:
        """Build it over the context."""
        self.context = context
        self.root = build(context)
        self.ticks = 0
        self.ticked: frozenset[Behaviour] = frozenset()
        self.plan: PlanTree | None = None

    def tick(self) -> None:
        """Tick once from the root.

        Raises:
            executive.runner.LeafError: a leaf raised.
        """
        self.ticks += 1
        self.ticked = frozenset(self.root.tick())

    def stop(self) -> None:
        """End every running node."""
        self.root.stop(Status.INVALID)

    def grow(self, plan: PlanNode, work: Work) -> PlanTree:
        """Return the tree of a plan, which stands here until it is pruned."""
        self.plan = PlanTree(plan, work)
        return self.plan

    def prune(self) -> None:
        """Let the plan's tree go."""
        self.plan = None

    def nodes(self) -> tuple[Node, ...]:
        """Return all nodes as of the last tick; a plan's stand first below the root."""
        root, *others = nodes(self.root, self.ticked)
        planned = nodes(self.plan.root, self.plan.ticked, depth=1) if self.plan else ()
        return (root, *planned, *others)


def build(context: Context) -> Selector:
    """Return the root of the tree over a context."""
    return _selector(
        "rover",
        _sequence("priority stop", Stopping("stopping?", context), Stop("stop", context)),
        _sequence("safety", Unsafe("unsafe?", context), Hold("hold", context)),
        _sequence("work", AnyGoal("any goal?", context), _work(context)),
        Rest("idle", context),
    )


def _work(context: Context) -> Behaviour:
    beside = Parallel("side by side", ParallelPolicy.SuccessOnAll(synchronise=False))
    beside.add_children([_motion(context), _camera(context), _errands(context)])
    return beside


def _motion(context: Context) -> Behaviour:
    slot = LegSlot()
    leg = Sequence(
        "leg",
        memory=True,
        children=[
            PlanLeg("plan leg", context, slot),
            Turn("turn towards", context, slot, final=False),
            Drive("drive", context, slot),
            Turn("turn to heading", context, slot, final=True),
            FinishLeg("finish leg", context, slot),
        ],
    )
    return _selector(
        "motion",
        _sequence("go", WantsLeg("somewhere to go?", context), leg),
        _sequence(
            "velocity",
            WantsVelocity("velocity to hold?", context),
            HoldVelocity("hold velocity", context),
        ),
        Rest("no motion", context),
    )


def _camera(context: Context) -> Behaviour:
    return _selector(
        "camera",
        _sequence(
            "point",
            WantsAngles("angles wanted?", context),
            PanTilt("pan and tilt", context, context.camera),
        ),
        _sequence(
            "picture",
            WantsPicture("picture wanted?", context),
            Capture("capture", context, context.camera),
        ),
        Rest("no camera work", context),
    )


def _errands(context: Context) -> Behaviour:
    return _selector(
        "errands",
        _sequence(
            "errand",
            WantsErrand("errand wanted?", context),
            Errand("do errand", context, context.errands),
        ),
        Rest("no errand", context),
    )


def _selector(name: str, *children: Behaviour) -> Selector:
    return Selector(name, memory=False, children=list(children))


def _sequence(name: str, *children: Behaviour) -> Sequence:
    return Sequence(name, memory=False, children=list(children))
