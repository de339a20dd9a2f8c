"""What the rover's sensors tell the executive."""

from dataclasses import dataclass

from executive.geometry import Pose, Velocity
from executive.reports import Identity


@dataclass(frozen=True, slots=True)
class Odometry:
    """Pose and velocity of base_link in the odometry frame.

    Attributes:
        stamp_s: when it was measured, on the clock of its publisher.
    """

    stamp_s: float
    pose: Pose
    velocity: Velocity


@dataclass(frozen=True, slots=True)
class Battery:
    """Battery voltage."""

    voltage_v: float


@dataclass(frozen=True, slots=True)
class CameraAngles:
    """Where the camera points, measured: pan counter-clockwise, tilt upward positive."""

    pan_rad: float
    tilt_rad: float


@dataclass(frozen=True, slots=True)
class Frame:
    """One encoded camera picture.

    Attributes:
        stamp_s: when it was taken, on the clock of its publisher.
        format: JPG or PNG.
    """

    stamp_s: float
    format: str
    data: bytes


@dataclass(frozen=True, slots=True)
class ForeignPublishers:
    """Who else may move the rover: nodes other than ours that publish its velocity."""

    names: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class MotionEnded:
    """A rover that moves by itself ended a whole motion.

    Attributes:
        executed: whether it was carried out.
        text: what the rover says of it.
    """

    number: int
    executed: bool
    text: str = ""


@dataclass(frozen=True, slots=True)
class CommandEnded:
    """A command ended that a rover had by another way first, and so carried out only once.

    Attributes:
        executed: whether it was carried out.
        text: what the rover says of it.
    """

    identity: Identity
    executed: bool
    text: str = ""


@dataclass(frozen=True, slots=True)
class CommandUnderWay:
    """A rover carries out a command that it had by another way first."""

    identity: Identity


@dataclass(frozen=True, slots=True)
class Stopped:
    """The rover was stopped by another way than the executive's.

    Attributes:
        by: who stopped it, for people.
    """

    by: str


Fact = (
    Odometry
    | Battery
    | CameraAngles
    | Frame
    | ForeignPublishers
    | MotionEnded
    | CommandEnded
    | CommandUnderWay
    | Stopped
)
