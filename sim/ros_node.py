"""The simulated rover on ROS topics, paced to real time. Runs on the thread that spins the node."""

import logging
from math import isfinite
from time import monotonic
from typing import Final, assert_never

from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry as OdometryMessage
from rclpy.clock import Clock as NodeClock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState
from std_msgs.msg import Float64

from adapters.ros.messages import battery_message, odometry_message
from adapters.ros.parameters import Topics, declare_rate
from executive.facts import (
    Battery,
    CameraAngles,
    Fact,
    ForeignPublishers,
    Frame,
    MotionEnded,
    Odometry,
)
from executive.geometry import Velocity
from sim.body import PERIOD_S
from sim.ros_camera import CameraNode
from sim.ros_messages import clock_message
from sim.rover import SimulatedRover

GREATEST_LAG_S: Final = 0.2
_LOG = logging.getLogger(__name__)


class SimulationNode:
    """Advances the rover with time, publishes what it measures, and takes its commands.

    Args:
        node: publishes and subscribes.
        topics: the names of what it speaks.
        rover: the simulation.
        camera: gets the states to render; None where there are no pictures.
        rate: simulated seconds per second.
    """

    def __init__(
        self,
        node: Node,
        topics: Topics,
        rover: SimulatedRover,
        camera: CameraNode | None,
        rate: float,
    ) -> None:
        """Start with the next spin."""
        self._rover = rover
        self._camera = camera
        self._frame_every = max(
            1, round(1 / (declare_rate(node, "camera_hz", "pictures") * PERIOD_S))
        )
        self._period_s = PERIOD_S / rate
        self._started_s = monotonic()
        self._periods = 0
        self._pan_rad = self._tilt_rad = 0.0
        make = node.create_publisher
        self._clock = make(Clock, "/clock", 1)
        self._odometry = make(OdometryMessage, topics.odometry.name, topics.odometry.qos)
        self._truth = make(OdometryMessage, topics.ground_truth.name, topics.ground_truth.qos)
        self._battery = make(BatteryState, topics.battery.name, topics.battery.qos)
        self._pan = make(Float64, topics.camera_pan_state.name, topics.camera_pan_state.qos)
        self._tilt = make(Float64, topics.camera_tilt_state.name, topics.camera_tilt_state.qos)
        for kind, topic, callback in (
            (Twist, topics.cmd_vel, self._on_velocity),
            (Float64, topics.camera_pan, self._on_pan),
            (Float64, topics.camera_tilt, self._on_tilt),
            (Float64, topics.camera_speed, self._on_camera_speed),
        ):
            node.create_subscription(kind, topic.name, callback, topic.qos)
        steady = NodeClock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(self._period_s, self._on_time, clock=steady)

    def _on_time(self) -> None:
        behind_s = monotonic() - self._started_s - self._periods * self._period_s
        if behind_s > GREATEST_LAG_S:
            _LOG.warning("slower than the rate asked for: %.2f s were lost", behind_s)
            self._started_s += behind_s
            behind_s = self._period_s
        for _ in range(round(behind_s / self._period_s)):
            self._advance()

    def _advance(self) -> None:
        self._rover.advance(PERIOD_S)
        self._periods += 1
        self._clock.publish(clock_message(self._rover.time_s))
        for fact in self._rover.facts():
            self._publish(fact)
        if self._truth.get_subscription_count():
            rover = self._rover
            self._truth.publish(
                odometry_message(Odometry(rover.time_s, rover.true_pose, rover.true_velocity))
            )
        if self._camera is not None and self._periods % self._frame_every == 0:
            self._camera.offer()

    def _publish(self, fact: Fact) -> None:
        match fact:
            case Odometry():
                self._odometry.publish(odometry_message(fact))
            case Battery():
                self._battery.publish(battery_message(fact, self._rover.time_s))
            case CameraAngles(pan_rad, tilt_rad):
                self._pan.publish(Float64(data=pan_rad))
                self._tilt.publish(Float64(data=tilt_rad))
            case Frame() | ForeignPublishers() | MotionEnded():
                raise TypeError(f"a simulated rover on ROS publishes no {type(fact).__name__}")
            case _:
                assert_never(fact)

    def _on_velocity(self, message: Twist) -> None:
        velocity = Velocity(message.linear.x, message.angular.z)
        if velocity.finite:
            self._rover.drive(velocity)
        else:
            _LOG.warning("velocity refused: %s", velocity)

    def _on_pan(self, message: Float64) -> None:
        if isfinite(message.data):
            self._pan_rad = message.data
            self._rover.point_camera(self._pan_rad, self._tilt_rad)

    def _on_tilt(self, message: Float64) -> None:
        if isfinite(message.data):
            self._tilt_rad = message.data
            self._rover.point_camera(self._pan_rad, self._tilt_rad)

    def _on_camera_speed(self, message: Float64) -> None:
        if isfinite(message.data):
            self._rover.set_camera_speed(message.data)
