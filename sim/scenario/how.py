"""The ways in which a scenario is played."""

from enum import Enum, unique


@unique
class How(Enum):
    """Where it is played, and by which link the ground speaks to the rover."""

    LOCK_STEP = "in lock step"
    """One process, simulated time; the link is the call of a function."""
    DIRECT = "by the direct link"
    """Real processes in real time; MAL on TCP."""
    RELAY = "by the relay"
    """The same, through an orbiter; MAL on TCP, then bundles."""

    @property
    def link(self) -> str:
        """The name of the link, as commands carry it."""
        return "relay" if self is How.RELAY else "direct"
