"""A bare rclpy node on the topics of the executive, to compare the executive with.

It does nothing with what it hears and sends zero velocity 20 times a second.
"""

from contextlib import suppress

import rclpy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import BatteryState
from std_msgs.msg import Float64

TICK_S = 0.05


class BareNode(Node):
    """Hears odometry, battery and camera angles, and sends velocities."""

    def __init__(self, namespace: str) -> None:
        """Make publishers, subscriptions and the timer."""
        super().__init__("bare", namespace=namespace)
        self._velocity = self.create_publisher(Twist, "cmd_vel", 1)
        for topic in ("camera/pan/command", "camera/tilt/command", "camera/speed/command"):
            self.create_publisher(Float64, topic, 1)
        for kind, topic in (
            (Odometry, "odom"),
            (BatteryState, "battery"),
            (Float64, "camera/pan/state"),
            (Float64, "camera/tilt/state"),
        ):
            self.create_subscription(kind, topic, self._ignore, rclpy.qos.qos_profile_sensor_data)
        self.create_timer(TICK_S, self._tick)

    def _ignore(self, _message: object) -> None:
        pass

    def _tick(self) -> None:
        self._velocity.publish(Twist())


def main() -> None:
    """Spin until a signal."""
    rclpy.init()
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(BareNode("jackal"))


if __name__ == "__main__":
    main()
