"""A recording as a rosbag2 folder is read by the tools of ROS."""

import json
from pathlib import Path
from typing import Any, Final

import pytest
from click.testing import CliRunner, Result
from mcap.reader import make_reader
from nav_msgs.msg import Odometry as OdometryMessage
from rclpy.serialization import deserialize_message
from rosbags.highlevel import AnyReader

from adapters.cli.bag import bag
from adapters.recording import frames
from adapters.ros import odometry_fact

ODOMETRY: Final = "/jackal/platform/odom/filtered"
pytestmark = [pytest.mark.ros, pytest.mark.usefixtures("ros_domain")]


def typed(*arguments: object) -> Result:
    return CliRunner().invoke(bag, list(map(str, arguments)), catch_exceptions=False)


def test_a_bag_holds_what_such_a_rover_has_on_ros(stuck: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run_bag"
    reported = typed(stuck, folder)
    assert reported.exit_code == 0, reported.output
    tables = frames(stuck)
    with AnyReader([folder]) as reader:
        topics = {each.topic: each for each in reader.connections}
        counts = {topic: each.msgcount for topic, each in topics.items()}
        assert f"{counts[ODOMETRY]:7}  {ODOMETRY}" in reported.output
        assert counts[ODOMETRY] == len(tables["/in/odometry"])
        of_camera = counts["/tf"] - counts[ODOMETRY]
        assert len(tables["/in/camera_angles"]) - of_camera in (0, 1)  # one before any odometry
        assert counts["/jackal/sensors/imu_0/data"] == len(tables["/in/imu"])
        assert counts["/jackal/executive/cmd_vel"] == len(tables["/out/velocity_commanded"])
        assert counts["/rosout"] == len(tables["/out/report_sent"])
        assert topics["/jackal/platform/joint_states"].msgtype == "sensor_msgs/msg/JointState"
        first = next(reader.messages([topics["/tf"]]))
        moved: Any = reader.deserialize(first[2], "tf2_msgs/msg/TFMessage")
        (transform,) = moved.transforms
        assert (transform.header.frame_id, transform.child_frame_id) == ("odom", "base_link")
        ((_, _, octets),) = reader.messages([topics["/tf_static"]])
        still: Any = reader.deserialize(octets, "tf2_msgs/msg/TFMessage")
        assert [each.child_frame_id for each in still.transforms] == ["camera_optical"]
        ((_, _, octets),) = reader.messages([topics["/jackal/robot_description"]])
        described: Any = reader.deserialize(octets, "std_msgs/msg/String")
        assert '<robot name="jackal">' in described.data
        for topic in ("/tf_static", "/jackal/robot_description", "/jackal/executive/tree"):
            extension: Any = topics[topic].ext
            (qos,) = extension.offered_qos_profiles
            assert qos.durability.name == "TRANSIENT_LOCAL"
        *_, last = reader.messages([topics["/jackal/executive/tree"]])
        tree_message: Any = reader.deserialize(last[2], "std_msgs/msg/String")
        tree = json.loads(tree_message.data)
        assert tree["nodes"][0]["name"] == "rover"


def test_messages_read_by_ros_are_those_recorded(stuck: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run_bag"
    assert typed(stuck, folder).exit_code == 0
    odometry = frames(stuck)["/in/odometry"]
    with next(folder.glob("*.mcap")).open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        facts = [
            odometry_fact(deserialize_message(message.data, OdometryMessage))
            for _, _, message in reader.iter_messages([ODOMETRY])
        ]
    for column, reported in (
        ("pose.x_m", [fact.pose.x_m for fact in facts]),
        ("pose.heading_rad", [fact.pose.heading_rad for fact in facts]),
        ("velocity.travel_mps", [fact.velocity.travel_mps for fact in facts]),
    ):
        assert reported == pytest.approx(odometry[column].to_list(), abs=0.51e-4)


def test_bad_input_is_reported(stuck: Path, tmp_path: Path) -> None:
    for arguments, text in (
        ((stuck, tmp_path), "exists: give a new folder"),
        ((tmp_path / "none.mcap", tmp_path / "bag"), "cannot be read"),
        ((stuck, stuck / "bag"), "cannot be written"),
    ):
        refused = typed(*arguments)
        assert refused.exit_code != 0
        assert text in refused.output, refused.output
    assert list(tmp_path.glob("bag")) == []
