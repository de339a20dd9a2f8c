"""Refuses motions with too little clearance to zones or rocks; `best_detour` finds a path past.

For a single target a detour is searched. Scanned obstacles are avoided by detours to targets, and
left to the monitors in other motions. The check covers the path of base_link: straight lines of
drives, arcs of held velocities. Turns on the spot are covered by the disc that the footprint
sweeps. A base that cannot turn on the spot turns by arcs, forward first if both are free.

The navigation plans the paths of its motions. Until a leg of one begins, only its targets are
checked; then the path of its planner is (`check_planned_path`), or the straight line without one.

With `Detours` a detour may be undecided in this turn: its motion counts as free and straight. The
command waits for it (`Dispatcher.awaits_detour`), and the leg, too, if it is searched again.
Without them, each search runs to its end.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from math import inf, isfinite
from typing import Final, assert_never

from executive.commands import (
    Arc,
    Curve,
    DriveFor,
    FollowPath,
    Line,
    Motion,
    MoveTo,
    Reference,
    Request,
    Rest,
    RotateBy,
    RotateTo,
    Segment,
    Turn,
    Waypoint,
    curves_of,
    requested_controller,
)
from executive.goals import Goal
from executive.obstacles.detour import Detour, Detours, DetourSearch, Scene, search_detour
from executive.obstacles.zones import (
    ClearanceViolation,
    Obstacle,
    ScannedObstacle,
    Zones,
    has_clearance,
)
from executive.settings import Controller, LocomotionKind, Settings, TurnDriveSettings
from executive.values.clock import Clock
from executive.values.geometry import Point, Pose, Velocity, arc, path_length_m
from executive.values.quantities import angle_text
from executive.values.reasons import Figure, Reason, Refusal

DETOUR_CLEARANCE_M: Final = 0.02
"""Extra clearance of a detour beyond the margin, for the accuracy of its corners; chosen."""
ROUNDING: Final = 1e-6
MAX_END_GAP_M: Final = 1.0
"""Maximum distance of a path's ends from those requested; Nav2's planner tolerates 0.5 m."""
MAX_LENGTH_RATIO, MAX_LENGTH_M = 10.0, 100.0
"""Maximum length of a path, by its straight line and constant; chosen, for a finite deadline."""
_DRIVES_CURVES: Final = {Controller.MPC, Controller.NAVIGATION}
LOOKAHEAD_M: Final = 2.0
"""Lookahead distance within which a scanned obstacle stops a motion; chosen, not measured."""


def check_path(path: Sequence[Point], settings: Settings, zones: Zones) -> Refusal | None:
    """Return a refusal if a path of line segments violates the clearance, or None."""
    if not zones.not_empty or settings.footprint is None:
        return None
    met = zones.encounter(path, settings.footprint.radius_m, zones.margin_m)
    if met is None:
        return None
    gap = "collision" if met.gap_m <= 0 else f"passing at {met.gap_m:.2f} m"
    uncertain_m = zones.margin_m - settings.zones.margin_m
    because = f" ({uncertain_m:.2f} m of it for the position uncertainty)"
    return Refusal(
        Reason.PATH_BLOCKED,
        f"path blocked by {met.obstacle.label}: after {met.distance_m:.2f} m the clearance falls"
        " below"
        f" {zones.margin_m:g} m{because if uncertain_m > 0.0 else ''}, {gap}",
        (
            Figure("way", met.distance_m, "m"),
            Figure("gap", met.gap_m, "m"),
            Figure("bound", zones.margin_m, "m"),
            *((Figure("position uncertainty", uncertain_m, "m"),) if uncertain_m > 0.0 else ()),
            *_position_figures(met.obstacle),
        ),
    )


def _position_figures(obstacle: Obstacle) -> tuple[Figure, ...]:
    """Return the position figures of an obstacle without a name."""
    if not isinstance(obstacle, ScannedObstacle):
        return ()
    return Figure("obstacle x", obstacle.x_m, "m"), Figure("obstacle y", obstacle.y_m, "m")


def check_request(
    request: Motion, pose: Pose, settings: Settings, zones: Zones, detours: Detours | None = None
) -> Refusal | None:
    """Return a refusal if a motion turns too tightly, or violates the clearance, or None."""
    if refusal := check_turns(request, pose, settings, zones, detours):
        return refusal
    if not zones.not_empty:
        return None
    zones = avoided_obstacles(settings, zones)
    if is_navigated(request, settings):
        return _blocked_waypoint(waypoints_of(request), settings, zones, zones)
    if isinstance(request, MoveTo):
        detour = detour_to(request.target, pose, settings, zones, detours)
        return detour if isinstance(detour, Refusal) else None
    known, law = zones.known, settings.turn_drive
    segments = detoured_segments(request, pose, settings, known)
    refusal = check_path(path_of(segments, law), settings, known)
    if refusal is None and isinstance(request, FollowPath):
        return _blocked_waypoint(request.waypoints, settings, zones, zones.scanned)
    return refusal


def is_navigated(request: Request, settings: Settings) -> bool:
    """Return whether the navigation carries out a motion, and plans its path."""
    return requested_controller(request, settings.controller) is Controller.NAVIGATION


def waypoints_of(request: Request) -> tuple[Waypoint, ...]:
    """Return the targets of a motion; none of a relative one."""
    match request:
        case MoveTo(target):
            return (target,)
        case FollowPath(waypoints):
            return waypoints
        case _:
            return ()


def check_planned_path(
    path: Sequence[Point], settings: Settings, zones: Zones, missing: str = ""
) -> Refusal | None:
    """Return a refusal if the path of a navigated leg violates the clearance, or None.

    The navigation itself avoids scanned obstacles.

    Args:
        path: that of the navigation's planner, or straight lines to the targets.
        settings: settings of the asset.
        zones: the obstacles.
        missing: why the planner gave no path; empty if it did.
    """
    refusal = check_path(path, settings, zones.known)
    if refusal is None:
        return None
    text = f"straight {refusal.text}; {missing}" if missing else f"planned {refusal.text}"
    return replace(refusal, text=text)


def path_mismatch(points: Sequence[Point], start: Point, end: Point) -> str:
    """Return why points are no path between two others; empty if they are one."""
    length_m = path_length_m(points)
    max_m = MAX_LENGTH_RATIO * start.distance_m(end) + MAX_LENGTH_M
    if not isfinite(length_m):
        return "the planner's path is not finite"
    if length_m > max_m:
        return f"the planner's path of {length_m:.2f} m is longer than {max_m:.2f} m"
    for name, gap_m in (
        ("begins", start.distance_m(points[0])),
        ("ends", end.distance_m(points[-1])),
    ):
        if not gap_m <= MAX_END_GAP_M:
            return f"the planner's path {name} {gap_m:.2f} m from where it should"
    return ""


def check_turns(
    request: Motion, pose: Pose, settings: Settings, zones: Zones, detours: Detours | None = None
) -> Refusal | None:
    """Return a refusal if a motion needs tighter turns than the base can drive, or None.

    Turn-then-drive corrects a heading within its tolerance while it drives.
    """
    radius_m = settings.drive.min_turning_radius_m
    if radius_m is None or isinstance(request, RotateBy | RotateTo):
        return None
    needed_m, text = 0.0, ""
    if isinstance(request, DriveFor):
        travel_mps, rotate_radps = abs(request.travel_mps), abs(request.rotate_radps)
        if rotate_radps * radius_m > travel_mps * (1.0 + ROUNDING):
            needed_m = travel_mps / rotate_radps
            text = f"turns at a radius of {needed_m:.2f} m: turn more slowly, or drive faster"
    elif requested_controller(request, settings.controller) not in _DRIVES_CURVES:
        tolerance_rad = settings.turn_drive.heading_tolerance_rad
        segments = detoured_segments(request, pose, settings, zones, detours)
        turns_rad = [each.by_rad for each in segments]
        first_rad = next((each for each in turns_rad if abs(each) > tolerance_rad), None)
        if first_rad is not None:
            text = f"turns by {angle_text(first_rad)} on the spot: controller mpc drives curves"
    if not text:
        return None
    figures = Figure("radius", needed_m, "m"), Figure("bound", radius_m, "m")
    return Refusal(
        Reason.TURN_TOO_TIGHT,
        f"{settings.asset} cannot turn at less than {radius_m:g} m; the motion {text}",
        figures,
    )


def avoided_obstacles(settings: Settings, zones: Zones) -> Zones:
    """Return the obstacles that a motion to a target avoids; scanned ones only if it can detour."""
    return zones if settings.locomotion is LocomotionKind.VELOCITY else zones.known


def detour_to(
    target: Waypoint, pose: Pose, settings: Settings, zones: Zones, detours: Detours | None = None
) -> tuple[Waypoint, ...] | Refusal:
    """Return the corners of the detour to a target, as `best_detour`, or a refusal without one."""
    waypoints, law = best_detour(target, pose, settings, zones, detours), settings.turn_drive
    if waypoints is None:
        return ()
    path = path_of(FollowPath((*waypoints, target)).segments(pose, law.reverse), law)
    refusal = check_path(path, settings, zones)
    if refusal is None:
        return waypoints
    return replace(refusal, text=f"{refusal.text}; {_no_detour_text(target, settings, zones)}")


def leg_detour(
    request: Request,
    left_path: bool,
    step: Motion | Waypoint,
    through: tuple[Waypoint, ...],
    pose: Pose,
    settings: Settings,
    scene: Scene,
) -> tuple[Waypoint, ...] | Refusal:
    """Return the corners of the path to the end of a step, through waypoints, or a refusal.

    The straight lines of a path are followed, except around scanned obstacles across them;
    `left_path` is whether the step detours around one already.
    """
    zones, detours = avoided_obstacles(settings, scene[0]), scene[1]
    if not isinstance(step, Waypoint):
        return check_request(step, pose, settings, zones) or ()
    if isinstance(request, FollowPath) and not left_path and not is_navigated(request, settings):
        path = replace(request, waypoints=(*through, step))
        blocked = check_request(path, pose, settings, zones)
        if blocked is not None or through or not zones.scanned:
            return blocked or ()
    return detour_to(step, pose, settings, zones, detours)


def _blocked_waypoint(
    waypoints: Sequence[Waypoint], settings: Settings, zones: Zones, obstacles: Iterable[Obstacle]
) -> Refusal | None:
    """Return a refusal that names a waypoint too near to one of these obstacles, or None."""
    needed_m = _needed_m(settings, zones)
    for each in waypoints:
        point = Point(each.x_m, each.y_m)
        for seen in obstacles:
            gap_m = seen.clearance_m(point, point) - needed_m + zones.margin_m
            if gap_m < zones.margin_m:
                at = f"the waypoint ({each.x_m:g}, {each.y_m:g})"
                near = "in" if gap_m <= 0 else f"{gap_m:.2f} m from"
                return Refusal(
                    Reason.PATH_BLOCKED,
                    f"at {at} the rover would be {near} {seen.label}, nearer than"
                    f" {zones.margin_m:g} m",
                    (
                        Figure("gap", gap_m, "m"),
                        Figure("bound", zones.margin_m, "m"),
                        *_position_figures(seen),
                    ),
                )
    return None


def scanned_obstacle_ahead(
    point: Point, end: Point, settings: Settings, zones: Zones
) -> ClearanceViolation | None:
    """Return the scanned obstacle that blocks the rest of a straight drive, or None.

    Half of the margin is left for detections that appear during the drive.

    Args:
        point: position of base_link.
        end: its target.
        settings: settings of the asset.
        zones: obstacles, including scanned ones.
    """
    seen = zones.scanned
    if not seen or settings.footprint is None:
        return None
    met = Zones(rocks=seen).encounter((point, end), settings.footprint.radius_m, zones.margin_m / 2)
    return met if met is not None and met.distance_m <= LOOKAHEAD_M else None


def best_detour(
    target: Waypoint, pose: Pose, settings: Settings, zones: Zones, detours: Detours | None
) -> tuple[Waypoint, ...] | None:
    """Return the corners of a detour to a target whose lines all have the clearance.

    Empty if the straight line is free. Without a complete detour, the one that ends nearest to it.
    None while it is searched.
    """
    if not zones.not_empty:
        return ()
    law = settings.turn_drive
    line = path_of(target.segments(pose, law.reverse), law)
    if check_path(line, settings, zones) is None:
        return ()
    key = target, pose, law, _needed_m(settings, zones), zones
    detour = (detours or Detours(inf)).find(key, partial(_search, *key))
    return None if detour is None else tuple(Waypoint(at.x_m, at.y_m) for at in detour.corners)


def _search(
    target: Waypoint, pose: Pose, law: TurnDriveSettings, least_m: float, zones: Zones
) -> DetourSearch:
    """Search a detour with this clearance."""
    point = Point(target.x_m, target.y_m)
    if _obstacle_within(point, least_m, zones) is not None:
        return Detour((), reaches_goal=False)
    needed_m = least_m + DETOUR_CLEARANCE_M
    turning_m = abs(law.control_point_m)  # turns move base_link by this much

    leaves = _obstacle_within(pose.point, least_m, zones) is not None

    def leads(node: Point) -> bool:
        to = target if node == point else Waypoint(node.x_m, node.y_m)
        path = path_of(to.segments(pose, law.reverse), law)
        if leaves:
            return zones.encounter(path, least_m - zones.margin_m, zones.margin_m) is None
        return all(
            has_clearance(each, start, end, least_m)
            for start, end in pairwise(path)
            for each in zones
        )

    detour = yield from search_detour(pose.point, point, zones, needed_m + turning_m, leads)
    if detour.reaches_goal:
        return detour
    return (yield from search_detour(pose.point, point, zones, needed_m, leads))


def _needed_m(settings: Settings, zones: Zones) -> float:
    radius_m = 0.0 if settings.footprint is None else settings.footprint.radius_m
    return radius_m + zones.margin_m


def _obstacle_within(point: Point, needed_m: float, zones: Zones) -> str | None:
    """Return the title of an obstacle nearer to a place than needed, or None."""
    near = (each for each in zones if not has_clearance(each, point, point, needed_m))
    return next((each.label for each in near), None)


def _no_detour_text(target: Waypoint, settings: Settings, zones: Zones) -> str:
    point = Point(target.x_m, target.y_m)
    near = _obstacle_within(point, _needed_m(settings, zones), zones)
    return "no detour found" if near is None else f"target too near to {near}"


def detoured_segments(
    request: Motion, pose: Pose, settings: Settings, zones: Zones, detours: Detours | None = None
) -> tuple[Segment, ...]:
    """Return the segments of a motion from a pose, with its detour, and with curves for turns."""
    law, radius_m = settings.turn_drive, settings.drive.min_turning_radius_m
    if isinstance(request, MoveTo) and not is_navigated(request, settings):
        avoided = avoided_obstacles(settings, zones)
        path = best_detour(request.target, pose, settings, avoided, detours)
        request = FollowPath((*(path or ()), request.target))
    segments = request.segments(pose, law.reverse)
    match segments:
        case (Turn() as turn,) if radius_m is not None and turn.by_rad:
            options = [curves_of(turn, radius_m, backward) for backward in (False, True)]
            free = (each for each in options if not check_path(path_of(each, law), settings, zones))
            return next(free, options[0])
        case _:
            return segments


def turning_curves(step: object, pose: Pose, settings: Settings, zones: Zones) -> tuple[Curve, ...]:
    """Return the curves of a rotation by a base that cannot turn on the spot; else none."""
    if not isinstance(step, RotateBy | RotateTo):
        return ()
    segments = detoured_segments(step, pose, settings, zones)
    return tuple(each for each in segments if isinstance(each, Curve))


def expected_pose(
    goals: Iterable[Goal], pose: Pose, clock: Clock, settings: Settings, scene: Scene
) -> Pose:
    """Return the end pose of motion goals in sequence; the first may be active."""
    for goal in goals:
        request = goal.request
        assert isinstance(request, Motion)
        if goal.leg.curves and goal.leg.heading_rad is not None:
            pose = replace(goal.start_pose, heading_rad=goal.leg.heading_rad)
            continue
        for segment in detoured_segments(request, pose, settings, *scene):
            pose = _left_of(segment, goal, clock, settings).end
    return pose


def _left_of(segment: Segment, goal: Goal, clock: Clock, settings: Settings) -> Segment:
    """Return the remainder of a segment that may be active; its start is the rover's pose."""
    leg, end = goal.leg, segment.end
    match segment:
        case Line(reference=Reference.START) if leg.target is not None:
            target = replace(end, x_m=leg.target.x_m, y_m=leg.target.y_m)
            point = target.ahead(-settings.turn_drive.control_point_m)
            return replace(segment, end=replace(end, x_m=point.x_m, y_m=point.y_m))
        case Turn(reference=Reference.START) if leg.heading_rad is not None:
            return replace(segment, end=replace(end, heading_rad=leg.heading_rad))
        case Arc(duration_s=duration_s) if goal.started_s:
            left_s = max(0.0, duration_s - (clock.now_s() - goal.started_s))
            return replace(segment, duration_s=left_s)
        case _:
            return segment


def path_of(segments: Sequence[Segment], law: TurnDriveSettings) -> list[Point]:
    """Return the corners of base_link's path, with turns about the control point."""
    path = [segments[0].start.point]
    for segment in segments:
        match segment:
            case Turn(start, end, reference=Reference.NEXT_LINE):
                control = start.ahead(law.control_point_m)
                turned = replace(end, x_m=control.x_m, y_m=control.y_m)
                path.append(turned.ahead(-law.control_point_m))
            case Line(end=end):
                path.append(end.point)
            case Arc(start, velocity, duration_s):
                path += arc(start, velocity, duration_s)[0][1:]
            case Curve(start, by_m, by_rad):
                path += arc(start, Velocity(by_m, by_rad), 1.0)[0][1:]
            case Turn() | Rest():
                pass
            case _:
                assert_never(segment)
    return path
