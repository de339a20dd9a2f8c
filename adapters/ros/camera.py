"""A pan/tilt camera on the topics that every asset has."""

from rclpy.node import Node
from std_msgs.msg import Float64

from adapters.ros.frames import RosFrames
from adapters.ros.parameters import Topics
from executive.intents import CameraIntent


class RosCamera(RosFrames):
    """Publishes where the camera is to point, and takes frames on request."""

    def __init__(self, node: Node, topics: Topics) -> None:
        """Make the publishers."""
        super().__init__(node, topics.camera_compressed)
        pan, tilt, speed = topics.camera_pan, topics.camera_tilt, topics.camera_speed
        self._pan = node.create_publisher(Float64, pan.name, pan.qos)
        self._tilt = node.create_publisher(Float64, tilt.name, tilt.qos)
        self._speed = node.create_publisher(Float64, speed.name, speed.qos)

    def point_camera(self, wanted: CameraIntent) -> None:
        """Publish the camera's greatest speed and its angles."""
        self._speed.publish(Float64(data=wanted.speed_radps))
        self._pan.publish(Float64(data=wanted.pan_rad))
        self._tilt.publish(Float64(data=wanted.tilt_rad))
