"""What the node needs of a rover, and the rover that takes velocities on `cmd_vel`."""

from collections.abc import Callable, Sequence
from typing import Any, Protocol

from geometry_msgs.msg import Twist
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.subscription import Subscription
from sensor_msgs.msg import CompressedImage
from std_msgs.msg import Float64

from adapters.ros.parameters import Topic, Topics
from executive.clock import Clock
from executive.geometry import STANDING, Velocity
from executive.ports import CameraIntent, Downlink, MotionRover, VelocityRover
from executive.record import Ledger
from executive.settings import Settings
from executive.state import Fact

Subscribe = Callable[[type, Topic, Callable[[Any], None]], None]
"""Subscribes: a message type, a topic, and what takes the messages."""


class RosAsset(Protocol):
    """A rover on ROS. Used on the executor's thread, but for `emergency_stop`.

    Attributes:
        on_frame: gets each compressed image while a frame is wanted; set before the first request.
    """

    on_frame: Callable[[CompressedImage], None]

    def listen(self, subscribe: Subscribe, observe: Callable[[Fact], None]) -> None:
        """Subscribe to what this kind of rover alone tells."""

    def downlinks(self, ledger: Ledger) -> Sequence[Downlink]:
        """Return what of this kind of rover is to hear reports."""

    def frame_taken(self) -> None:
        """Stop listening to the camera."""

    def stand(self) -> None:
        """Make the rover stand, if the executive moves it."""

    def flush(self, timeout_s: float) -> bool:
        """Wait until the last command has been received; return whether it was."""


class RosVelocityRover(RosAsset, VelocityRover, Protocol):
    """A rover on ROS that takes velocities."""


class RosMotionRover(RosAsset, MotionRover, Protocol):
    """A rover on ROS that carries out whole motions by itself."""


class RosFrames:
    """A camera that costs nothing while no frame is wanted.

    The subscription is made for a request, and ends with the frame that answers it.

    Attributes:
        on_frame: gets each compressed image while a frame is wanted; set before the first request.
    """

    on_frame: Callable[[CompressedImage], None]

    def __init__(self, node: Node, image: Topic) -> None:
        self._node = node
        self._image = image
        self._frames: Subscription | None = None

    def downlinks(self, ledger: Ledger) -> Sequence[Downlink]:
        """Return none: no part of this rover needs reports."""
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


class RosCamera(RosFrames):
    """Publishes where the camera is to point, and takes frames on request."""

    def __init__(self, node: Node, topics: Topics) -> None:
        super().__init__(node, topics.camera_compressed)
        pan, tilt, speed = topics.camera_pan, topics.camera_tilt, topics.camera_speed
        self._pan = node.create_publisher(Float64, pan.name, pan.qos)
        self._tilt = node.create_publisher(Float64, tilt.name, tilt.qos)
        self._speed = node.create_publisher(Float64, speed.name, speed.qos)

    def point_camera(self, wanted: CameraIntent) -> None:
        """Publish the camera's greatest speed and its angles."""
        self._speed.publish(Float64(data=wanted.speed_radps))
        self._pan.publish(Float64(data=wanted.pan_rad))
        self._tilt.publish(Float64(data=wanted.tilt_rad))


class RosRover(RosCamera):
    """Publishes what the arbiter decides. Used on the executor's thread, but for one method."""

    def __init__(self, node: Node, topics: Topics, clock: Clock, settings: Settings) -> None:
        super().__init__(node, topics)
        self._velocity = node.create_publisher(Twist, topics.cmd_vel.name, topics.cmd_vel.qos)
        self._twist = Twist()

    def listen(self, subscribe: Subscribe, observe: Callable[[Fact], None]) -> None:
        """Hear nothing but what every rover tells."""

    def drive(self, velocity: Velocity) -> None:
        """Publish a velocity."""
        self._twist.linear.x = velocity.travel_mps
        self._twist.angular.z = velocity.rotate_radps
        self._velocity.publish(self._twist)

    def stand(self) -> None:
        """Publish zero."""
        self.drive(STANDING)

    def emergency_stop(self) -> None:
        """Publish zero, from any thread: publishers of rclpy may be shared."""
        self._velocity.publish(Twist())

    def flush(self, timeout_s: float) -> bool:
        """Wait until the last velocity has been received; return whether it was."""
        return self._velocity.wait_for_all_acked(Duration(seconds=timeout_s))
