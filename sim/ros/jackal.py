"""What a simulated Jackal says and obeys on ROS topics."""

import logging
from dataclasses import replace
from math import isfinite
from typing import Final, assert_never

from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry as OdometryMessage
from rclpy.node import Node
from sensor_msgs.msg import BatteryState
from std_msgs.msg import Float64

from adapters.ros import Topics, battery_message, odometry_message
from executive.geometry import Velocity
from executive.ports import CameraIntent
from executive.state import (
    Battery,
    CameraAngles,
    CommandEnded,
    CommandUnderWay,
    Fact,
    ForeignPublishers,
    Frame,
    MotionEnded,
    Odometry,
    Stopped,
)
from sim.rover.jackal import SimulatedJackal

CAMERA_SPEED_RADPS: Final = 0.5
"""Of a camera that was told none yet."""
_LOG: Final = logging.getLogger(__name__)


class JackalOnRos:
    """Publishes what the rover measures, and takes its commands."""

    def __init__(self, node: Node, topics: Topics, rover: SimulatedJackal) -> None:
        self._rover = rover
        self._camera = CameraIntent(0.0, 0.0, CAMERA_SPEED_RADPS)
        make = node.create_publisher
        self._odometry = make(OdometryMessage, topics.odometry.name, topics.odometry.qos)
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

    def exchange(self) -> None:
        """Publish what was measured since the last call."""
        for fact in self._rover.facts():
            self._publish(fact)

    def close(self) -> None:
        """Leave it to the node."""

    def _publish(self, fact: Fact) -> None:
        match fact:
            case Odometry():
                self._odometry.publish(odometry_message(fact))
            case Battery():
                self._battery.publish(battery_message(fact, self._rover.time_s))
            case CameraAngles(pan_rad, tilt_rad):
                self._pan.publish(Float64(data=pan_rad))
                self._tilt.publish(Float64(data=tilt_rad))
            case (
                Frame()
                | ForeignPublishers()
                | MotionEnded()
                | CommandEnded()
                | CommandUnderWay()
                | Stopped()
            ):
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
            self._point(replace(self._camera, pan_rad=message.data))

    def _on_tilt(self, message: Float64) -> None:
        if isfinite(message.data):
            self._point(replace(self._camera, tilt_rad=message.data))

    def _on_camera_speed(self, message: Float64) -> None:
        if isfinite(message.data):
            self._point(replace(self._camera, speed_radps=message.data))

    def _point(self, camera: CameraIntent) -> None:
        self._camera = camera
        self._rover.point_camera(camera)
