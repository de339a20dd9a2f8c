"""Whether the battery can bring the rover back: before a motion or plan is accepted, and begun.

What a motion takes is reckoned from its turns and lines, each from rest to rest, which takes next
to no time; a preview would take longer than a command may wait. Nothing is refused where the asset
does not say what its battery holds, or the battery does not tell its charge.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from math import pi
from typing import Final

from executive.checks.path_check import heeded, way_around
from executive.commands import (
    DriveFor,
    FollowPath,
    Motion,
    MoveForward,
    MoveTo,
    RotateBy,
    RotateTo,
    SetRotateSpeed,
    SetTravelSpeed,
    Waypoint,
)
from executive.geometry import Point, Pose, Velocity, arc, wrap_rad
from executive.motion import Bounds, duration_s
from executive.plans import PlanNode, Step, expected_course
from executive.reasons import Figure, Reason, Refusal
from executive.settings import Settings, Way, curved_m
from executive.state import Status
from executive.zones import Zones

DETOUR: Final = 1.5
"""What motion on the way home may take, of what the straight way home takes."""


@dataclass(frozen=True, slots=True)
class Speeds:
    """The greatest speeds that are set."""

    travel_mps: float
    rotate_radps: float


class _Reckoning:
    """Adds up what motions take from a pose on, by the settings' figures."""

    def __init__(self, pose: Pose, speeds: Speeds, settings: Settings, zones: Zones) -> None:
        self.pose = pose
        self.speeds = speeds
        self.energy_j = 0.0
        self._settings = settings
        self._zones = heeded(settings, zones)

    def add(self, request: Motion) -> None:
        """Go on with a motion."""
        match request:
            case MoveTo(target):
                for corner in way_around(target, self.pose, self._settings, self._zones):
                    self._go(corner)
                self._go(target)
            case FollowPath(waypoints):
                for waypoint in waypoints:
                    self._go(waypoint)
            case MoveForward(distance_m):
                self._drive(distance_m)
                place = self.pose.ahead(distance_m)
                self.pose = replace(self.pose, x_m=place.x_m, y_m=place.y_m)
            case RotateTo(heading_rad):
                self._turn(wrap_rad(heading_rad - self.pose.heading_rad))
            case RotateBy(angle_rad):
                self._turn(angle_rad)
            case DriveFor(travel_mps, rotate_radps, held_s):
                self._take(held_s, travel_mps * held_s, rotate_radps * held_s)
                self.pose = arc(self.pose, Velocity(travel_mps, rotate_radps), held_s)[1]

    def _go(self, waypoint: Waypoint) -> None:
        place = Point(waypoint.x_m, waypoint.y_m)
        distance_m = self.pose.point.distance_m(place)
        if distance_m > 0.0:
            turn_rad = wrap_rad(self.pose.point.bearing_rad(place) - self.pose.heading_rad)
            if self._settings.turn_drive.reverse and abs(turn_rad) > pi / 2:
                turn_rad = wrap_rad(turn_rad + pi)
            self._turn(turn_rad)
            self._drive(distance_m)
        self.pose = replace(self.pose, x_m=place.x_m, y_m=place.y_m)
        if waypoint.heading_rad is not None:
            self._turn(wrap_rad(waypoint.heading_rad - self.pose.heading_rad))

    def _drive(self, distance_m: float) -> None:
        limits = self._settings.drive
        bounds = Bounds(self.speeds.travel_mps, limits.travel_acceleration_mps2)
        self._take(duration_s(distance_m, bounds), distance_m, 0.0)

    def _turn(self, angle_rad: float) -> None:
        limits = self._settings.drive
        bounds = Bounds(self.speeds.rotate_radps, limits.rotate_acceleration_radps2)
        self._take(duration_s(angle_rad, bounds), 0.0, angle_rad)
        self.pose = replace(self.pose, heading_rad=wrap_rad(self.pose.heading_rad + angle_rad))

    def _take(self, took_s: float, length_m: float, turned_rad: float) -> None:
        prediction = self._settings.prediction
        curve_m = curved_m(length_m, turned_rad)
        way = Way(took_s, abs(length_m), abs(turned_rad), curve_m)
        self.energy_j += prediction.energy_j(way) or 0.0


def reckoned_j(
    request: Motion, pose: Pose, speeds: Speeds, settings: Settings, zones: Zones
) -> float:
    """Return what a motion takes from a pose; 0 where the settings do not say."""
    reckoning = _Reckoning(pose, speeds, settings, zones)
    reckoning.add(request)
    return reckoning.energy_j


def check_battery(
    what: Motion | PlanNode, pose: Pose, status: Status, settings: Settings
) -> Refusal | None:
    """Return why the battery cannot bring the rover back from a motion or a plan, or None.

    What ends no farther from home than it begins, and leads there with half as much again as the
    straight way takes at most, is not refused: it is the way home. A plan is reckoned without ways
    around obstacles.

    Args:
        what: what is asked for.
        pose: where it begins.
        status: knows the charge, the speeds that are set, and what to keep away from.
        settings: know what motion takes, and what the battery may give.
    """
    battery, told = settings.battery, status.battery
    if battery is None or told is None or told.charge_ratio is None:
        return None
    left_j = battery.left_j(told.charge_ratio)
    speeds = Speeds(status.travel_limit_mps, status.rotate_limit_radps)
    if isinstance(what, Motion):
        requests: Iterable[object] = (what,)
        zones = status.obstacles
    else:
        course, zones = expected_course(what), Zones()
        requests = (each.request for each in course if isinstance(each, Step))
    reckoning = _Reckoning(pose, speeds, settings, zones)
    for request in _motions(requests, reckoning):
        reckoning.add(request)
        if reckoning.energy_j > battery.capacity_j:
            break
    home, end = battery.home, reckoning.pose.point
    to_home = MoveTo(Waypoint(home.x_m, home.y_m))
    back_j = reckoned_j(to_home, reckoning.pose, speeds, settings, zones)
    if status.uncertainty:  # home may be as much farther away
        farther = MoveForward(status.uncertainty.position_at_m(end.distance_m(home)))
        back_j += reckoned_j(farther, Pose(), speeds, settings, Zones())
    needed_j = reckoning.energy_j + back_j
    if reckoning.energy_j == 0.0 or needed_j <= left_j:
        return None
    nearer = end.distance_m(home) <= pose.point.distance_m(home)
    if nearer and needed_j <= DETOUR * reckoned_j(to_home, pose, speeds, settings, zones):
        return None
    reserve_j = battery.reserve_ratio * battery.capacity_j
    return Refusal(
        Reason.BATTERY_SHORT,
        f"it takes {reckoning.energy_j:.0f} J and the way back home {back_j:.0f} J, but the battery"
        f" has {left_j:.0f} J above its reserve of {battery.reserve_ratio:.0%}",
        (
            Figure("needed", needed_j, "J"),
            Figure("way back", back_j, "J"),
            Figure("left", left_j, "J"),
            Figure("reserve", reserve_j, "J"),
        ),
    )


def _motions(requests: Iterable[object], reckoning: _Reckoning) -> Iterator[Motion]:
    """Yield the motions among requests; speeds that are set among them hold from there on."""
    for request in requests:
        match request:
            case SetTravelSpeed(speed_mps):
                reckoning.speeds = replace(reckoning.speeds, travel_mps=speed_mps)
            case SetRotateSpeed(speed_radps):
                reckoning.speeds = replace(reckoning.speeds, rotate_radps=speed_radps)
            case _ if isinstance(request, Motion):
                yield request
            case _:
                pass
