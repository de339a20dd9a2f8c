"""The simulated rover on ROS topics, paced to real time. Runs on the thread that spins the node."""

import logging
from time import monotonic
from typing import Final, Protocol

from nav_msgs.msg import Odometry as OdometryMessage
from rclpy.clock import Clock as NodeClock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rosgraph_msgs.msg import Clock

from adapters.ros import Topics, declare_rate, odometry_message
from executive.state import Odometry
from sim.ros.camera import CameraNode, clock_message
from sim.rover.body import PERIOD_S, SimulatedBody

GREATEST_LAG_PERIODS: Final = 10
"""Caught up at once at most: no command arrives meanwhile, and a base stops after 0.25 s."""
_LOG: Final = logging.getLogger(__name__)


class Exchange(Protocol):
    """How a rover is commanded, and says what it measures."""

    def exchange(self) -> None:
        """Carry what waits, both ways; called once a period."""
        ...

    def close(self) -> None:
        """End."""
        ...


class SimulationNode:
    """Advances the rover with time, has it exchange, and says what only a simulation knows."""

    def __init__(
        self,
        node: Node,
        topics: Topics,
        rover: SimulatedBody,
        exchange: Exchange,
        camera: CameraNode | None,
        speed: float,
    ) -> None:
        self._rover = rover
        self._exchange = exchange
        self._camera = camera
        self._frame_every = max(
            1, round(1 / (declare_rate(node, "camera_hz", "pictures") * PERIOD_S))
        )
        self._period_s = PERIOD_S / speed
        self._started_s = monotonic()
        self._periods = 0
        self._clock = node.create_publisher(Clock, "/clock", 1)
        self._truth = node.create_publisher(
            OdometryMessage, topics.ground_truth.name, topics.ground_truth.qos
        )
        steady = NodeClock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(self._period_s, self._on_time, clock=steady)

    def _on_time(self) -> None:
        behind_s = monotonic() - self._started_s - self._periods * self._period_s
        if behind_s > GREATEST_LAG_PERIODS * self._period_s:
            _LOG.warning("slower than the speed asked for: %.2f s were lost", behind_s)
            self._started_s += behind_s
            behind_s = self._period_s
        for _ in range(round(behind_s / self._period_s)):
            self._advance()

    def _advance(self) -> None:
        self._rover.advance(PERIOD_S)
        self._periods += 1
        self._clock.publish(clock_message(self._rover.time_s))
        self._exchange.exchange()
        if self._truth.get_subscription_count():
            rover = self._rover
            self._truth.publish(
                odometry_message(Odometry(rover.time_s, rover.true_pose, rover.true_velocity))
            )
        if self._camera is not None and self._periods % self._frame_every == 0:
            self._camera.offer()
