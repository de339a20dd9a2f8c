"""One motion that the brick carries out: strokes one after the other, by its own odometry."""

from collections import deque
from collections.abc import Callable, Sequence
from typing import assert_never

from executive.commands import DriveFor, MoveForward, MoveTo, RotateBy, RotateTo
from executive.geometry import Point, Pose, wrap_rad
from sim.brick.odometry import CountOdometry, Rims
from sim.brick.settings import BrickSettings
from sim.brick.strokes import Holding, Stroke, line, turn

Motion = MoveTo | MoveForward | RotateTo | RotateBy | DriveFor
Planned = Callable[[Pose], Stroke]
"""A stroke, made when its turn comes, from the pose that the one before has led to."""

_STILL: Rims = (0.0, 0.0)
_SHOULD_TURN_MPS = 0.005
_NEAR_M = 0.005
"""A place that is nearer needs no driving."""


class StuckError(Exception):
    """A wheel shall turn and does not; the text says which."""


class Course:
    """The strokes of one motion, each begun when the rover stands."""

    def __init__(
        self, strokes: Sequence[Planned], odometry: CountOdometry, settings: BrickSettings
    ) -> None:
        """Begin with the next period."""
        self._waiting = deque(strokes)
        self._odometry = odometry
        self._settings = settings
        self._stroke: Stroke | None = None
        self._begun_m: Rims = _STILL
        self._watched = [(0.0, 0.0), (0.0, 0.0)]
        self._rolling_mps = _STILL

    def rims_mps(self, period_s: float) -> Rims | None:
        """Return the speeds of the rims for the next period; None when all is done and it stands.

        Raises:
            StuckError: a wheel does not turn.
        """
        rims_m = self._odometry.rims_m
        self._look_after_wheels(rims_m, period_s)
        if self._stroke is None and self._odometry.standing:
            if not self._waiting:
                return None
            self._stroke, self._begun_m = self._waiting.popleft()(self._odometry.pose), rims_m
        self._rolling_mps = _STILL
        if self._stroke is not None:
            rolled_m = (rims_m[0] - self._begun_m[0], rims_m[1] - self._begun_m[1])
            rolling_mps = self._stroke.rims_mps(rolled_m, period_s)
            if rolling_mps is None:
                self._stroke = None
            else:
                self._rolling_mps = rolling_mps
        return self._rolling_mps

    def _look_after_wheels(self, rims_m: Rims, period_s: float) -> None:
        for number, side in enumerate(("left", "right")):
            seen_m, still_s = self._watched[number]
            turns = rims_m[number] != seen_m or abs(self._rolling_mps[number]) < _SHOULD_TURN_MPS
            still_s = 0.0 if turns else still_s + period_s
            self._watched[number] = (rims_m[number], still_s)
            if still_s >= self._settings.stuck_s:
                raise StuckError(f"the {side} motor is stuck")


def course(
    motion: Motion,
    speed_mps: float,
    speed_radps: float,
    track_m: float,
    odometry: CountOdometry,
    settings: BrickSettings,
) -> Course:
    """Return the course of a motion: turn, line, turn where it leads to a place."""

    def turned(angle_rad: float) -> Stroke:
        return turn(angle_rad, speed_radps, track_m, settings)

    def headed(heading_rad: float) -> Planned:
        return lambda pose: turned(wrap_rad(heading_rad - pose.heading_rad))

    match motion:
        case MoveForward(distance_m):
            strokes: list[Planned] = [lambda _: line(distance_m, speed_mps, settings)]
        case RotateBy(angle_rad):
            strokes = [lambda _: turned(angle_rad)]
        case RotateTo(heading_rad):
            strokes = [headed(heading_rad)]
        case MoveTo(target):
            place = Point(target.x_m, target.y_m)
            strokes = [
                lambda pose: headed(pose.point.bearing_rad(place))(pose),
                lambda pose: line(pose.point.distance_m(place), speed_mps, settings),
            ]
            if odometry.pose.point.distance_m(place) < _NEAR_M:
                strokes.clear()
            if target.heading_rad is not None:
                strokes.append(headed(target.heading_rad))
        case DriveFor(travel_mps, rotate_radps, duration_s):
            across_mps = rotate_radps * track_m / 2
            rims = (travel_mps - across_mps, travel_mps + across_mps)
            strokes = [lambda _: Holding(*rims, duration_s, settings)]
        case _:
            assert_never(motion)
    return Course(strokes, odometry, settings)
