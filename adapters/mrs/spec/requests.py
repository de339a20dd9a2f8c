"""Requests of the core as MRS operations, and back: one row an operation that carries a command."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, assert_never

from adapters.mrs.spec import types
from adapters.mrs.spec.values import definition_of, wire_definition
from executive.commands import (
    AbortPlan,
    ActivatePlan,
    DeleteFile,
    DriveFor,
    ExecuteAction,
    FollowPath,
    MoveCameraAngles,
    MoveFile,
    MoveForward,
    MoveTo,
    RemovePlan,
    Request,
    Resume,
    ResumePlan,
    RotateBy,
    RotateTo,
    SetCameraAngles,
    SetCameraRotateSpeed,
    SetPositionCompensation,
    SetRotateSpeed,
    SetStatusInterval,
    SetTravelSpeed,
    Stop,
    SubmitPlan,
    SuspendPlan,
    TakePicture,
    Waypoint,
)


@dataclass(frozen=True, slots=True)
class Invocation:
    """An operation to call, with the parts that follow the command header."""

    service: str
    operation: str
    parts: tuple[Any, ...] = ()


def _waypoint(wire: types.Waypoint) -> Waypoint:
    return Waypoint(wire.x, wire.y, wire.heading, wire.tolerance)


def _wire_waypoint(place: Waypoint) -> types.Waypoint:
    return types.Waypoint(
        x=place.x_m, y=place.y_m, heading=place.heading_rad, tolerance=place.tolerance_m
    )


def _picture(settings: types.PictureSettings | None) -> TakePicture:
    if settings is None:
        return TakePicture()
    return TakePicture(settings.width, settings.height, settings.format, settings.quality)


def _wire_picture(request: TakePicture) -> types.PictureSettings | None:
    if request == TakePicture():
        return None
    return types.PictureSettings(
        width=request.width_px,
        height=request.height_px,
        format=request.format,
        quality=request.quality,
    )


REQUESTS: Final[Mapping[tuple[str, str], Callable[..., Request]]] = {
    ("Action", "execute"): ExecuteAction,
    ("Camera", "takePicture"): _picture,
    ("Camera", "setAngles"): SetCameraAngles,
    ("Camera", "moveAngles"): MoveCameraAngles,
    ("Camera", "setRotateSpeed"): SetCameraRotateSpeed,
    ("FileManagement", "delete"): DeleteFile,
    ("FileManagement", "move"): MoveFile,
    ("MotionControl", "moveTo"): lambda target: MoveTo(_waypoint(target)),
    ("MotionControl", "moveForward"): MoveForward,
    ("MotionControl", "rotateTo"): RotateTo,
    ("MotionControl", "rotateBy"): RotateBy,
    ("MotionControl", "drive"): DriveFor,
    ("MotionControl", "followPath"): lambda path: FollowPath(tuple(map(_waypoint, path))),
    ("MotionControl", "stop"): Stop,
    ("MotionControl", "resume"): Resume,
    ("MotionControl", "setTravelSpeed"): SetTravelSpeed,
    ("MotionControl", "setRotateSpeed"): SetRotateSpeed,
    ("MotionControl", "setPositionCompensation"): SetPositionCompensation,
    ("Plan", "submitPlan"): lambda plan: SubmitPlan(definition_of(plan)),
    ("Plan", "activatePlan"): ActivatePlan,
    ("Plan", "suspendPlan"): SuspendPlan,
    ("Plan", "resumePlan"): ResumePlan,
    ("Plan", "abortPlan"): AbortPlan,
    ("Plan", "removePlan"): RemovePlan,
    ("Status", "setStatusInterval"): SetStatusInterval,
}
"""What makes a request of the parts that follow the command header, by service and operation."""


def invocation(request: Request) -> Invocation:
    """Return the operation that carries a request."""
    match request:
        case MoveTo(target):
            return Invocation("MotionControl", "moveTo", (_wire_waypoint(target),))
        case MoveForward(distance_m):
            return Invocation("MotionControl", "moveForward", (distance_m,))
        case RotateTo(heading_rad):
            return Invocation("MotionControl", "rotateTo", (heading_rad,))
        case RotateBy(angle_rad):
            return Invocation("MotionControl", "rotateBy", (angle_rad,))
        case DriveFor(travel_mps, rotate_radps, duration_s):
            return Invocation("MotionControl", "drive", (travel_mps, rotate_radps, duration_s))
        case FollowPath(waypoints):
            path = tuple(map(_wire_waypoint, waypoints))
            return Invocation("MotionControl", "followPath", (path,))
        case Stop():
            return Invocation("MotionControl", "stop")
        case Resume():
            return Invocation("MotionControl", "resume")
        case SetTravelSpeed(speed_mps):
            return Invocation("MotionControl", "setTravelSpeed", (speed_mps,))
        case SetRotateSpeed(speed_radps):
            return Invocation("MotionControl", "setRotateSpeed", (speed_radps,))
        case SetPositionCompensation(x_m, y_m, z_m, heading_rad):
            offsets = (x_m, y_m, z_m, heading_rad)
            return Invocation("MotionControl", "setPositionCompensation", offsets)
        case SetCameraAngles(pan_rad, tilt_rad):
            return Invocation("Camera", "setAngles", (pan_rad, tilt_rad))
        case MoveCameraAngles(pan_rad, tilt_rad):
            return Invocation("Camera", "moveAngles", (pan_rad, tilt_rad))
        case SetCameraRotateSpeed(speed_radps):
            return Invocation("Camera", "setRotateSpeed", (speed_radps,))
        case TakePicture():
            return Invocation("Camera", "takePicture", (_wire_picture(request),))
        case SetStatusInterval(interval_s):
            return Invocation("Status", "setStatusInterval", (interval_s,))
        case DeleteFile(path):
            return Invocation("FileManagement", "delete", (path,))
        case MoveFile(path, target):
            return Invocation("FileManagement", "move", (path, target))
        case ExecuteAction(action):
            return Invocation("Action", "execute", (action,))
        case SubmitPlan(plan):
            return Invocation("Plan", "submitPlan", (wire_definition(plan),))
        case ActivatePlan(plan_id):
            return Invocation("Plan", "activatePlan", (plan_id,))
        case SuspendPlan(plan_id):
            return Invocation("Plan", "suspendPlan", (plan_id,))
        case ResumePlan(plan_id):
            return Invocation("Plan", "resumePlan", (plan_id,))
        case AbortPlan(plan_id):
            return Invocation("Plan", "abortPlan", (plan_id,))
        case RemovePlan(plan_id):
            return Invocation("Plan", "removePlan", (plan_id,))
        case _:
            assert_never(request)
