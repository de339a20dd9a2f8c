"""Legs: what a step of a motion goal means from where the rover stands.

What is steered is the control point, the point ahead of base_link that stands still when the
rover spins; the target is shifted by as much, so that base_link ends where it was sent.
"""

from dataclasses import dataclass, replace
from math import hypot, pi
from typing import Final

from executive.commands import MoveForward, RotateBy, RotateTo, Waypoint
from executive.geometry import Point, Pose, wrap_rad
from executive.profiles import Bounds, duration_s
from executive.settings import Settings
from executive.status import Status

FINEST_M: Final = 0.005
FORWARD_FAVOUR_S: Final = 0.05

Step = Waypoint | MoveForward | RotateTo | RotateBy


@dataclass(frozen=True, slots=True)
class Leg:
    """One step of a motion goal, planned from where the rover stands.

    Attributes:
        toward_rad: heading to take before driving; None to begin as it stands.
        target: where the control point is to go; None for a turn alone.
        reverse: whether to drive backward.
        heading_rad: heading to take at the end; None to stay as the drive ends.
        tolerance_m: how near is near enough.
        turn_rad: signed angle to turn to that heading; None for the shorter way.
    """

    toward_rad: float | None
    target: Point | None
    reverse: bool
    heading_rad: float | None
    tolerance_m: float
    turn_rad: float | None = None


def turn_bounds(settings: Settings, status: Status) -> Bounds:
    """Return the bounds of a turn."""
    return Bounds(status.rotate_speed_radps, settings.drive.rotate_acceleration_radps2)


def plan_leg(step: Step, settings: Settings, status: Status) -> Leg:
    """Return the leg that leads from the present pose through a step."""
    pose, law = status.pose, settings.turn_drive
    near_m = law.position_tolerance_m
    match step:
        case RotateTo(heading_rad):
            return Leg(None, None, False, wrap_rad(heading_rad), near_m)
        case RotateBy(angle_rad):
            heading_rad = wrap_rad(pose.heading_rad + angle_rad)
            return Leg(None, None, False, heading_rad, near_m, angle_rad)
        case MoveForward(distance_m):
            target = pose.ahead(law.control_point_m + distance_m)
            near_m = min(near_m, max(abs(distance_m) / 2, FINEST_M))
            return Leg(None, target, distance_m < 0, None, near_m)
        case Waypoint():
            return _to_waypoint(step, settings, status)


def _to_waypoint(waypoint: Waypoint, settings: Settings, status: Status) -> Leg:
    pose, law = status.pose, settings.turn_drive
    place = Point(waypoint.x_m, waypoint.y_m)
    near_m = waypoint.tolerance_m or law.position_tolerance_m
    start = pose.ahead(law.control_point_m)
    end = replace(pose, x_m=place.x_m, y_m=place.y_m)
    if waypoint.heading_rad is not None:
        end = replace(end, heading_rad=waypoint.heading_rad)
    if start.distance_m(end.ahead(law.control_point_m)) <= aim_m(near_m, settings) / 2:
        return Leg(None, None, False, waypoint.heading_rad, near_m)
    forward = _towards(pose, place, waypoint, False, law.control_point_m, near_m)
    if not law.reverse:
        return forward
    backward = _towards(pose, place, waypoint, True, law.control_point_m, near_m)
    bounds = turn_bounds(settings, status)
    if _turning_s(pose, forward, bounds) <= _turning_s(pose, backward, bounds) + FORWARD_FAVOUR_S:
        return forward
    return backward


def aim_m(tolerance_m: float, settings: Settings) -> float:
    """Return how near to drive: a tolerance that is wider than the asset's is no reason to err."""
    return min(tolerance_m, settings.turn_drive.position_tolerance_m)


def _towards(
    pose: Pose, place: Point, waypoint: Waypoint, reverse: bool, ahead_m: float, near_m: float
) -> Leg:
    start = pose.ahead(ahead_m)
    target = place
    if waypoint.heading_rad is not None:
        target = Pose(place.x_m, place.y_m, heading_rad=waypoint.heading_rad).ahead(ahead_m)
    heading = wrap_rad(start.bearing_rad(target) + (pi if reverse else 0.0))
    if waypoint.heading_rad is None:
        target = Pose(place.x_m, place.y_m, heading_rad=heading).ahead(ahead_m)
    return Leg(heading, target, reverse, waypoint.heading_rad, near_m)


def _turning_s(pose: Pose, leg: Leg, bounds: Bounds) -> float:
    if leg.toward_rad is None:
        return 0.0
    first = duration_s(wrap_rad(leg.toward_rad - pose.heading_rad), bounds)
    if leg.heading_rad is None:
        return first
    return first + duration_s(wrap_rad(leg.heading_rad - leg.toward_rad), bounds)


def errors(leg: Leg, settings: Settings, status: Status) -> tuple[float, float]:
    """Return how far the rover stands from the end of a leg, in metres and radians."""
    point = status.pose.ahead(settings.turn_drive.control_point_m)
    place_m = (
        0.0 if leg.target is None else hypot(leg.target.x_m - point.x_m, leg.target.y_m - point.y_m)
    )
    heading_rad = (
        0.0 if leg.heading_rad is None else abs(wrap_rad(leg.heading_rad - status.pose.heading_rad))
    )
    return place_m, heading_rad
