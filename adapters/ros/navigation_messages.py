"""Messages of a navigation's actions: fields are used if the imported type has them.

Interfaces differ between the distributions of ROS, and between Nav2 and Create 3.
"""

import re
from contextlib import suppress
from importlib import import_module
from itertools import pairwise
from math import ceil, copysign, isfinite
from typing import Any, Final

from geometry_msgs.msg import PoseStamped

from adapters.ros.parameters import ParameterError
from executive.values.facts import NavigationFeedback
from executive.values.geometry import Point, Pose
from executive.values.ports import DriveBy, NavigateTo, NavigationGoal, TurnBy

Task = NavigateTo | TurnBy | DriveBy
_CODES: Final = """
1 Any GOAL_REJECTED SEND_GOAL_FAILURE
100 FollowPath UNKNOWN INVALID_CONTROLLER TF_ERROR INVALID_PATH PATIENCE_EXCEEDED
105 FollowPath FAILED_TO_MAKE_PROGRESS NO_VALID_CONTROL CONTROLLER_TIMED_OUT TIMEOUT
200 ComputePathToPose UNKNOWN INVALID_PLANNER TF_ERROR START_OUTSIDE_MAP GOAL_OUTSIDE_MAP
205 ComputePathToPose START_OCCUPIED GOAL_OCCUPIED TIMEOUT NO_VALID_PATH
300 ComputePathThroughPoses UNKNOWN INVALID_PLANNER TF_ERROR START_OUTSIDE_MAP GOAL_OUTSIDE_MAP
305 ComputePathThroughPoses START_OCCUPIED GOAL_OCCUPIED TIMEOUT NO_VALID_PATH NO_VIAPOINTS_GIVEN
400 ComputeRoute UNKNOWN TF_ERROR NO_VALID_GRAPH INDETERMINANT_NODES_ON_GRAPH TIMEOUT
405 ComputeRoute NO_VALID_ROUTE OPERATION_FAILED INVALID_EDGE_SCORER_USE
500 SmoothPath UNKNOWN INVALID_SMOOTHER TIMEOUT SMOOTHED_PATH_IN_COLLISION FAILED_TO_SMOOTH_PATH
505 SmoothPath INVALID_PATH
600 FollowWaypoints UNKNOWN TASK_EXECUTOR_FAILED NO_VALID_WAYPOINTS STOP_ON_MISSED_WAYPOINT
700 Spin UNKNOWN TIMEOUT TF_ERROR COLLISION_AHEAD
710 BackUp UNKNOWN TIMEOUT TF_ERROR INVALID_INPUT COLLISION_AHEAD
720 DriveOnHeading UNKNOWN TIMEOUT TF_ERROR COLLISION_AHEAD INVALID_INPUT
730 AssistedTeleop UNKNOWN TIMEOUT TF_ERROR
740 Wait UNKNOWN TIMEOUT
901 Docking
9000 NavigateToPose UNKNOWN FAILED_TO_LOAD_BEHAVIOR_TREE TF_ERROR TIMEOUT
9100 NavigateThroughPoses UNKNOWN FAILED_TO_LOAD_BEHAVIOR_TREE TF_ERROR TIMEOUT
"""
"""First code, action and names of consecutive codes: constants of nav2_msgs, jazzy to lyrical."""
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
                goal.time_allowance.sec = _allowance_s(angle_rad / speed_radps)
            else:  # RotateAngle of irobot_create_msgs
                goal.angle, goal.max_rotation_speed = angle_rad, speed_radps
        case DriveBy(distance_m, speed_mps):
            if hasattr(goal, "target"):
                goal.target.x = distance_m
                goal.speed = copysign(speed_mps, distance_m)
                goal.time_allowance.sec = _allowance_s(distance_m / speed_mps)
            else:  # DriveDistance of irobot_create_msgs
                goal.distance, goal.max_translation_speed = distance_m, speed_mps
    return goal


def stamped_pose(pose: Pose, frame: str) -> PoseStamped:
    """Return a pose message; without a stamp the newest transform is used."""
    message = PoseStamped()
    message.header.frame_id = frame
    message.pose.position.x, message.pose.position.y = pose.x_m, pose.y_m
    _, _, z, w = Pose(heading_rad=pose.heading_rad).quaternion
    message.pose.orientation.z, message.pose.orientation.w = z, w
    return message


def _allowance_s(expected_s: float) -> int:
    return ceil(2 * abs(expected_s) + 5.0)


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


def planned_points(path: Any, to_frame: Pose) -> tuple[Point, ...]:
    """Return the ends of a nav_msgs/Path, and points between at a distance from each other.

    Args:
        path: its poses; no point is returned unless all are finite.
        to_frame: pose of its frame in that of the points.
    """
    positions = [each.pose.position for each in path.poses]
    if not all(isfinite(at.x + at.y) for at in positions):
        return ()
    moved = (to_frame.compose(Pose(at.x, at.y)) for at in positions)
    points = [Point(round(each.x_m, 3), round(each.y_m, 3)) for each in moved]
    length_m = sum(one.distance_m(other) for one, other in pairwise(points))
    apart_m = max(MIN_POINT_DISTANCE_M, length_m / (MAX_POINTS - 2))
    thin = [points[0]]
    for each in points[1:-1]:
        if each.distance_m(thin[-1]) > apart_m - 1e-3:
            thin.append(each)
    return (*thin, points[-1])


def error_name(code: int) -> str:
    """Return the action and the name of an error code; empty for none of Nav2's.

    A code between the names has that of the action alone.
    """
    found = ""
    for first, action, *names in map(str.split, _CODES.strip().splitlines()):
        index = code - int(first)
        if 0 <= index < len(names):
            return f"{action} {names[index]}"
        if 0 <= index < 100:
            found = action
    return found
