"""What the node needs of the rover that it serves, whichever way that is moved."""

from collections.abc import Callable, Sequence
from typing import Any, Protocol

from sensor_msgs.msg import CompressedImage

from adapters.ros.parameters import Topic
from executive.facts import Fact
from executive.ledger import Ledger
from executive.ports import Downlink, MotionRover, VelocityRover

Subscribe = Callable[[type, Topic, Callable[[Any], None]], None]
"""Subscribes: a message type, a topic, and what takes the messages."""


class RosAsset(Protocol):
    """A rover on ROS. Used on the executor's thread only.

    Attributes:
        on_frame: gets each compressed image while a frame is wanted; set before the first request.
    """

    on_frame: Callable[[CompressedImage], None]

    def listen(self, subscribe: Subscribe, observe: Callable[[Fact], None]) -> None:
        """Subscribe to what this kind of rover alone tells."""
        ...

    def downlinks(self, ledger: Ledger) -> Sequence[Downlink]:
        """Return what of this kind of rover is to hear reports."""
        ...

    def frame_taken(self) -> None:
        """Stop listening to the camera."""
        ...

    def stand(self) -> None:
        """Make the rover stand, if the executive moves it."""
        ...

    def flush(self, timeout_s: float) -> bool:
        """Wait until the last command has been received; return whether it was."""
        ...


class RosVelocityRover(RosAsset, VelocityRover, Protocol):
    """A rover on ROS that takes velocities."""


class RosMotionRover(RosAsset, MotionRover, Protocol):
    """A rover on ROS that carries out whole motions by itself."""
