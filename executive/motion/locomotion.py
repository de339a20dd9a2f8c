"""How an asset moves: the port between the motion leaves and what its rover understands.

Leaves ask a `Locomotion` for a `Motion` and write what it wants into the intents. The arbiter
gives that to a `Mover`, which alone commands the rover. `velocity_control` is for rovers that take
velocities, `delegated_motion` for those that carry out whole motions by themselves.
"""

from abc import ABC, abstractmethod
from typing import Protocol

from executive.commands import Command, DriveFor
from executive.geometry import Velocity
from executive.motion.legs import Leg
from executive.ports import Wanted
from executive.reasons import Refusal


class Motion(ABC):
    """A turn, a straight line or a velocity held, under way.

    Attributes:
        expected_s: how long it takes if nothing goes wrong.
    """

    expected_s: float

    @property
    @abstractmethod
    def done(self) -> bool:
        """Whether the rover stands where the motion ends."""

    @property
    def ending(self) -> bool:
        """Whether another motion may take over now; by default once this one is done."""
        return self.done

    @property
    def fault(self) -> Refusal | None:
        """Why it cannot be done, once that is known."""
        return None

    @property
    @abstractmethod
    def left(self) -> str:
        """What is left of it, for people."""

    def renew(self, _: float) -> bool:
        """Plan anew if another greatest speed was set; return whether there was need."""
        return False

    @abstractmethod
    def want(self, now_s: float) -> Wanted:
        """Return what to command in this tick."""


class Locomotion(Protocol):
    """Makes motions of commands, beginning now.

    Attributes:
        alone: whether the rover points no camera while it carries out a motion.
    """

    alone: bool

    def turn(self, command: Command, leg: Leg, final: bool) -> Motion | None:
        """Return the turn of a leg, towards its target or to its last heading, if it has one."""
        ...

    def line(self, command: Command, leg: Leg) -> Motion | None:
        """Return the straight line of a leg, if it has one."""
        ...

    def hold(self, command: Command, request: DriveFor) -> Motion:
        """Return the holding of a velocity."""
        ...


class Mover(Protocol):
    """Commands the rover's motion. Only `executive.motion.arbiter` calls it."""

    @property
    def velocity(self) -> Velocity:
        """What the rover is made to do now."""
        ...

    def stop(self) -> None:
        """Make the rover stand, now."""
        ...

    def hold(self) -> None:
        """Have the rover go on standing, in each tick after a stop."""
        ...

    def commit(self, wanted: Wanted | None, now_s: float, step_s: float) -> None:
        """Command what is wanted in this tick; None: nothing is."""
        ...
