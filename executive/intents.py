"""What leaves want of the actuators in this tick; the arbiter decides what becomes of it."""

from dataclasses import dataclass

from executive.motions import Wanted
from executive.ports import CameraIntent


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
