"""The least that ROS takes, to compare the executive with: `python -m tests.benchmarks.bare_ros`.

`node` is on the topics of the executive, does nothing with what it hears, and sends zero velocity
20 times a second. `echo` turns MAL octets into a ROS message: it cuts messages by their length,
reads nothing else of them, and sends a zero velocity for each.
"""

import asyncio
import sys
from contextlib import suppress

import rclpy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException
from sensor_msgs.msg import BatteryState, Imu, JointState, LaserScan
from std_msgs.msg import Float64

TICK_S = 0.05
LENGTH_OCTETS = 4


def spin_node() -> None:
    """Hear odometry, battery, camera angles and sensors, and send velocities, until a signal."""
    node = rclpy.create_node("bare", namespace="jackal")
    # Under another name: the rover obeys the executive.
    velocity = node.create_publisher(Twist, "bare_cmd_vel", 1)
    for topic in ("camera/pan/command", "camera/tilt/command", "camera/speed/command"):
        node.create_publisher(Float64, topic, 1)
    for kind, topic in (
        (Odometry, "platform/odom/filtered"),
        (BatteryState, "platform/bms/state"),
        (Float64, "camera/pan/state"),
        (Float64, "camera/tilt/state"),
        (Imu, "sensors/imu_0/data"),
        (JointState, "platform/joint_states"),
        (Odometry, "visual_odometry"),
        (LaserScan, "sensors/lidar2d_0/scan"),
    ):
        qos = rclpy.qos.qos_profile_sensor_data
        node.create_subscription(kind, topic, lambda _: None, qos)
    node.create_timer(TICK_S, lambda: velocity.publish(Twist()))
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)


class Echo(asyncio.Protocol):
    """Publishes as soon as a whole message is there."""

    def __init__(self, publisher: "rclpy.publisher.Publisher") -> None:
        self._publisher = publisher
        self._twist = Twist()
        self._octets = b""

    def data_received(self, data: bytes) -> None:
        self._octets += data
        while len(self._octets) >= LENGTH_OCTETS:
            length = int.from_bytes(self._octets[:LENGTH_OCTETS], "big")
            if len(self._octets) < length:
                return
            self._octets = self._octets[length:]
            self._publisher.publish(self._twist)


async def serve_echo() -> None:
    node = rclpy.create_node("echo", namespace="echo")
    publisher = node.create_publisher(Twist, "cmd_vel", 1)
    loop = asyncio.get_running_loop()
    server = await loop.create_server(lambda: Echo(publisher), "127.0.0.1", 0)
    print(f"listens at {server.sockets[0].getsockname()[1]}", flush=True)
    await server.serve_forever()


if __name__ == "__main__":
    rclpy.init()
    if sys.argv[1] == "echo":
        asyncio.run(serve_echo())
    else:
        spin_node()
