"""Arguments of a request against the asset's bounds: finite, in range, supported."""

from math import inf, isfinite, pi
from typing import assert_never

from executive.commands.catalogue import (
    DeleteFile,
    DriveFor,
    ExecuteAction,
    FollowPath,
    MoveCameraAngles,
    MoveFile,
    MoveForward,
    MoveTo,
    PlanRequest,
    Request,
    Resume,
    RotateBy,
    RotateTo,
    SetCameraAngles,
    SetCameraRotateSpeed,
    SetPositionCompensation,
    SetRotateSpeed,
    SetStatusInterval,
    SetTravelSpeed,
    Stop,
    TakePicture,
    Waypoint,
)
from executive.geometry import Point
from executive.reasons import Figure, Reason, Refusal
from executive.settings import Settings
from executive.state import check_path

SLOWEST = 0.01
SHORTEST_INTERVAL_S = 0.05
LONGEST_INTERVAL_S = 3600.0


def check(request: Request, settings: Settings, here: Point) -> Refusal | None:
    """Return why the arguments cannot be accepted, or None.

    Args:
        request: what was asked.
        settings: the asset's bounds.
        here: where the rover stands, for the distance to targets.
    """
    drive, camera = settings.drive, settings.camera
    if isinstance(request, PlanRequest):
        return None
    match request:
        case MoveTo(target):
            return _waypoint(target, here, settings)
        case FollowPath(waypoints):
            return _path(waypoints, here, settings)
        case MoveForward(distance_m):
            return _bound("distance", distance_m, -drive.distance_m, drive.distance_m, "m")
        case RotateTo(angle_rad) | RotateBy(angle_rad):
            return _bound("angle", angle_rad, -2 * pi, 2 * pi, "rad")
        case DriveFor(travel_mps, rotate_radps, duration_s):
            return (
                _bound("travel", travel_mps, -drive.travel_speed_mps, drive.travel_speed_mps, "m/s")
                or _bound(
                    "rotate",
                    rotate_radps,
                    -drive.rotate_speed_radps,
                    drive.rotate_speed_radps,
                    "rad/s",
                    argument=2,
                )
                or _bound("duration", duration_s, 0.0, drive.duration_s, "s", argument=3)
            )
        case SetTravelSpeed(speed_mps):
            return _bound("speed", speed_mps, SLOWEST, drive.travel_speed_mps, "m/s")
        case SetRotateSpeed(speed_radps):
            return _bound("speed", speed_radps, SLOWEST, drive.rotate_speed_radps, "rad/s")
        case SetCameraRotateSpeed(speed_radps):
            return _bound("speed", speed_radps, SLOWEST, camera.rotate_speed_radps, "rad/s")
        case SetPositionCompensation(x_m, y_m, z_m, heading_rad):
            return (
                _bound("x", x_m, -drive.compensation_m, drive.compensation_m, "m")
                or _bound("y", y_m, -drive.compensation_m, drive.compensation_m, "m", argument=2)
                or _bound("z", z_m, -drive.compensation_m, drive.compensation_m, "m", argument=3)
                or _bound("heading", heading_rad, -2 * pi, 2 * pi, "rad", argument=4)
            )
        case SetCameraAngles(pan_rad, tilt_rad):
            return (
                None
                if pan_rad is None
                else _bound("pan", pan_rad, camera.pan_min_rad, camera.pan_max_rad, "rad")
            ) or (
                None
                if tilt_rad is None
                else _bound(
                    "tilt", tilt_rad, camera.tilt_min_rad, camera.tilt_max_rad, "rad", argument=2
                )
            )
        case MoveCameraAngles(pan_rad, tilt_rad):
            pan_span = camera.pan_max_rad - camera.pan_min_rad
            tilt_span = camera.tilt_max_rad - camera.tilt_min_rad
            return _bound("pan", pan_rad, -pan_span, pan_span, "rad") or _bound(
                "tilt", tilt_rad, -tilt_span, tilt_span, "rad", argument=2
            )
        case TakePicture():
            return _picture(request, settings)
        case SetStatusInterval(interval_s):
            if interval_s == 0.0:
                return None
            return _bound("interval", interval_s, SHORTEST_INTERVAL_S, LONGEST_INTERVAL_S, "s")
        case DeleteFile(path):
            return check_path(path)
        case MoveFile(path, target):
            return check_path(path) or check_path(target, argument=2)
        case ExecuteAction() | Stop() | Resume():
            return None
        case _:
            assert_never(request)


def _bound(
    name: str, value: float, low: float, high: float, unit: str, argument: int = 1
) -> Refusal | None:
    if not isfinite(value):
        return Refusal(
            Reason.NOT_FINITE,
            f"{name} is {value}: a finite number is needed",
            (Figure(name, value, unit),),
            argument,
        )
    if low <= value <= high:
        return None
    bound = low if value < low else high
    side = "below" if value < low else "above"
    return Refusal(
        Reason.OUT_OF_RANGE,
        f"{name} {value:g} {unit} is {side} its bound of {bound:g} {unit}",
        (Figure(name, value, unit), Figure("bound", bound, unit)),
        argument,
    )


def _waypoint(target: Waypoint, here: Point, settings: Settings) -> Refusal | None:
    unbounded = (
        ("x", target.x_m, "m"),
        ("y", target.y_m, "m"),
        ("heading", target.heading_rad, "rad"),
        ("tolerance", target.tolerance_m, "m"),
    )
    for name, value, unit in unbounded:
        if value is not None and (refusal := _bound(name, value, -inf, inf, unit)):
            return refusal
    distance_m = here.distance_m(Point(target.x_m, target.y_m))
    return (
        _bound("distance", distance_m, 0.0, settings.drive.distance_m, "m")
        or (
            None
            if target.heading_rad is None
            else _bound("heading", target.heading_rad, -2 * pi, 2 * pi, "rad")
        )
        or (
            None
            if target.tolerance_m is None
            else _bound("tolerance", target.tolerance_m, SLOWEST, 1.0, "m")
        )
    )


def _path(waypoints: tuple[Waypoint, ...], here: Point, settings: Settings) -> Refusal | None:
    if not waypoints:
        return Refusal(Reason.EMPTY_PATH, "the path has no waypoint: give one at least", argument=1)
    refusal = _bound("waypoints", len(waypoints), 1, settings.drive.path_waypoints, "")
    for waypoint in waypoints:
        refusal = refusal or _waypoint(waypoint, here, settings)
        here = Point(waypoint.x_m, waypoint.y_m)
    return refusal


def _picture(request: TakePicture, settings: Settings) -> Refusal | None:
    camera = settings.camera
    if request.format is not None and request.format not in camera.formats:
        return Refusal(
            Reason.NOT_SUPPORTED,
            f"format {request.format[:20]}: this camera gives {', '.join(camera.formats)}",
            argument=1,
        )
    for name, asked, given in (
        ("width", request.width_px, camera.width_px),
        ("height", request.height_px, camera.height_px),
    ):
        if asked is not None and asked != given:
            return Refusal(
                Reason.NOT_SUPPORTED,
                f"{name} {asked}: this camera gives {given}",
                (Figure(name, asked, "px"), Figure("bound", given, "px")),
                argument=1,
            )
    if request.quality is not None:
        return Refusal(
            Reason.NOT_SUPPORTED, "the quality of this camera's pictures is fixed", argument=1
        )
    return None
