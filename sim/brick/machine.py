"""`Machine`: wheels and camera head as the emulated brick controls them, with their limits."""

from dataclasses import dataclass
from typing import assert_never

from executive.commands import (
    DriveFor,
    MoveCameraAngles,
    MoveForward,
    MoveTo,
    RotateBy,
    RotateTo,
    SetCameraAngles,
    SetCameraRotateSpeed,
    SetRotateSpeed,
    SetTravelSpeed,
)
from executive.values.geometry import Point, Pose
from sim.brick.motion import BrickSettings, CountOdometry, Motion, Rims, SegmentSequence, course
from sim.pan_tilt import (
    MAX_PAN_RAD,
    MAX_SPEED_RADPS,
    MAX_TILT_RAD,
    MIN_TILT_RAD,
    HeadController,
)

Work = (
    Motion
    | SetTravelSpeed
    | SetRotateSpeed
    | SetCameraAngles
    | MoveCameraAngles
    | SetCameraRotateSpeed
)
"""Commands that this brick executes, except stop."""

_MIN_SPEED = 0.01
_MAX_DISTANCE_M = 100.0
_MAX_ANGLE_RAD = 100.0
_STILL: Rims = (0.0, 0.0)


@dataclass(frozen=True, slots=True)
class SensorReadings:
    """Measurements of a period: wheel counts, voltage, angles of the head."""

    left_deg: int
    right_deg: int
    voltage_v: float
    pan_rad: float
    tilt_rad: float


@dataclass(frozen=True, slots=True)
class SetPoints:
    """Set points of the motors for a period."""

    left_radps: float
    right_radps: float
    pan_rad: float
    tilt_rad: float


class Machine:
    """The mechanics of one rover, from the view of its brick.

    Attributes:
        odometry: its estimated pose.
        senses: the last measurements.
        track_m: its assumed distance between the wheels.
        travel_mps, rotate_radps, camera_radps: speed set points.
        moving: whether a motion is active.
    """

    def __init__(self, settings: BrickSettings, track_m: float, start: Pose) -> None:
        self._settings = settings
        self.track_m = track_m
        self._head = HeadController()
        self._course: SegmentSequence | None = None
        self.odometry = CountOdometry(settings.wheel_radius_m, track_m, start)
        self.senses = SensorReadings(0, 0, 0.0, 0.0, 0.0)
        self.travel_mps = settings.first_travel_mps
        self.rotate_radps = settings.first_rotate_radps
        self.camera_radps = 0.5

    @property
    def moving(self) -> bool:
        """Whether a motion is active."""
        return self._course is not None

    def sense(self, now_s: float, senses: SensorReadings) -> None:
        """Process the measurements of a period."""
        self.senses = senses
        self.odometry.advance(now_s, senses.left_deg, senses.right_deg)

    def refusal(self, work: Work) -> str:
        """Return the reason to reject a command; empty to accept it."""
        fastest = self._settings
        match work:
            case SetTravelSpeed(speed_mps):
                return _bound("speed", speed_mps, _MIN_SPEED, fastest.travel_mps)
            case SetRotateSpeed(speed_radps):
                return _bound("speed", speed_radps, _MIN_SPEED, fastest.rotate_radps)
            case SetCameraRotateSpeed(speed_radps):
                return _bound("speed", speed_radps, _MIN_SPEED, MAX_SPEED_RADPS)
            case MoveForward(distance_m):
                return _bound("distance", distance_m, -_MAX_DISTANCE_M, _MAX_DISTANCE_M)
            case MoveTo(target):
                here, there = self.odometry.pose.point, Point(target.x_m, target.y_m)
                return _bound("distance", here.distance_m(there), 0.0, _MAX_DISTANCE_M)
            case RotateBy(angle_rad) | RotateTo(angle_rad):
                return _bound("angle", angle_rad, -_MAX_ANGLE_RAD, _MAX_ANGLE_RAD)
            case DriveFor(travel_mps, rotate_radps, duration_s):
                return (
                    _bound("travel", abs(travel_mps), 0.0, fastest.travel_mps)
                    or _bound("rotate", abs(rotate_radps), 0.0, fastest.rotate_radps)
                    or _bound("duration", duration_s, 0.0, fastest.hold_s)
                )
            case SetCameraAngles(pan_rad, tilt_rad):
                return _bound("pan", pan_rad or 0.0, -MAX_PAN_RAD, MAX_PAN_RAD) or _bound(
                    "tilt", tilt_rad or 0.0, MIN_TILT_RAD, MAX_TILT_RAD
                )
            case MoveCameraAngles():
                return ""
            case _:
                assert_never(work)

    def begin(self, work: Work) -> None:
        """Execute a setting, or start a motion."""
        match work:
            case SetTravelSpeed(speed_mps):
                self.travel_mps = speed_mps
            case SetRotateSpeed(speed_radps):
                self.rotate_radps = speed_radps
            case SetCameraRotateSpeed(speed_radps):
                self.camera_radps = speed_radps
                self._head.set_speed(speed_radps)
            case SetCameraAngles(pan_rad, tilt_rad):
                self._point(pan_rad, tilt_rad)
            case MoveCameraAngles(pan_rad, tilt_rad):
                seen = self.senses
                self._point(seen.pan_rad + pan_rad, seen.tilt_rad + tilt_rad)
            case MoveTo() | MoveForward() | RotateTo() | RotateBy() | DriveFor():
                self._course = course(
                    work,
                    self.travel_mps,
                    self.rotate_radps,
                    self.track_m,
                    self.odometry,
                    self._settings,
                )
            case _:
                assert_never(work)

    def brake(self) -> None:
        """Abort the active motion: the wheels are held from now on."""
        self._course = None

    def set_points(self, period_s: float) -> SetPoints:
        """Return the set points of the motors for the next period; the motion may end here.

        Raises:
            sim.brick.motion.StuckError: a wheel does not turn; the motion is aborted.
        """
        rims_mps: Rims | None = None
        course, self._course = self._course, None
        if course is not None:
            rims_mps = course.rims_mps(period_s)
            self._course = None if rims_mps is None else course
        left_mps, right_mps = rims_mps or _STILL
        radius_m = self._settings.wheel_radius_m
        return SetPoints(
            left_mps / radius_m, right_mps / radius_m, *self._head.setpoints_rad(period_s)
        )

    def _point(self, pan_rad: float | None, tilt_rad: float | None) -> None:
        pan_now_rad, tilt_now_rad = self._head.target_rad
        self._head.point(
            pan_now_rad if pan_rad is None else pan_rad,
            tilt_now_rad if tilt_rad is None else tilt_rad,
        )


def _bound(name: str, value: float, low: float, high: float) -> str:
    return "" if low <= value <= high else f"{name} {value:g} is not within {low:g} and {high:g}"
