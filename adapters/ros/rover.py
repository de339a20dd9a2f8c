"""A ROS rover behind the port `VelocityRover`: velocities, camera angles, frames on request."""

from collections.abc import Callable

from geometry_msgs.msg import Twist
from rclpy.duration import Duration
from rclpy.node import Node
from std_msgs.msg import Float64

from adapters.ros.asset import Subscribe
from adapters.ros.frames import RosFrames
from adapters.ros.parameters import Topics
from executive.facts import Fact
from executive.geometry import STANDING, Velocity


class RosRover(RosFrames):
    """Publishes what the arbiter decides. Used on the executor's thread only."""

    def __init__(self, node: Node, topics: Topics) -> None:
        """Make the publishers."""
        super().__init__(node, topics.camera_compressed)
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

    def listen(self, subscribe: Subscribe, observe: Callable[[Fact], None]) -> None:
        """Hear nothing but what every rover tells."""

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

    def stand(self) -> None:
        """Publish zero."""
        self.drive(STANDING)

    def flush(self, timeout_s: float) -> bool:
        """Wait until the last velocity has been received; return whether it was."""
        return self._velocity.wait_for_all_acked(Duration(seconds=timeout_s))
