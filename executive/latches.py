"""What keeps the rover from moving until it is resumed: a stop, or a hazard."""

from executive.lifecycle import Life
from executive.reasons import Refusal


class Latches:
    """Set by stop commands and hazards, cleared by resume.

    Attributes:
        stopped_by: the command that stopped the rover, for people; None when not stopped.
        hazard: why the rover is SAFE; None when it is not.
        stopping: stop commands under way, until the rover stands.
    """

    def __init__(self) -> None:
        """Nothing holds."""
        self.stopped_by: str | None = None
        self.hazard: Refusal | None = None
        self.stopping: list[Life] = []

    @property
    def held(self) -> bool:
        """Whether the rover must not move."""
        return self.stopped_by is not None or self.hazard is not None

    def clear(self) -> None:
        """Hold nothing."""
        self.stopped_by = None
        self.hazard = None
