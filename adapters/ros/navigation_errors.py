"""Names of Nav2's error codes: constants of nav2_msgs/action in the branches jazzy to lyrical."""

from typing import Final

_ANY: Final = (1, "", "GOAL_REJECTED SEND_GOAL_FAILURE")
_BLOCKS: Final = (
    _ANY,
    (
        *(100, "FollowPath"),
        "UNKNOWN INVALID_CONTROLLER TF_ERROR INVALID_PATH PATIENCE_EXCEEDED FAILED_TO_MAKE_PROGRESS"
        " NO_VALID_CONTROL CONTROLLER_TIMED_OUT TIMEOUT",
    ),
    (
        *(200, "ComputePathToPose"),
        "UNKNOWN INVALID_PLANNER TF_ERROR START_OUTSIDE_MAP GOAL_OUTSIDE_MAP START_OCCUPIED"
        " GOAL_OCCUPIED TIMEOUT NO_VALID_PATH",
    ),
    (
        *(300, "ComputePathThroughPoses"),
        "UNKNOWN INVALID_PLANNER TF_ERROR START_OUTSIDE_MAP GOAL_OUTSIDE_MAP START_OCCUPIED"
        " GOAL_OCCUPIED TIMEOUT NO_VALID_PATH NO_VIAPOINTS_GIVEN",
    ),
    (
        *(400, "ComputeRoute"),
        "UNKNOWN TF_ERROR NO_VALID_GRAPH INDETERMINANT_NODES_ON_GRAPH TIMEOUT NO_VALID_ROUTE"
        " OPERATION_FAILED INVALID_EDGE_SCORER_USE",
    ),
    (
        *(500, "SmoothPath"),
        "UNKNOWN INVALID_SMOOTHER TIMEOUT SMOOTHED_PATH_IN_COLLISION FAILED_TO_SMOOTH_PATH"
        " INVALID_PATH",
    ),
    (
        *(600, "FollowWaypoints"),
        "UNKNOWN TASK_EXECUTOR_FAILED NO_VALID_WAYPOINTS STOP_ON_MISSED_WAYPOINT",
    ),
    (700, "Spin", "UNKNOWN TIMEOUT TF_ERROR COLLISION_AHEAD"),
    (710, "BackUp", "UNKNOWN TIMEOUT TF_ERROR INVALID_INPUT COLLISION_AHEAD"),
    (720, "DriveOnHeading", "UNKNOWN TIMEOUT TF_ERROR COLLISION_AHEAD INVALID_INPUT"),
    (730, "AssistedTeleop", "UNKNOWN TIMEOUT TF_ERROR"),
    (740, "Wait", "UNKNOWN TIMEOUT"),
    (9000, "NavigateToPose", "UNKNOWN FAILED_TO_LOAD_BEHAVIOR_TREE TF_ERROR TIMEOUT"),
    (9100, "NavigateThroughPoses", "UNKNOWN FAILED_TO_LOAD_BEHAVIOR_TREE TF_ERROR TIMEOUT"),
)
"""First code, action and names of consecutive codes."""
_NAMES: Final = {
    first + index: f"{action} {name}".lstrip()
    for first, action, names in _BLOCKS
    for index, name in enumerate(names.split())
}
_RANGES: Final = (
    *((range(first, first + 10), action) for first, action, _ in _BLOCKS[7:]),
    *((range(first, first + 100), action) for first, action, _ in _BLOCKS[1:7]),
    (range(901, 1000), "docking"),
)


def error_name(code: int) -> str:
    """Return the action and the name of an error code; the action alone if the code has no name.

    Empty without an error, and for a code of no action of Nav2.
    """
    if name := _NAMES.get(code):
        return name
    return next((f"{action}, unnamed" for codes, action in _RANGES if code in codes), "")
