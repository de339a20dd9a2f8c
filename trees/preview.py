"""The tree of an asset that is not running, for drawing it."""

from pathlib import Path

from executive.clock import ManualClock
from executive.goals import Context, GoalQueue
from executive.motion import Intents, Latches, VelocityLocomotion
from executive.plans import ActivePlans
from executive.settings import Settings
from executive.state import FileFolder, Status
from trees.rover import build
from trees.snapshot import Node, nodes


def preview(settings: Settings) -> tuple[Node, ...]:
    """Return the nodes of an asset's tree, none of them ticked."""
    clock = ManualClock()
    status = Status(clock, settings)
    context = Context(
        clock=clock,
        settings=settings,
        status=status,
        motion=GoalQueue(clock),
        camera=GoalQueue(clock),
        errands=GoalQueue(clock),
        intents=Intents(),
        locomotion=VelocityLocomotion(clock, settings, status),
        latches=Latches(),
        agenda=ActivePlans(),
        files=FileFolder(Path(), lambda _: None),
        video=None,
    )
    return nodes(build(context), ())
