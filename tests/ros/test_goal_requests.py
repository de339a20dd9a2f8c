"""Goals of actions become motions, or are refused with the field that is wrong."""

from math import nan
from types import SimpleNamespace
from typing import Any

import pytest
from geometry_msgs.msg import Point, PoseStamped

from adapters.mrs.cli.command_text import read_command_text
from adapters.ros.client_link import BURST, RATE_HZ, Admission, _is_stop
from adapters.ros.conversions import MessageError
from adapters.ros.goal_requests import (
    PASSED_M,
    goal_request,
    number_of_pose,
    number_of_uuid,
    pose_request,
)
from executive.commands import FollowPath, MoveForward, MoveTo, RotateBy, Waypoint
from executive.values.geometry import TargetFrame
from executive.values.reports import Identity
from tests.support.ros_client import pose_of

pytestmark = pytest.mark.ros

FRAMES = {"odom": TargetFrame.ODOM, "world": TargetFrame.MAP}


def request_of(action: str, **fields: Any) -> Any:
    return goal_request(action, SimpleNamespace(**fields), FRAMES)


def test_each_action_becomes_a_motion() -> None:
    two = [pose_of(1.0, 0.0, 0.5), pose_of(2.0, 0.0, 1.0)]
    odom = TargetFrame.ODOM
    assert request_of("navigate_to_pose", pose=pose_of(1.0, 2.0, 0.5, "world")) == MoveTo(
        Waypoint(1.0, 2.0, 0.5), frame=TargetFrame.MAP
    )
    through = FollowPath(
        (Waypoint(1.0, 0.0, tolerance_m=PASSED_M), Waypoint(2.0, 0.0, 1.0)), frame=odom
    )
    assert request_of("navigate_through_poses", poses=two) == through
    assert request_of("navigate_through_poses", poses=SimpleNamespace(goals=two)) == through
    stops = Waypoint(1.0, 0.0, 0.5), Waypoint(2.0, 0.0, 1.0)
    second = request_of("follow_waypoints", poses=two, goal_index=1, number_of_loops=0)
    assert second == FollowPath(stops[1:], frame=odom)
    assert request_of("spin", target_yaw=0.5) == RotateBy(0.5)
    for x_m in (0.3, -0.3):
        assert request_of("backup", target=Point(x=x_m), speed=0.1) == MoveForward(-0.3)
    assert request_of("drive_on_heading", target=Point(x=-0.3), speed=-0.1) == MoveForward(-0.3)


def tilted() -> PoseStamped:
    pose = pose_of(0.0, 0.0)
    pose.pose.orientation.x, pose.pose.orientation.w = 0.6, 0.8
    return pose


def high() -> PoseStamped:
    pose = pose_of(0.0, 0.0)
    pose.pose.position.z = 1.0
    return pose


@pytest.mark.parametrize(
    ("action", "fields", "wrong"),
    [
        ("navigate_to_pose", {"pose": pose_of(nan, 0.0)}, "position.x is nan"),
        ("navigate_to_pose", {"pose": tilted()}, "not level"),
        ("navigate_to_pose", {"pose": high()}, "not level"),
        ("navigate_to_pose", {"pose": pose_of(0.0, 0.0, frame="map")}, "knows odom or world"),
        ("navigate_to_pose", {"pose": pose_of(0, 0), "behavior_tree": "a.xml"}, "behavior_tree"),
        ("navigate_through_poses", {"poses": []}, "there is none"),
        (
            "navigate_through_poses",
            {"poses": [pose_of(0.0, 0.0), pose_of(0.0, 0.0, frame="world")]},
            "odom, world",
        ),
        (
            "follow_waypoints",
            {"poses": [pose_of(0.0, 0.0)], "goal_index": 1, "number_of_loops": 0},
            "none from goal_index",
        ),
        (
            "follow_waypoints",
            {"poses": [pose_of(0.0, 0.0)], "goal_index": 0, "number_of_loops": 4_000_000_000},
            "number_of_loops",
        ),
        ("spin", {"target_yaw": nan}, "target_yaw is nan"),
        ("backup", {"target": Point(x=1.0, y=0.1), "speed": 0.1}, "only x"),
        ("drive_on_heading", {"target": Point(x=1.0), "speed": -0.1}, "same sign"),
    ],
)
def test_a_wrong_goal_is_refused_by_its_field(
    action: str, fields: dict[str, Any], wrong: str
) -> None:
    with pytest.raises(MessageError, match=wrong):
        request_of(action, **fields)


def test_numbers_fit_a_command_and_differ_by_goal_and_stamp() -> None:
    assert number_of_uuid(bytes(16)) == 1
    assert number_of_uuid(b"\xff" * 16) == (1 << 63) - 1
    assert number_of_uuid(bytes(range(16))) != number_of_uuid(bytes(range(1, 17)))
    first, later = pose_of(1.0, 0.0), pose_of(1.0, 0.0)
    assert number_of_pose(first) == number_of_pose(later)
    later.header.stamp.sec = 1
    assert 0 < number_of_pose(first) != number_of_pose(later) < 1 << 63
    assert pose_request(first, FRAMES) == pose_request(later, FRAMES)


def test_a_rate_is_limited_after_a_burst() -> None:
    now_s = 0.0
    admission = Admission(RATE_HZ, BURST, lambda: now_s)
    assert [admission.admit() for _ in range(BURST + 5)].count(True) == BURST
    admitted = 0
    for _ in range(200):
        now_s += 0.005
        admitted += admission.admit()
    assert admitted == pytest.approx(RATE_HZ, abs=1)


def test_a_stop_is_recognised_in_any_form() -> None:
    for text in ("stop", " STOP now", "rover stop", "rover command Stop"):
        assert _is_stop(text)
    for text in ("", "moveForward 1", "stopped", "rover", "moveTo stop"):
        assert not _is_stop(text)


def test_texts_are_read_with_their_options_or_refused() -> None:
    identity = Identity("ROS", 1)
    command = read_command_text(
        "moveTo 1 2 --heading 90deg --lifetime 10s --replace", identity, "ros"
    )
    assert isinstance(command.request, MoveTo)
    assert (command.lifetime_s, command.preemption.value) == (10.0, "replace")
    for wrong in (
        "",
        "fly",
        "halt",
        "moveForward",
        "moveForward 1 'x",
        "action",
        "moveTo 1 --to a",
    ):
        with pytest.raises(ValueError, match=r"\w"):
            read_command_text(wrong, identity, "ros")
