"""Goals of Nav2's actions, and poses, as requests of the executive.

The fields are those of each distribution, found by name. Frames, finite numbers and a level pose
are checked here; bounds are checked by the core.
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
BACK_UP: Final = "backup"
ACTIONS: Final = {
    "navigate_to_pose": "NavigateToPose",
    "navigate_through_poses": "NavigateThroughPoses",
    "follow_waypoints": "FollowWaypoints",
    "spin": "Spin",
    BACK_UP: "BackUp",
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
    if getattr(goal, "behavior_tree", ""):
        raise MessageError("behavior_tree: only the empty name is supported")
    time_allowance_s(goal)
    match action:
        case "navigate_to_pose":
            return pose_request(goal.pose, frames)
        case "navigate_through_poses":
            *passed, last = _poses(goal)
            through = [_waypoint(each, passed=True) for each in passed]
            return FollowPath((*through, _waypoint(last)), frame=_frame([*passed, last], frames))
        case "follow_waypoints":
            poses = _poses(goal)[goal.goal_index :]
            if goal.number_of_loops or not poses:
                raise MessageError("goal_index: no pose there, or number_of_loops is not 0")
            return FollowPath(tuple(map(_waypoint, poses)), frame=_frame(poses, frames))
        case "spin":
            return RotateBy(finite(goal.target_yaw, "target_yaw"))
        case _:
            return MoveForward(_distance_m(action, goal))


def time_allowance_s(goal: Any) -> float | None:
    """Return the maximum duration of a goal; None for no limit.

    Raises:
        MessageError: it is negative.
    """
    allowance = getattr(goal, "time_allowance", None)
    if allowance is None or not (allowance.sec or allowance.nanosec):
        return None
    if allowance.sec < 0:
        raise MessageError(f"time_allowance is {allowance.sec} s: 0 for none, or above it")
    return float(allowance.sec + allowance.nanosec * 1e-9)


def _poses(goal: Any) -> Sequence[PoseStamped]:
    """Return the poses of a goal: a list, or from Kilted on a nav_msgs/Goals."""
    poses: Sequence[PoseStamped] = getattr(goal.poses, "goals", goal.poses)
    if not poses:
        raise MessageError("poses: it has none, give one at least")
    return poses


def _distance_m(action: str, goal: Any) -> float:
    x_m, speed_mps = finite(goal.target.x, "target.x"), finite(goal.speed, "speed")
    if goal.target.y or goal.target.z:
        raise MessageError("target: only x may differ from 0")
    if action == BACK_UP:
        return -abs(x_m)
    if x_m * speed_mps <= 0.0:
        raise MessageError(f"target.x {x_m:g} and speed {speed_mps:g} need the same sign, not 0")
    return x_m


def _waypoint(goal: PoseStamped, passed: bool = False) -> Waypoint:
    position = goal.pose.position
    for axis in ("x", "y", "z"):
        finite(getattr(position, axis), f"position.{axis}")
    pose = pose_of(goal.pose)
    if abs(pose.z_m) > MAX_HEIGHT_M or max(abs(pose.roll_rad), abs(pose.pitch_rad)) > MAX_TILT_RAD:
        raise MessageError(
            f"the pose is not level: z {pose.z_m:g} m, roll {pose.roll_rad:g} rad, pitch"
            f" {pose.pitch_rad:g} rad"
        )
    if passed:
        return Waypoint(pose.x_m, pose.y_m, tolerance_m=PASSED_M)
    return Waypoint(pose.x_m, pose.y_m, pose.heading_rad)


def _frame(goals: Sequence[PoseStamped], frames: Frames) -> TargetFrame:
    names = sorted({each.header.frame_id for each in goals})
    if len(names) > 1:
        raise MessageError(f"the poses are in several frames: {', '.join(names)}")
    frame = frames.get(names[0])
    if frame is None:
        known = " or ".join(frames)
        raise MessageError(f"frame_id is {names[0]!r}: this rover knows {known}")
    return frame
