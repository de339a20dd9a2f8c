"""A ROS rover behind the port `Rover`: velocities, camera angles, and frames on request."""

from collections.abc import Callable

from geometry_msgs.msg import Twist
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.subscription import Subscription
from sensor_msgs.msg import CompressedImage
from std_msgs.msg import Float64

from adapters.ros.parameters import Topics
from executive.geometry import Velocity


class RosRover:
    """Publishes what the arbiter decides. Used on the executor's thread only.

    A camera costs nothing while no frame is wanted: the subscription is made for a request, and
    ends with the frame that answers it.

    Attributes:
        on_frame: gets each compressed image while a frame is wanted; set before the first request.
    """

    on_frame: Callable[[CompressedImage], None]

    def __init__(self, node: Node, topics: Topics) -> None:
        """Make the publishers."""
        self._node = node
        self._image = topics.camera_compressed
        cmd_vel, pan, tilt, speed = (
            topics.cmd_vel,
            topics.camera_pan,
            topics.camera_tilt,
            topics.camera_speed,
        )
        self._velocity = node.create_publisher(Twist, cmd_vel.name, cmd_vel.qos)
        self._pan = node.create_publisher(Float64, pan.name, pan.qos)
        self._tilt = node.create_publisher(Float64, tilt.name, tilt.qos)
        self._speed = node.create_publisher(Float64, speed.name, speed.qos)
        self._twist = Twist()
        self._frames: Subscription | None = None

    def drive(self, velocity: Velocity) -> None:
        """Publish a velocity."""
        self._twist.linear.x = velocity.travel_mps
        self._twist.angular.z = velocity.rotate_radps
        self._velocity.publish(self._twist)

    def point_camera(self, pan_rad: float, tilt_rad: float) -> None:
        """Publish the camera's angles."""
        self._pan.publish(Float64(data=pan_rad))
        self._tilt.publish(Float64(data=tilt_rad))

    def set_camera_speed(self, speed_radps: float) -> None:
        """Publish the camera's greatest speed."""
        self._speed.publish(Float64(data=speed_radps))

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

    def flush(self, timeout_s: float) -> bool:
        """Wait until the last velocity has been received; return whether it was."""
        return self._velocity.wait_for_all_acked(Duration(seconds=timeout_s))
