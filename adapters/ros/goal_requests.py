"""Goals of Nav2's actions, and poses, as motions; the fields are found by name.

Frames, finite numbers and a level pose are checked here; bounds are checked by the core.
"""

from collections.abc import Mapping, Sequence
from hashlib import sha256
from typing import Any, Final

from geometry_msgs.msg import PoseStamped

from adapters.ros.conversions import MessageError, finite, pose_of
from executive.commands import FollowPath, Motion, MoveForward, MoveTo, RotateBy, Waypoint
from executive.values.geometry import TargetFrame

Frames = Mapping[str, TargetFrame]
PASSED_M: Final = 0.7
"""Distance within which an intermediate pose of NavigateThroughPoses is passed, as in Nav2."""
MAX_HEIGHT_M: Final = 0.1
MAX_TILT_RAD: Final = 0.05
_NUMBERS: Final = (1 << 63) - 1
ACTIONS: Final = {
    "navigate_to_pose": "NavigateToPose",
    "navigate_through_poses": "NavigateThroughPoses",
    "follow_waypoints": "FollowWaypoints",
    "spin": "Spin",
    "backup": "BackUp",
    "drive_on_heading": "DriveOnHeading",
}
"""The type of nav2_msgs of each action."""


def number_of_uuid(uuid: bytes) -> int:
    """Return the command number of a goal: 63 bits of its UUID, never 0."""
    return int.from_bytes(uuid[8:16], "big") & _NUMBERS or 1


def number_of_pose(goal: PoseStamped) -> int:
    """Return the command number of a stamped pose: a repeat of the message is the same command."""
    return int.from_bytes(sha256(repr(goal).encode()).digest()[:8], "big") & _NUMBERS or 1


def pose_request(goal: PoseStamped, frames: Frames) -> MoveTo:
    """Return the motion to a pose.

    Raises:
        MessageError: the pose is not finite, not level, or in an unknown frame.
    """
    return MoveTo(_waypoint(goal), frame=_frame([goal], frames))


def goal_request(action: str, goal: Any, frames: Frames) -> Motion:
    """Return the motion of an action's goal.

    Raises:
        MessageError: the goal is invalid, or requests an option that is not supported.
    """
    if getattr(goal, "behavior_tree", "") or getattr(goal, "number_of_loops", 0):
        raise MessageError("behavior_tree and number_of_loops are not supported")
    match action:
        case "navigate_to_pose":
            return pose_request(goal.pose, frames)
        case "spin":
            return RotateBy(finite(goal.target_yaw, "target_yaw"))
        case "backup" | "drive_on_heading":
            return _straight(goal, backward=action == "backup")
        case _:
            poses: Sequence[PoseStamped] = getattr(
                goal.poses, "goals", goal.poses
            )  # from Kilted on
            poses = poses[getattr(goal, "goal_index", 0) :]
            if not poses:
                raise MessageError("poses: there is none, or none from goal_index on")
            passed = len(poses) - 1 if action == "navigate_through_poses" else 0
            path = [_waypoint(each, index < passed) for index, each in enumerate(poses)]
            return FollowPath(tuple(path), frame=_frame(poses, frames))


def _straight(goal: Any, backward: bool) -> MoveForward:
    x_m, speed_mps = finite(goal.target.x, "target.x"), finite(goal.speed, "speed")
    if goal.target.y or goal.target.z or not (backward or x_m * speed_mps > 0.0):
        raise MessageError("target: only x differs from 0, and speed has the same sign")
    return MoveForward(-abs(x_m) if backward else x_m)


def _waypoint(goal: PoseStamped, passed: bool = False) -> Waypoint:
    for axis in ("x", "y", "z"):
        finite(getattr(goal.pose.position, axis), f"position.{axis}")
    pose = pose_of(goal.pose)
    tilt_rad = max(abs(pose.roll_rad), abs(pose.pitch_rad))
    if abs(pose.z_m) > MAX_HEIGHT_M or tilt_rad > MAX_TILT_RAD:
        raise MessageError(f"the pose is not level: z {pose.z_m:g} m, tilt {tilt_rad:g} rad")
    if passed:
        return Waypoint(pose.x_m, pose.y_m, tolerance_m=PASSED_M)
    return Waypoint(pose.x_m, pose.y_m, pose.heading_rad)


def _frame(goals: Sequence[PoseStamped], frames: Frames) -> TargetFrame:
    names = {each.header.frame_id for each in goals}
    found = {frames.get(name) for name in names}
    frame = found.pop()
    if found or frame is None:
        known = " or ".join(frames)
        raise MessageError(f"frame_id is {', '.join(sorted(names))!r}: this rover knows {known}")
    return frame
