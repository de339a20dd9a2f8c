"""Built packages of interfaces carry messages as those of a distribution do."""

import sys
from importlib import import_module

import pytest
from geometry_msgs.msg import PoseStamped
from rclpy.serialization import deserialize_message, serialize_message

from tests.support.examples import ALL
from tests.support.interface_packages import KILTED, installed, interface_package, python_path
from tests.support.processes import run_to_end

pytestmark = pytest.mark.ros

KILTED_GOALS = """
from geometry_msgs.msg import PoseStamped
from nav2_msgs.action import FollowWaypoints, NavigateThroughPoses, Spin
from nav2_msgs.msg import WaypointStatus
from nav_msgs.msg import Goals
from rclpy.serialization import deserialize_message, serialize_message

goal = NavigateThroughPoses.Goal(poses=Goals(goals=[PoseStamped()]))
goal.poses.goals[0].pose.position.x = 2.5
(pose,) = deserialize_message(serialize_message(goal), NavigateThroughPoses.Goal).poses.goals
assert pose.pose.position.x == 2.5
for kind in (NavigateThroughPoses, FollowWaypoints):
    result = kind.Result(waypoint_statuses=[WaypointStatus(waypoint_index=3)])
    (status,) = deserialize_message(serialize_message(result), kind.Result).waypoint_statuses
    assert status.waypoint_index == 3
assert Spin.Goal(disable_collision_checks=True).disable_collision_checks
print("decoded")
"""


@pytest.mark.usefixtures("nav2_msgs")
def test_a_goal_is_encoded_and_decoded() -> None:
    kind = import_module("nav2_msgs.action").NavigateToPose
    goal = kind.Goal(pose=PoseStamped(), behavior_tree="tree.xml")
    goal.pose.header.frame_id = "map"
    assert deserialize_message(serialize_message(goal), kind.Goal) == goal
    for part in ("SendGoal", "GetResult"):
        assert hasattr(getattr(kind.Impl, f"{part}Service"), "Request")


@pytest.mark.skipif(not ALL and installed() != KILTED, reason="built for --stress or Kilted")
def test_goals_and_statuses_of_kilted_are_encoded_and_decoded() -> None:
    folder = interface_package("nav2_msgs", KILTED)
    path = python_path(folder)
    done = run_to_end(sys.executable, "-c", KILTED_GOALS, PYTHONPATH=path)
    assert done.stdout == "decoded\n", done.stderr
