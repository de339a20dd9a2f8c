"""Robot model for ROS tools: the rover's frames, and a small URDF made from its settings.

On a robot its own robot_state_publisher publishes them. Here the simulation and bags do, and the
executive if the parameter `robot_model` is set.

    odom ─ base_link ─ camera_pan_link ─ camera_link ─ camera_optical

The settings do not have the camera's position on the rover: its frames are at base_link's origin.
"""

import logging
from collections.abc import Sequence
from math import pi
from typing import Final
from xml.etree import ElementTree as Xml

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

from adapters.ros.conversions import BASE_LINK, ODOM, quaternion, time_message
from adapters.ros.parameters import NO_TF2_MSGS, TF_MESSAGE
from executive.settings import Settings
from executive.values.facts import CameraAngles, Odometry
from executive.values.geometry import Pose

CAMERA_PAN: Final = "camera_pan_link"
CAMERA_LINK: Final = "camera_link"
CAMERA_OPTICAL: Final = "camera_optical"
"""Frame of pictures: z forward, x to the right (REP 103)."""
ROBOT_DESCRIPTION: Final = "robot_description"
TF: Final = "/tf"
TF_STATIC: Final = "/tf_static"
_OPTICAL: Final = Pose(roll_rad=-pi / 2, heading_rad=-pi / 2)
_BODY_M: Final = 0.15
"""Height of the drawn body; its length and width are in the settings. Chosen, not measured."""
_CAMERA_M: Final = 0.06
_WHEEL_M: Final = 0.04
_LOG: Final = logging.getLogger(__name__)


def latched_qos(depth: int = 1) -> QoSProfile:
    """Return the quality of service of latched topics."""
    return QoSProfile(depth=depth, durability=DurabilityPolicy.TRANSIENT_LOCAL)  # type: ignore[no-untyped-call]


def base_transform(fact: Odometry) -> TransformStamped:
    """Return the transform of base_link in the odometry frame."""
    return _transform(fact.stamp_s, ODOM, BASE_LINK, fact.pose)


def camera_transforms(fact: CameraAngles, time_s: float) -> list[TransformStamped]:
    """Return the transforms of the camera's pan and tilt on the rover."""
    pan, tilt = Pose(heading_rad=fact.pan_rad), Pose(pitch_rad=-fact.tilt_rad)
    return [
        _transform(time_s, BASE_LINK, CAMERA_PAN, pan),
        _transform(time_s, CAMERA_PAN, CAMERA_LINK, tilt),
    ]


def static_transforms(time_s: float) -> list[TransformStamped]:
    """Return the static transforms."""
    return [_transform(time_s, CAMERA_LINK, CAMERA_OPTICAL, _OPTICAL)]


def _transform(time_s: float, parent: str, child: str, pose: Pose) -> TransformStamped:
    message = TransformStamped(child_frame_id=child)
    message.header.stamp = time_message(time_s)
    message.header.frame_id = parent
    position = message.transform.translation
    position.x, position.y, position.z = pose.x_m, pose.y_m, pose.z_m
    message.transform.rotation = quaternion(pose)
    return message


def urdf(settings: Settings) -> str:
    """Return a URDF: the footprint as a box, wheels if their radius is known, the camera."""
    robot = Xml.Element("robot", name=settings.asset)
    base = Xml.SubElement(robot, "link", name=BASE_LINK)
    joints, footprint = settings.sensors.joints, settings.footprint
    wheel_m = 0.0 if joints is None else joints.wheel_radius_m
    if footprint is not None:
        size_m = (footprint.length_m, footprint.width_m, _BODY_M)
        _box(base, size_m, wheel_m + _BODY_M / 2)
        if wheel_m:
            ahead_m, aside_m = footprint.length_m / 2 - wheel_m, footprint.width_m / 2
            for x_m in (ahead_m, -ahead_m):
                for y_m in (aside_m, -aside_m):
                    _wheel(base, x_m, y_m, wheel_m)
    camera = settings.camera
    _box(Xml.SubElement(robot, "link", name=CAMERA_PAN), (_CAMERA_M / 2,) * 3)
    _box(Xml.SubElement(robot, "link", name=CAMERA_LINK), (_CAMERA_M,) * 3)
    Xml.SubElement(robot, "link", name=CAMERA_OPTICAL)
    pan = _joint(robot, "camera_pan", "revolute", BASE_LINK, CAMERA_PAN)
    _add_axis(pan, "0 0 1", camera.pan_min_rad, camera.pan_max_rad, camera.rotate_speed_radps)
    tilt = _joint(robot, "camera_tilt", "revolute", CAMERA_PAN, CAMERA_LINK)
    _add_axis(tilt, "0 -1 0", camera.tilt_min_rad, camera.tilt_max_rad, camera.rotate_speed_radps)
    optical = _joint(robot, "camera_optical", "fixed", CAMERA_LINK, CAMERA_OPTICAL)
    Xml.SubElement(optical, "origin", rpy=f"{_OPTICAL.roll_rad} 0 {_OPTICAL.heading_rad}")
    Xml.indent(robot)
    return Xml.tostring(robot, encoding="unicode", xml_declaration=True)


def _box(link: Xml.Element, size_m: Sequence[float], z_m: float = 0.0) -> None:
    visual = Xml.SubElement(link, "visual")
    Xml.SubElement(visual, "origin", xyz=f"0 0 {z_m:g}")
    geometry = Xml.SubElement(visual, "geometry")
    Xml.SubElement(geometry, "box", size=" ".join(f"{each:g}" for each in size_m))


def _wheel(link: Xml.Element, x_m: float, y_m: float, radius_m: float) -> None:
    visual = Xml.SubElement(link, "visual")
    Xml.SubElement(visual, "origin", xyz=f"{x_m:g} {y_m:g} {radius_m:g}", rpy=f"{pi / 2} 0 0")
    geometry = Xml.SubElement(visual, "geometry")
    Xml.SubElement(geometry, "cylinder", radius=f"{radius_m:g}", length=f"{_WHEEL_M:g}")


def _joint(robot: Xml.Element, name: str, kind: str, parent: str, child: str) -> Xml.Element:
    joint = Xml.SubElement(robot, "joint", name=name, type=kind)
    Xml.SubElement(joint, "parent", link=parent)
    Xml.SubElement(joint, "child", link=child)
    return joint


def _add_axis(
    joint: Xml.Element, axis: str, least_rad: float, max_rad: float, speed_radps: float
) -> None:
    Xml.SubElement(joint, "axis", xyz=axis)
    lower, upper, velocity = (f"{each:g}" for each in (least_rad, max_rad, speed_radps))
    Xml.SubElement(joint, "limit", lower=lower, upper=upper, velocity=velocity, effort="1")


class RobotModelPublisher:
    """Publishes `robot_description`, and the frames if ROS has tf2_msgs.

    The wheels of PyPI have none; that is logged, and nothing is published on `/tf`.
    """

    def __init__(self, node: Node, settings: Settings) -> None:
        self._urdf_publisher = node.create_publisher(String, ROBOT_DESCRIPTION, latched_qos())
        self._urdf_publisher.publish(String(data=urdf(settings)))
        if TF_MESSAGE is None:
            _LOG.info("no /tf and /tf_static: %s", NO_TF2_MSGS)
            return
        self._frames = node.create_publisher(TF_MESSAGE, TF, 100)
        self._still = node.create_publisher(TF_MESSAGE, TF_STATIC, latched_qos())
        self._still.publish(TF_MESSAGE(transforms=static_transforms(0.0)))

    def publish_transforms(self, transforms: list[TransformStamped]) -> None:
        """Publish frames that moved."""
        if TF_MESSAGE is not None:
            self._frames.publish(TF_MESSAGE(transforms=transforms))
