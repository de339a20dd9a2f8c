"""Whether a motion leads too near to a zone or a known rock: before it is accepted, and begun.

To a single place a way around them is looked for. What the rover sees itself is gone around on the
way to places, and left to the monitors in other motions. What is checked is where base_link is to
go: straight lines of drives, arcs of velocities held. Turns on the spot are covered by the disc in
which the footprint turns.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import lru_cache
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
from executive.settings import LocomotionKind, Settings, TurnDrive
from executive.way_around import Way, find_way
from executive.zones import Encounter, Obstacle, Seen, Zones

ROOM_M: Final = 0.02
"""What a way around leaves beside the margin, for how exactly its places are reached."""
LOOK_M: Final = 2.0
"""So far ahead of a rover under way something that comes into view is heeded."""


def check_path(path: Sequence[Point], settings: Settings, zones: Zones) -> Refusal | None:
    """Return why the rover may not follow straight lines, or None."""
    if not zones.any or settings.footprint is None:
        return None
    met = zones.encounter(path, settings.footprint.radius_m, zones.margin_m)
    if met is None:
        return None
    gap = "meet it" if met.gap_m <= 0 else f"pass it at {met.gap_m:.2f} m"
    uncertain_m = zones.margin_m - settings.zones.margin_m
    because = f", {uncertain_m:.2f} m of it for the uncertainty of the position"
    return Refusal(
        Reason.PATH_BLOCKED,
        f"{met.obstacle.title} is in the way: the rover can go {met.way_m:.2f} m until it is nearer"
        f" than {zones.margin_m:g} m{because if uncertain_m > 0.0 else ''}, and would {gap}",
        (
            Figure("way", met.way_m, "m"),
            Figure("gap", met.gap_m, "m"),
            Figure("bound", zones.margin_m, "m"),
            *((Figure("position uncertainty", uncertain_m, "m"),) if uncertain_m > 0.0 else ()),
            *_place_of(met.obstacle),
        ),
    )


def _place_of(obstacle: Obstacle) -> tuple[Figure, ...]:
    """Return where something is that has no name by which people would know."""
    if not isinstance(obstacle, Seen):
        return ()
    return Figure("obstacle x", obstacle.x_m, "m"), Figure("obstacle y", obstacle.y_m, "m")


def check_request(request: Motion, pose: Pose, settings: Settings, zones: Zones) -> Refusal | None:
    """Return why a motion that begins at a pose may not be carried out, or None."""
    if not zones.any:
        return None
    zones = heeded(settings, zones)
    if isinstance(request, MoveTo):
        way = way_to(request.target, pose, settings, zones)
        return way if isinstance(way, Refusal) else None
    told = zones.told
    refusal = check_path(planned_path(request, pose, settings, told)[0], settings, told)
    if refusal is None and isinstance(request, FollowPath):
        return _unreachable(request.waypoints, settings, zones)
    return refusal


def heeded(settings: Settings, zones: Zones) -> Zones:
    """Return what motions to places keep away from: what is seen, where they can go around."""
    return zones if settings.locomotion is LocomotionKind.VELOCITY else zones.told


def way_to(
    target: Waypoint, pose: Pose, settings: Settings, zones: Zones
) -> tuple[Waypoint, ...] | Refusal:
    """Return where to stand on the way to a place, as `way_around`, or why none leads there."""
    way = way_around(target, pose, settings, zones)
    path = _to_waypoints((*way, target), pose, settings.turn_drive)[0]
    refusal = check_path(path, settings, zones)
    if refusal is None:
        return way
    return replace(refusal, text=f"{refusal.text}; {_why_no_way(target, settings, zones)}")


def _unreachable(waypoints: Sequence[Waypoint], settings: Settings, zones: Zones) -> Refusal | None:
    """Return which waypoint lies too near to something seen, or None."""
    needed_m = _needed_m(settings, zones)
    for each in waypoints:
        place = Point(each.x_m, each.y_m)
        for seen in zones.seen:
            gap_m = seen.clearance_m(place, place) - needed_m + zones.margin_m
            if gap_m < zones.margin_m:
                at = f"the waypoint ({each.x_m:g}, {each.y_m:g})"
                near = "in" if gap_m <= 0 else f"{gap_m:.2f} m from"
                return Refusal(
                    Reason.PATH_BLOCKED,
                    f"at {at} the rover would stand {near} {seen.title}, nearer than"
                    f" {zones.margin_m:g} m",
                    (
                        Figure("gap", gap_m, "m"),
                        Figure("bound", zones.margin_m, "m"),
                        *_place_of(seen),
                    ),
                )
    return None


def seen_ahead(place: Point, end: Point, settings: Settings, zones: Zones) -> Encounter | None:
    """Return what is seen across the straight line of a drive that is under way, or None.

    Half of the margin is left to what comes out while it is driven.

    Args:
        place: where base_link is.
        end: where it is to stand.
        settings: the asset.
        zones: with what is seen.
    """
    seen = zones.seen
    if not seen or settings.footprint is None:
        return None
    met = Zones(rocks=seen).encounter((place, end), settings.footprint.radius_m, zones.margin_m / 2)
    return met if met is not None and met.way_m <= LOOK_M else None


def way_around(
    target: Waypoint, pose: Pose, settings: Settings, zones: Zones
) -> tuple[Waypoint, ...]:
    """Return where to stand on the way to a place, so that no line leads too near to anything.

    Nowhere if the straight line is free. If no way is found, what leads nearest to the place.
    """
    if not zones.any:
        return ()
    line = _to_waypoints((target,), pose, settings.turn_drive)[0]
    if check_path(line, settings, zones) is None:
        return ()
    needed_m = _needed_m(settings, zones)
    through = _search(target, pose, settings.turn_drive, needed_m, zones).through
    return tuple(Waypoint(each.x_m, each.y_m) for each in through)


@lru_cache(maxsize=4)
def _search(target: Waypoint, pose: Pose, law: TurnDrive, least_m: float, zones: Zones) -> Way:
    """Return a way that keeps so far away; kept, since a command has several ask for the same."""
    place = Point(target.x_m, target.y_m)
    if _too_near(place, least_m, zones) is not None:
        return Way((), complete=False)
    needed_m = least_m + ROOM_M
    turning_m = abs(law.control_point_m)  # by which turns move base_link

    leaves = _too_near(pose.point, least_m, zones) is not None

    def leads(node: Point) -> bool:
        to = target if node == place else Waypoint(node.x_m, node.y_m)
        path = _to_waypoints((to,), pose, law)[0]
        if leaves:
            return zones.encounter(path, least_m - zones.margin_m, zones.margin_m) is None
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


def _too_near(place: Point, needed_m: float, zones: Zones) -> str | None:
    """Return what a place is too near to, or None."""
    near = (each for each in zones if each.clearance_m(place, place) < needed_m)
    return next((each.title for each in near), None)


def _why_no_way(target: Waypoint, settings: Settings, zones: Zones) -> str:
    place = Point(target.x_m, target.y_m)
    near = _too_near(place, _needed_m(settings, zones), zones)
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
            way = way_around(target, pose, settings, heeded(settings, zones))
            return _to_waypoints((*way, target), pose, settings.turn_drive)
        case FollowPath(waypoints):
            return _to_waypoints(waypoints, pose, settings.turn_drive)
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
    waypoints: Sequence[Waypoint], pose: Pose, law: TurnDrive
) -> tuple[list[Point], Pose]:
    """Return the lines to waypoints, after turns about the control point."""
    control_m = law.control_point_m
    path = [pose.point]
    for waypoint in waypoints:
        place = Point(waypoint.x_m, waypoint.y_m)
        toward_rad = pose.point.bearing_rad(place)
        if law.reverse and abs(wrap_rad(toward_rad - pose.heading_rad)) > pi / 2:
            toward_rad = wrap_rad(toward_rad + pi)
        control = pose.ahead(control_m)
        turned = Pose(control.x_m, control.y_m, heading_rad=toward_rad).ahead(-control_m)
        path += [turned, place]
        heading_rad = toward_rad if waypoint.heading_rad is None else waypoint.heading_rad
        pose = replace(pose, x_m=place.x_m, y_m=place.y_m, heading_rad=heading_rad)
    return path, pose
