"""Checks that refuse a motion or plan before the rover moves: path, pose uncertainty, battery.

They run when a command arrives (the dispatcher), again when its motion begins (the tree), and
in previews. The bounds of arguments are checked by `executive.commands.intake`.
"""

from executive.checks.battery_check import SpeedLimits as SpeedLimits
from executive.checks.battery_check import check_battery as check_battery
from executive.checks.battery_check import estimate_energy_j as estimate_energy_j
from executive.checks.path_check import avoided_obstacles as avoided_obstacles
from executive.checks.path_check import check_planned_path as check_planned_path
from executive.checks.path_check import check_request as check_request
from executive.checks.path_check import check_turns as check_turns
from executive.checks.path_check import detoured_segments as detoured_segments
from executive.checks.path_check import expected_pose as expected_pose
from executive.checks.path_check import is_navigated as is_navigated
from executive.checks.path_check import leg_detour as leg_detour
from executive.checks.path_check import path_mismatch as path_mismatch
from executive.checks.path_check import path_of as path_of
from executive.checks.path_check import scanned_obstacle_ahead as scanned_obstacle_ahead
from executive.checks.path_check import turning_curves as turning_curves
from executive.checks.path_check import waypoints_of as waypoints_of
from executive.checks.pose_check import check_pose as check_pose
from executive.checks.pose_check import check_target as check_target
