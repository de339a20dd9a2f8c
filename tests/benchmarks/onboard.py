"""MRS commands as octets on a plain socket, so that nothing of a client is measured."""

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from math import cos, sin

from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data

from adapters.mal import Codec, Header, Stage, encode_message
from adapters.mrs.spec.headers import header_of
from adapters.mrs.spec.requests import invocation
from adapters.mrs.spec.specification import mrs_specification
from adapters.ros import ros_node, single_threaded
from executive.commands import Command, Request
from executive.reports import Identity

_NUMBERS = count(1)


class Octets:
    """A connection to a port of this machine."""

    def __init__(self, port: int) -> None:
        """Connect, without delay of small messages."""
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=10.0)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._to = f"maltcp://127.0.0.1:{port}/MRS"

    def close(self) -> None:
        """Hang up."""
        self._socket.close()

    def message(self, request: Request) -> bytes:
        """Return the octets of a new command."""
        number = next(_NUMBERS)
        command = Command(Identity("bench", number), request, "direct", report_started=False)
        call = invocation(request)
        specification = mrs_specification()
        operation = specification.operation(call.service, call.operation)
        body = Codec(specification).encode(
            operation.parts[Stage.SUBMIT], (header_of(command), *call.parts)
        )
        from_uri = "maltcp://127.0.0.1:1/bench"
        return encode_message(Header.of(operation, Stage.SUBMIT, number, from_uri, self._to), body)

    def send(self, message: bytes) -> None:
        """Send octets."""
        self._socket.sendall(message)

    def reply(self) -> None:
        """Wait for one message and throw it away."""
        length = int.from_bytes(self._exactly(4), "big")
        self._exactly(length - 4)

    def _exactly(self, count: int) -> bytes:
        found = b""
        while len(found) < count:
            piece = self._socket.recv(count - len(found))
            if not piece:
                raise ConnectionError("the executive hung up")
            found += piece
        return found


ODOMETRY_S = 0.02


class StandIn:
    """Moves exactly as told on `/jackal/cmd_vel`, and listens to `/echo/cmd_vel` too.

    Attributes:
        moving: set while the last velocity on `/jackal/cmd_vel` was not zero.
    """

    def __init__(self, node: Node) -> None:
        """Publish odometry at 50 Hz."""
        self.moving = threading.Event()
        self._zero_at_s = {"jackal": 0.0, "echo": 0.0}
        self._zero = {"jackal": threading.Event(), "echo": threading.Event()}
        self._twist = Twist()
        self._x_m = self._y_m = self._heading_rad = 0.0
        self._clock = node.get_clock()
        self._odometry = node.create_publisher(Odometry, "odom", qos_profile_sensor_data)
        node.create_subscription(Twist, "cmd_vel", self._drive, 1)
        node.create_subscription(Twist, "/echo/cmd_vel", self._echo, 1)
        node.create_timer(ODOMETRY_S, self._publish)

    def expect_zero(self, name: str) -> None:
        """Forget the zeros that have come so far."""
        self._zero[name].clear()

    def zero_came(self, name: str, timeout_s: float) -> bool:
        """Wait for a zero velocity; return whether it came."""
        return self._zero[name].wait(timeout_s)

    def wait_zero(self, name: str, timeout_s: float) -> float:
        """Wait for a zero velocity, and return when it came, by `time.perf_counter`.

        Raises:
            TimeoutError: none came.
        """
        if not self.zero_came(name, timeout_s):
            raise TimeoutError(f"no zero velocity from {name} within {timeout_s} s")
        return self._zero_at_s[name]

    def _drive(self, twist: Twist) -> None:
        now_s = time.perf_counter()
        self._twist = twist
        if twist.linear.x == 0.0 and twist.angular.z == 0.0:
            if not self._zero["jackal"].is_set():
                self._zero_at_s["jackal"] = now_s
                self._zero["jackal"].set()
            self.moving.clear()
        else:
            self.moving.set()

    def _echo(self, _: Twist) -> None:
        self._zero_at_s["echo"] = time.perf_counter()
        self._zero["echo"].set()

    def _publish(self) -> None:
        travel, rotate = self._twist.linear.x, self._twist.angular.z
        self._heading_rad += rotate * ODOMETRY_S
        self._x_m += travel * ODOMETRY_S * cos(self._heading_rad)
        self._y_m += travel * ODOMETRY_S * sin(self._heading_rad)
        message = Odometry()
        message.header.stamp = self._clock.now().to_msg()
        message.header.frame_id, message.child_frame_id = "odom", "base_link"
        message.pose.pose.position.x, message.pose.pose.position.y = self._x_m, self._y_m
        message.pose.pose.orientation.z = sin(self._heading_rad / 2)
        message.pose.pose.orientation.w = cos(self._heading_rad / 2)
        message.twist.twist = self._twist
        self._odometry.publish(message)


@contextmanager
def stand_in(domain: int) -> Iterator[StandIn]:
    """Yield a stand-in that moves in a ROS domain until the `with` ends."""
    ended = threading.Event()
    with (
        ros_node("stand_in", "jackal", domain_id=domain) as node,
        single_threaded(node) as executor,
    ):
        rover = StandIn(node)

        def spin() -> None:
            while not ended.is_set():
                executor.spin_once(timeout_sec=0.1)

        thread = threading.Thread(target=spin)
        thread.start()
        try:
            yield rover
        finally:
            ended.set()
            thread.join()
