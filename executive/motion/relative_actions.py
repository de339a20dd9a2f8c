"""Relative motions by actions of the navigation: drive_on_heading and spin of Nav2, or Create 3's.

The target of the leg is the executive's own. The distance or angle of each request is the rest to
it, so that a second request does not repeat the whole motion. The rover itself drives the rest
after the end.
"""

from dataclasses import replace
from math import cos, sin
from typing import Final

from executive.commands import MoveForward, RotateBy
from executive.motion.locomotion import Leg, Step
from executive.settings import RelativeActions, Settings
from executive.state import Status
from executive.values.geometry import wrap_rad
from executive.values.ports import DriveBy, NavigateTo, TurnBy

MAX_TURN_RAD: Final = 2.8
"""Maximum turn by an action: the heading alone does not show whether a larger one was made."""


def act_relatively(leg: Leg, step: Step, settings: Settings, status: Status) -> Leg:
    """Return the leg of a step, as an action of the navigation if it is relative and that has one.

    Larger turns are the executive's own, and those of a base that cannot turn on the spot.
    """
    navigation = settings.navigation
    if navigation is None or navigation.relative is RelativeActions.OFF or leg.curves:
        return leg
    match step:
        case MoveForward(distance_m):
            return replace(leg, navigation=DriveBy(distance_m, status.travel_limit_mps))
        case RotateBy(angle_rad) if abs(angle_rad) <= MAX_TURN_RAD:
            return replace(leg, navigation=TurnBy(angle_rad, status.rotate_limit_radps))
        case _:
            return leg


def finish_relative(leg: Leg, settings: Settings, status: Status) -> Leg | None:
    """Return the rest of a relative leg at the end of its action; None for any other leg."""
    if leg.navigation is None or isinstance(leg.navigation, NavigateTo):
        return None
    backward = leg.target is not None and _left_m(leg, settings, status) < 0.0
    return replace(leg, navigation=None, turn_rad=None, reverse=backward)


def remaining_action(leg: Leg, settings: Settings, status: Status) -> DriveBy | TurnBy:
    """Return the action of a leg by the rest of its distance or angle."""
    match leg.navigation:
        case TurnBy() as turn:
            assert leg.heading_rad is not None
            return replace(turn, angle_rad=wrap_rad(leg.heading_rad - status.pose.heading_rad))
        case DriveBy() as drive:
            return replace(drive, distance_m=_left_m(leg, settings, status))
        case other:
            raise TypeError(f"{other} is no relative action")


def _left_m(leg: Leg, settings: Settings, status: Status) -> float:
    """Return the distance to the target along the heading, negative behind the rover."""
    assert leg.target is not None
    pose, heading_rad = status.pose, status.pose.heading_rad
    control = pose.ahead(settings.turn_drive.control_point_m)
    ahead_m = (leg.target.x_m - control.x_m) * cos(heading_rad)
    return ahead_m + (leg.target.y_m - control.y_m) * sin(heading_rad)
