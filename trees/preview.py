"""The tree of an asset that is not running, for drawing it."""

from pathlib import Path

from executive.by_velocity import VelocityLocomotion
from executive.clock import ManualClock
from executive.context import Context
from executive.files import FileFolder
from executive.goals import GoalQueue
from executive.intents import Intents
from executive.latches import Latches
from executive.plans.agenda import Agenda
from executive.settings import Settings
from executive.status import Status
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
        agenda=Agenda(),
        files=FileFolder(Path(), lambda _: None),
        video=None,
    )
    return nodes(build(context), ())
