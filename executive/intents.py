"""What leaves want of the actuators in this tick; the arbiter decides what becomes of it."""

from dataclasses import dataclass

from executive.commands import Identity
from executive.motions import Wanted


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


@dataclass(slots=True)
class Intents:
    """One slot an actuator, emptied before each tick.

    Attributes:
        motion: velocity of base_link, or whole motion, wanted.
        camera: angles wanted of the camera.
        frame: whether a camera frame is wanted.
    """

    motion: Wanted | None = None
    camera: CameraIntent | None = None
    frame: bool = False

    def clear(self) -> None:
        """Want nothing."""
        self.motion = None
        self.camera = None
        self.frame = False
