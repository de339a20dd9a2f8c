"""The least that can turn MAL octets into a ROS message, to compare the executive with.

It cuts messages by their length, reads nothing else of them, and sends a zero velocity for each.
"""

import asyncio
import sys

import rclpy
from geometry_msgs.msg import Twist

LENGTH_OCTETS = 4


class Echo(asyncio.Protocol):
    """Publishes as soon as a whole message is there."""

    def __init__(self, publisher: "rclpy.publisher.Publisher") -> None:
        """Publish to this topic."""
        self._publisher = publisher
        self._twist = Twist()
        self._octets = b""

    def data_received(self, data: bytes) -> None:
        """Take octets in."""
        self._octets += data
        while len(self._octets) >= LENGTH_OCTETS:
            length = int.from_bytes(self._octets[:LENGTH_OCTETS], "big")
            if len(self._octets) < length:
                return
            self._octets = self._octets[length:]
            self._publisher.publish(self._twist)


async def serve() -> None:
    """Print the port and serve until killed."""
    node = rclpy.create_node("echo", namespace="echo")
    publisher = node.create_publisher(Twist, "cmd_vel", 1)
    loop = asyncio.get_running_loop()
    server = await loop.create_server(lambda: Echo(publisher), "127.0.0.1", 0)
    print(f"listens at {server.sockets[0].getsockname()[1]}", flush=True)
    await server.serve_forever()


if __name__ == "__main__":
    rclpy.init(args=sys.argv)
    asyncio.run(serve())
