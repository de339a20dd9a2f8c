"""Messages of a navigation's actions: fields are used if the imported type has them.

Interfaces differ between the distributions of ROS, and between Nav2 and Create 3.
"""

import re
from contextlib import suppress
from importlib import import_module
from itertools import pairwise
from math import ceil, copysign, isfinite
from typing import Any

from geometry_msgs.msg import PoseStamped

from adapters.ros.parameters import ParameterError
from executive.values.facts import NavigationFeedback
from executive.values.geometry import Point, Pose
from executive.values.ports import DriveBy, NavigateTo, NavigationGoal, TurnBy

Task = NavigateTo | TurnBy | DriveBy
MIN_POINT_DISTANCE_M, MAX_POINTS = 0.1, 500
"""Of a planned path, which is recorded."""


def action_type(parameter: str, name: str) -> Any:
    """Return the class of an action; a text if its package is not installed.

    Raises:
        ParameterError: it is not of the form package/action/Name, or not in the package.
    """
    if re.fullmatch(r"\w+/action/\w+", name) is None:
        raise ParameterError(
            f"parameter {parameter} is {name!r}: not of the form package/action/Name"
        )
    package, _, kind = name.split("/")
    try:
        import_module(package)
    except ImportError as error:
        apt = f"ros-jazzy-{package.replace('_', '-')}"
        missing = f"this ROS has no package {package} ({error})"
        return f"{missing}: apt install {apt}, or that of your distribution"
    with suppress(ModuleNotFoundError):
        if found := getattr(import_module(f"{package}.action"), kind, None):
            return found
    raise ParameterError(f"parameter {parameter} is {name!r}: {package} has no such action")


def goal_message(kind: Any, task: Task, frame: str) -> Any:
    """Return a goal message of a type; `frame` is the name of the frame of the poses."""
    goal = kind.Goal()
    match task:
        case NavigateTo(poses):
            stamped = [stamped_pose(each, frame) for each in poses]
            if hasattr(goal, "pose"):
                (goal.pose,) = stamped
            elif hasattr(goal.poses, "goals"):  # nav_msgs/Goals, from Kilted on
                goal.poses.header, goal.poses.goals = stamped[0].header, stamped
            else:
                goal.poses = stamped
        case TurnBy(angle_rad, speed_radps):
            if hasattr(goal, "target_yaw"):
                goal.target_yaw = angle_rad
            else:  # RotateAngle of irobot_create_msgs
                goal.angle, goal.max_rotation_speed = angle_rad, speed_radps
            _allow(goal, angle_rad / speed_radps)
        case DriveBy(distance_m, speed_mps):
            if hasattr(goal, "target"):
                goal.target.x = distance_m
                goal.speed = copysign(speed_mps, distance_m)
            else:  # DriveDistance of irobot_create_msgs
                goal.distance, goal.max_translation_speed = distance_m, speed_mps
            _allow(goal, distance_m / speed_mps)
    return goal


def stamped_pose(pose: Pose, frame: str) -> PoseStamped:
    """Return a pose message; without a stamp the newest transform is used."""
    message = PoseStamped()
    message.header.frame_id = frame
    message.pose.position.x, message.pose.position.y = pose.x_m, pose.y_m
    _, _, z, w = Pose(heading_rad=pose.heading_rad).quaternion
    message.pose.orientation.z, message.pose.orientation.w = z, w
    return message


def _allow(goal: Any, expected_s: float) -> None:
    """Limit the time of a relative action of Nav2."""
    if hasattr(goal, "time_allowance"):
        goal.time_allowance.sec = ceil(2 * abs(expected_s) + 5.0)


def feedback_fact(goal: NavigationGoal, feedback: Any) -> NavigationFeedback:
    """Return what feedback reports, by the fields that its type has."""
    remaining = getattr(feedback, "distance_remaining", None)
    poses = getattr(feedback, "number_of_poses_remaining", None)
    task = goal.task
    if isinstance(task, NavigateTo) and hasattr(feedback, "current_waypoint"):
        poses = len(task.poses) - feedback.current_waypoint
    if isinstance(task, DriveBy):
        travelled_m = getattr(feedback, "distance_traveled", None)
        remaining = getattr(feedback, "remaining_travel_distance", None)
        if travelled_m is not None:
            remaining = abs(task.distance_m) - abs(travelled_m)
    if remaining is not None:
        remaining = round(max(0.0, remaining), 3) if isfinite(remaining) else None
    recoveries = int(getattr(feedback, "number_of_recoveries", 0))
    return NavigationFeedback(goal.number, remaining, recoveries, poses)


def missed_poses(result: Any) -> tuple[int, ...]:
    """Return the indices of the poses that were missed, by FollowWaypoints or, from Kilted on."""
    missed = {int(each.index) for each in getattr(result, "missed_waypoints", ())}
    for each in getattr(result, "waypoint_statuses", ()):
        if each.waypoint_status in (each.SKIPPED, each.FAILED):
            missed.add(int(each.waypoint_index))
    return tuple(sorted(missed))


def thinned(points: list[Point]) -> tuple[Point, ...]:
    """Return the ends of a path, and points between at a distance from each other."""
    length_m = sum(one.distance_m(other) for one, other in pairwise(points))
    apart_m = max(MIN_POINT_DISTANCE_M, length_m / (MAX_POINTS - 2))
    thin = [points[0]]
    for each in points[1:-1]:
        if each.distance_m(thin[-1]) > apart_m - 1e-3:
            thin.append(each)
    return (*thin, points[-1])
