"""A ROS rover behind the port `VelocityRover`: velocities, camera angles, frames on request."""

from collections.abc import Callable

from geometry_msgs.msg import Twist
from rclpy.duration import Duration
from rclpy.node import Node

from adapters.ros.asset import Subscribe
from adapters.ros.camera import RosCamera
from adapters.ros.parameters import Topics
from executive.facts import Fact
from executive.geometry import STANDING, Velocity
from executive.ports import Clock
from executive.settings import Settings


class RosRover(RosCamera):
    """Publishes what the arbiter decides. Used on the executor's thread only."""

    def __init__(self, node: Node, topics: Topics, clock: Clock, settings: Settings) -> None:
        """Make the publishers. Neither clock nor settings are looked at."""
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

    def flush(self, timeout_s: float) -> bool:
        """Wait until the last velocity has been received; return whether it was."""
        return self._velocity.wait_for_all_acked(Duration(seconds=timeout_s))
