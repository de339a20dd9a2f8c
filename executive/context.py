"""What the leaves of the tree see and may touch."""

from dataclasses import dataclass

from executive.goals import GoalQueue
from executive.intents import Intents
from executive.latches import Latches
from executive.pictures import PictureFolder
from executive.ports import Clock
from executive.settings import Settings
from executive.status import Status


@dataclass(frozen=True, slots=True)
class Context:
    """One asset's state, goals and intents, handed to every leaf."""

    clock: Clock
    settings: Settings
    status: Status
    motion: GoalQueue
    camera: GoalQueue
    intents: Intents
    latches: Latches
    pictures: PictureFolder
