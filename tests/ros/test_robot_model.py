"""Frames and the URDF of a rover agree with each other and with its settings."""

from dataclasses import replace
from math import cos, sin
from xml.etree import ElementTree as Xml

import pytest
import yaml
from geometry_msgs.msg import Quaternion, TransformStamped

from adapters.ros.conversions import ODOM
from adapters.ros.robot_model import (
    ROBOT_DESCRIPTION,
    base_transform,
    camera_transforms,
    static_transforms,
    urdf,
)
from executive.settings import config_folder, load_settings
from executive.values.facts import CameraAngles, Odometry
from executive.values.geometry import Pose, Velocity

pytestmark = pytest.mark.ros
JACKAL = load_settings("jackal")


def turned(rotation: Quaternion, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return a vector turned by a rotation."""
    a, b, c, d = rotation.w, rotation.x, rotation.y, rotation.z
    return (
        (1 - 2 * (c * c + d * d)) * x + 2 * (b * c - a * d) * y + 2 * (b * d + a * c) * z,
        2 * (b * c + a * d) * x + (1 - 2 * (b * b + d * d)) * y + 2 * (c * d - a * b) * z,
        2 * (b * d - a * c) * x + 2 * (c * d + a * b) * y + (1 - 2 * (b * b + c * c)) * z,
    )


def all_transforms(angles: CameraAngles) -> list[TransformStamped]:
    odometry = Odometry(7.5, Pose(1.0, 2.0, heading_rad=0.5), Velocity())
    return [base_transform(odometry), *camera_transforms(angles, 7.5), *static_transforms(0.0)]


def test_the_camera_points_in_its_direction() -> None:
    pan_rad, tilt_rad = 0.7, 0.3
    _, *camera = all_transforms(CameraAngles(pan_rad, tilt_rad))
    ahead = (0.0, 0.0, 1.0)  # of an optical frame
    for each in reversed(camera):
        ahead = turned(each.transform.rotation, *ahead)
    up = sin(tilt_rad)
    assert ahead == pytest.approx((cos(tilt_rad) * cos(pan_rad), cos(tilt_rad) * sin(pan_rad), up))


def test_the_frames_are_one_chain_and_the_urdf_has_the_same() -> None:
    transforms = all_transforms(CameraAngles(0.0, 0.0))
    chain = [(each.header.frame_id, each.child_frame_id) for each in transforms]
    assert chain[0] == ("odom", "base_link")
    assert [child for _, child in chain[:-1]] == [parent for parent, _ in chain[1:]]
    robot = Xml.fromstring(urdf(JACKAL))
    joints = [
        (joint.find("parent").attrib["link"], joint.find("child").attrib["link"])  # type: ignore[union-attr]
        for joint in robot.iter("joint")
    ]
    assert joints == chain[1:]
    assert [link.attrib["name"] for link in robot.iter("link")] == [
        "base_link", *(child for _, child in joints)
    ]  # fmt: skip


def test_the_urdf_is_made_of_the_settings() -> None:
    robot = Xml.fromstring(urdf(JACKAL))
    assert robot.attrib["name"] == "jackal"
    box, *_ = robot.iter("box")
    assert box.attrib["size"] == "0.51 0.43 0.15"
    wheels = list(robot.iter("cylinder"))
    assert [wheel.attrib["radius"] for wheel in wheels] == ["0.098"] * 4
    (pan, _) = robot.iter("limit")
    assert (pan.attrib["lower"], pan.attrib["upper"]) == ("-2.8", "2.8")


def test_a_rover_of_unknown_size_has_frames_all_the_same() -> None:
    bare = replace(JACKAL, footprint=None, sensors=replace(JACKAL.sensors, joints=None))
    robot = Xml.fromstring(urdf(bare))
    assert not list(robot.iter("cylinder"))
    assert len(list(robot.iter("joint"))) == 3


def test_rviz_uses_existing_topics() -> None:
    folder = config_folder()
    shown = yaml.safe_load((folder / "rover.rviz").read_text(encoding="utf-8"))
    parameters = yaml.safe_load((folder / "jackal.ros.yaml").read_text(encoding="utf-8"))
    declared = parameters["/**"]["ros__parameters"].values()
    known = {f"/jackal/{each['topic']}": each for each in declared if isinstance(each, dict)}
    manager = shown["Visualization Manager"]
    topics = [each["Topic"] for each in manager["Displays"] if "Topic" in each]
    assert {each["Value"] for each in topics} <= known.keys()
    for each in topics:
        reliability = known[each["Value"]]["reliability"].replace("_", " ").title()
        assert each["Reliability Policy"] == reliability, each
    (model,) = (each for each in manager["Displays"] if "Description Topic" in each)
    assert model["Description Topic"]["Value"] == f"/jackal/{ROBOT_DESCRIPTION}"
    assert manager["Global Options"]["Fixed Frame"] == ODOM
    (goal,) = (each["Topic"] for each in manager["Tools"] if "Topic" in each)
    assert goal["Value"] == "/jackal/executive/goal_pose"  # Nav2 subscribes to goal_pose itself
