"""Whether a motion leads too near to a zone or a known rock: before it is accepted, and begun.

To a single place a way around them is looked for. What is checked is where base_link is to go:
straight lines of drives, arcs of velocities held. Turns on the spot are covered by the disc in
which the footprint turns.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import pairwise
from math import pi
from typing import Final

from executive.clock import Clock
from executive.commands import (
    DriveFor,
    FollowPath,
    Motion,
    MoveForward,
    MoveTo,
    RotateBy,
    RotateTo,
    Waypoint,
)
from executive.geometry import Point, Pose, Velocity, arc, wrap_rad
from executive.goals import Goal
from executive.reasons import Figure, Reason, Refusal
from executive.settings import Settings
from executive.way_around import Way, find_way
from executive.zones import Zones

ROOM_M: Final = 0.02
"""What a way around leaves beside the margin, for how exactly its places are reached."""


def check_path(path: Sequence[Point], settings: Settings, zones: Zones) -> Refusal | None:
    """Return why the rover may not follow straight lines, or None."""
    if not zones.any or settings.footprint is None:
        return None
    met = zones.encounter(path, settings.footprint.radius_m, zones.margin_m)
    if met is None:
        return None
    gap = "meet it" if met.gap_m <= 0 else f"pass it at {met.gap_m:.2f} m"
    return Refusal(
        Reason.PATH_BLOCKED,
        f"{met.obstacle} is in the way: the rover can go {met.way_m:.2f} m until it is nearer than"
        f" {zones.margin_m:g} m, and would {gap}",
        (
            Figure("way", met.way_m, "m"),
            Figure("gap", met.gap_m, "m"),
            Figure("bound", zones.margin_m, "m"),
        ),
    )


def check_request(request: Motion, pose: Pose, settings: Settings, zones: Zones) -> Refusal | None:
    """Return why a motion that begins at a pose may not be carried out, or None."""
    if not zones.any:
        return None
    refusal = check_path(planned_path(request, pose, settings, zones)[0], settings, zones)
    if refusal is None or not isinstance(request, MoveTo):
        return refusal
    return replace(refusal, text=f"{refusal.text}; {_why_no_way(request.target, settings, zones)}")


def way_around(
    target: Waypoint, pose: Pose, settings: Settings, zones: Zones
) -> tuple[Waypoint, ...]:
    """Return where to stand on the way to a place, so that no line leads too near to anything.

    Nowhere if the straight line is free. If no way is found, what leads nearest to the place.
    """
    if not zones.any:
        return ()
    if check_path(_to_waypoints((target,), pose, settings)[0], settings, zones) is None:
        return ()
    through = _search(target, pose, settings, zones).through
    return tuple(Waypoint(each.x_m, each.y_m) for each in through)


def _search(target: Waypoint, pose: Pose, settings: Settings, zones: Zones) -> Way:
    place = Point(target.x_m, target.y_m)
    if _too_near(place, settings, zones) is not None:
        return Way((), complete=False)
    least_m = _needed_m(settings, zones)
    needed_m = least_m + ROOM_M
    turning_m = abs(settings.turn_drive.control_point_m)  # by which turns move base_link

    leaves = _too_near(pose.point, settings, zones) is not None

    def leads(node: Point) -> bool:
        to = target if node == place else Waypoint(node.x_m, node.y_m)
        path = _to_waypoints((to,), pose, settings)[0]
        if leaves:
            return check_path(path, settings, zones) is None
        return all(
            each.clearance_m(start, end) >= least_m
            for start, end in pairwise(path)
            for each in zones
        )

    way = find_way(pose.point, place, zones, needed_m + turning_m, leads)
    if way.complete:
        return way
    return find_way(pose.point, place, zones, needed_m, leads)


def _needed_m(settings: Settings, zones: Zones) -> float:
    radius_m = 0.0 if settings.footprint is None else settings.footprint.radius_m
    return radius_m + zones.margin_m


def _too_near(place: Point, settings: Settings, zones: Zones) -> str | None:
    """Return what a place is too near to, or None."""
    needed_m = _needed_m(settings, zones)
    near = (each for each in zones if each.clearance_m(place, place) < needed_m)
    return next((each.title for each in near), None)


def _why_no_way(target: Waypoint, settings: Settings, zones: Zones) -> str:
    near = _too_near(Point(target.x_m, target.y_m), settings, zones)
    return "no way around is found" if near is None else f"the place itself is too near to {near}"


def expected_pose(
    goals: Iterable[Goal], pose: Pose, clock: Clock, settings: Settings, zones: Zones
) -> Pose:
    """Return where goals of motion, the first of them under way perhaps, lead from a pose."""
    for goal in goals:
        request, leg = goal.command.request, goal.leg
        match request:
            case MoveForward() if leg.target is not None:
                end = Pose(leg.target.x_m, leg.target.y_m, heading_rad=pose.heading_rad)
                place = end.ahead(-settings.turn_drive.control_point_m)
                pose = replace(pose, x_m=place.x_m, y_m=place.y_m)
            case RotateBy() if leg.heading_rad is not None:
                pose = replace(pose, heading_rad=leg.heading_rad)
            case DriveFor(travel_mps, rotate_radps, duration_s) if goal.started_s:
                left_s = max(0.0, duration_s - (clock.now_s() - goal.started_s))
                pose = arc(pose, Velocity(travel_mps, rotate_radps), left_s)[1]
            case _:
                pose = planned_path(request, pose, settings, zones)[1]
    return pose


def planned_path(
    request: object, pose: Pose, settings: Settings, zones: Zones
) -> tuple[list[Point], Pose]:
    """Return the places between which base_link goes straight on from a pose, and where it ends.

    Raises:
        TypeError: the request is no motion.
    """
    match request:
        case MoveTo(target):
            way = way_around(target, pose, settings, zones)
            return _to_waypoints((*way, target), pose, settings)
        case FollowPath(waypoints):
            return _to_waypoints(waypoints, pose, settings)
        case MoveForward(distance_m):
            place = pose.ahead(distance_m)
            return [pose.point, place], replace(pose, x_m=place.x_m, y_m=place.y_m)
        case RotateTo(heading_rad):
            return [pose.point], replace(pose, heading_rad=heading_rad)
        case RotateBy(angle_rad):
            return [pose.point], replace(pose, heading_rad=wrap_rad(pose.heading_rad + angle_rad))
        case DriveFor(travel_mps, rotate_radps, duration_s):
            return arc(pose, Velocity(travel_mps, rotate_radps), duration_s)
        case _:
            raise TypeError(f"{request} is no motion")


def _to_waypoints(
    waypoints: Sequence[Waypoint], pose: Pose, settings: Settings
) -> tuple[list[Point], Pose]:
    """Return the lines to waypoints, after turns about the control point."""
    control_m = settings.turn_drive.control_point_m
    path = [pose.point]
    for waypoint in waypoints:
        place = Point(waypoint.x_m, waypoint.y_m)
        toward_rad = pose.point.bearing_rad(place)
        if settings.turn_drive.reverse and abs(wrap_rad(toward_rad - pose.heading_rad)) > pi / 2:
            toward_rad = wrap_rad(toward_rad + pi)
        control = pose.ahead(control_m)
        turned = Pose(control.x_m, control.y_m, heading_rad=toward_rad).ahead(-control_m)
        path += [turned, place]
        heading_rad = toward_rad if waypoint.heading_rad is None else waypoint.heading_rad
        pose = replace(pose, x_m=place.x_m, y_m=place.y_m, heading_rad=heading_rad)
    return path, pose
