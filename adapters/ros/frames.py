"""Camera frames over ROS, one on each request."""

from collections.abc import Callable, Sequence

from rclpy.node import Node
from rclpy.subscription import Subscription
from sensor_msgs.msg import CompressedImage

from adapters.ros.parameters import Topic
from executive.ledger import Ledger
from executive.ports import Downlink


class RosFrames:
    """A camera that costs nothing while no frame is wanted.

    The subscription is made for a request, and ends with the frame that answers it.

    Attributes:
        on_frame: gets each compressed image while a frame is wanted; set before the first request.
    """

    on_frame: Callable[[CompressedImage], None]

    def __init__(self, node: Node, image: Topic) -> None:
        """Listen to nothing yet."""
        self._node = node
        self._image = image
        self._frames: Subscription | None = None

    def downlinks(self, ledger: Ledger) -> Sequence[Downlink]:
        """Have nobody hear reports."""
        return ()

    def request_frame(self) -> None:
        """Listen to the camera until `frame_taken`."""
        if self._frames is None:
            self._frames = self._node.create_subscription(
                CompressedImage, self._image.name, self.on_frame, self._image.qos
            )

    def frame_taken(self) -> None:
        """Stop listening to the camera."""
        if self._frames is not None:
            self._node.destroy_subscription(self._frames)
            self._frames = None
