"""What the core needs of the world, and what it offers to it. Adapters implement or call these."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from executive.values.geometry import Velocity
from executive.values.parameters import ParameterValue
from executive.values.reports import FileEvent, Identity, PlanUpdate, Report


@dataclass(frozen=True, slots=True)
class TurnBy:
    """Turn on the spot by an angle, counter-clockwise positive."""

    angle_rad: float
    speed_radps: float


@dataclass(frozen=True, slots=True)
class Advance:
    """Drive straight on; a negative distance drives backward."""

    distance_m: float
    speed_mps: float


@dataclass(frozen=True, slots=True)
class Hold:
    """Hold a velocity for a time, then stand."""

    velocity: Velocity
    duration_s: float


@dataclass(frozen=True, slots=True)
class WholeMotion:
    """A motion that a rover carries out by itself, from standing to standing.

    Attributes:
        number: counts from 1 in one process; the rover's answer carries it.
        command: the command of which it is a part.
    """

    number: int
    what: TurnBy | Advance | Hold
    command: Identity


Wanted = Velocity | WholeMotion


@dataclass(frozen=True, slots=True)
class CameraIntent:
    """Angles to point the camera at.

    Attributes:
        speed_radps: how fast at most.
        command: whose wish it is; None for nobody's.
    """

    pan_rad: float
    tilt_rad: float
    speed_radps: float
    command: Identity | None = None


class Rover(Protocol):
    """The actuators that every asset has. Only `executive.motion.arbiter` calls it."""

    def point_camera(self, wanted: CameraIntent) -> None:
        """Command the camera's angles, and its greatest speed on the way there."""

    def request_frame(self) -> None:
        """Ask for the next camera frame, which arrives as a fact `Frame`."""

    def emergency_stop(self) -> None:
        """Have the rover stand, now. May be called from any thread, and never blocks.

        Where a mux is before the base, it takes the lock too.
        """

    def lock(self, held: bool) -> None:
        """Have the base obey nobody while held, where a mux is before it. Called at each tick."""


@runtime_checkable
class VelocityRover(Rover, Protocol):
    """A rover that takes velocities."""

    def drive(self, velocity: Velocity) -> None:
        """Command a velocity of base_link; it holds until the next call or the rover's timeout."""


@runtime_checkable
class DelegatedMotionRover(Rover, Protocol):
    """A rover that carries out whole motions by itself, and tells their end by `MotionEnded`."""

    def carry_out(self, motion: WholeMotion) -> None:
        """Begin a motion, instead of the one under way."""

    def halt(self) -> None:
        """Stand still."""


class Video(Protocol):
    """What forwards the camera's video stream to the ground."""

    @property
    def on(self) -> bool:
        """Whether it forwards."""

    def switch(self, on: bool) -> None:
        """Forward from now on, or no more.

        Raises:
            OSError: it cannot.
        """


class Downlink(Protocol):
    """A way out. Called on the core's thread: must neither block nor raise."""

    def report(self, reports: Sequence[Report]) -> None:
        """Send reports, once they are written down: those of one commit, in their order."""

    def telemetry(self, values: Sequence[ParameterValue]) -> None:
        """Send parameter values."""

    def file(self, event: FileEvent) -> None:
        """Send what happened to a file."""

    def plan(self, update: PlanUpdate) -> None:
        """Send how far a plan has come, once it is written down."""
