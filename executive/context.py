"""What the leaves of the tree see and may touch."""

from dataclasses import dataclass

from executive.files import FileFolder
from executive.goals import GoalQueue
from executive.intents import Intents
from executive.latches import Latches
from executive.ports import Clock, Video
from executive.settings import Settings
from executive.status import Status


@dataclass(frozen=True, slots=True)
class Context:
    """One asset's state, goals and intents, handed to every leaf.

    Attributes:
        video: None where the asset has none.
    """

    clock: Clock
    settings: Settings
    status: Status
    motion: GoalQueue
    camera: GoalQueue
    errands: GoalQueue
    intents: Intents
    latches: Latches
    files: FileFolder
    video: Video | None
