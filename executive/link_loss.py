"""What the rover does when nothing is heard of the ground, in stages, for what it is about.

Anything that the ground sends on either link is a sign of it; what is asked or commanded aboard is
none. By default the rover goes on.
"""

from dataclasses import dataclass
from typing import Final

from executive.authority import RELAY_LINK
from executive.clock import Clock
from executive.commands import Mode
from executive.settings import LinkLoss, LinkLossStage

DIRECT_LINK: Final = "direct"
"""The link of the commands that come from the ground itself."""
GROUND_LINKS: Final = frozenset({DIRECT_LINK, RELAY_LINK})
"""The links of which the other end is the ground."""


@dataclass(frozen=True, slots=True)
class Reached:
    """A stage that has been reached, after so many seconds of silence."""

    stage: LinkLossStage
    silent_s: float


class GroundMonitor:
    """Counts for how long nothing has been heard of the ground.

    Attributes:
        stage: the last stage that was reached; None while the ground is heard, or nothing moves.
    """

    def __init__(self, clock: Clock, settings: LinkLoss) -> None:
        self._clock = clock
        self._settings = settings
        self._heard_s = clock.now_s()
        self._sign = False
        self.stage: LinkLossStage | None = None

    def hear(self) -> None:
        """Take a sign of the ground, from any thread."""
        self._sign = True

    @property
    def silent_s(self) -> float:
        """Seconds since the last sign."""
        return self._clock.now_s() - self._heard_s

    def look(self, mode: Mode) -> Reached | None:
        """Return the stage that is reached now, if it is another one than before."""
        if self._sign:
            self._sign, self._heard_s = False, self._clock.now_s()
        silent_s = self.silent_s
        reached = [each for each in self._stages(mode) if silent_s >= each.after_s]
        stage = reached[-1] if reached else None
        before, self.stage = self.stage, stage
        return None if stage is None or stage is before else Reached(stage, silent_s)

    def _stages(self, mode: Mode) -> tuple[LinkLossStage, ...]:
        match mode:
            case Mode.TELEOP:
                return self._settings.teleop
            case Mode.MOVING:
                return self._settings.motion
            case Mode.PLAN:
                return self._settings.plan
            case _:
                return ()
