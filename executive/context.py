"""What the leaves of the tree see and may touch."""

from dataclasses import dataclass

from executive.clock import Clock
from executive.files import FileFolder
from executive.goals import GoalQueue
from executive.intents import Intents
from executive.latches import Latches
from executive.lifecycle import Life
from executive.locomotion import Locomotion
from executive.plans.agenda import Agenda
from executive.ports import Video
from executive.reasons import Refusal
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
    locomotion: Locomotion
    latches: Latches
    agenda: Agenda
    files: FileFolder
    video: Video | None

    def cancel(self, life: Life, refusal: Refusal) -> None:
        """End one accepted command that waits or is under way; others go on."""
        for queue in (self.motion, self.camera, self.errands):
            queue.cancel(life, refusal)
