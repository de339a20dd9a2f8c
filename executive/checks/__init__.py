"""Checks that refuse a motion or plan before the rover moves: path, certainty of the pose, battery.

They are run when a command arrives (the dispatcher), again when its motion begins (the tree), and
by previews. The bounds of arguments are checked by `executive.commands.intake`.
"""

from executive.checks.battery_check import Speeds, check_battery, reckoned_j
from executive.checks.path_check import (
    check_request,
    detoured_segments,
    expected_pose,
    heeded,
    path_of,
    seen_ahead,
    way_to,
)
from executive.checks.pose_check import check_pose, check_target

__all__ = [
    "Speeds",
    "check_battery",
    "check_pose",
    "check_request",
    "check_target",
    "detoured_segments",
    "expected_pose",
    "heeded",
    "path_of",
    "reckoned_j",
    "seen_ahead",
    "way_to",
]
