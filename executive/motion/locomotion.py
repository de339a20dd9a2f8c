"""`Locomotion`: the port through which leaves make motions; `plan_leg`; profiles of the speed.

Leaves plan a `Leg`, request a `Motion` of a `Locomotion` and write its intent. The arbiter passes
that to a `BaseDriver`, which alone commands the rover. `velocity_control` is for rovers that accept
velocities, `delegated_motion` for those that execute whole motions themselves.

The steered point is the control point: the point ahead of base_link that rests while the rover
spins. The target is shifted by the same offset, so that base_link ends at the commanded position.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import copysign, pi, sqrt
from typing import Final, Protocol, assert_never

from executive.commands import Command, Curve, DriveFor, MoveForward, RotateBy, RotateTo, Waypoint
from executive.settings import Settings, SpeedProfileKind
from executive.state import Status
from executive.values.geometry import Point, Pose, Velocity, wrap_rad
from executive.values.ports import DriveBy, MotionIntent, NavigateTo, TurnBy
from executive.values.reasons import Refusal


@dataclass(frozen=True, slots=True)
class Bounds:
    """Maximum speed and acceleration, in units of the dimension (m or rad) and seconds."""

    speed: float
    acceleration: float


def duration_s(distance: float, bounds: Bounds) -> float:
    """Return the minimum time from rest to rest over a distance (bang-bang or trapezoid)."""
    distance = abs(distance)
    if distance <= bounds.speed**2 / bounds.acceleration:
        return 2.0 * sqrt(distance / bounds.acceleration)
    return distance / bounds.speed + bounds.speed / bounds.acceleration


MAX_SPEED_PER_DISTANCE: Final = 10.0
"""Maximum speed per remaining distance of `SquareRoot`: it reaches the end without hunting."""
CATCH_UP_PER_S: Final = 2.0
"""Gain of `Trapezoid`: speed per unit of lag behind the schedule."""


@dataclass(frozen=True, slots=True)
class SquareRoot:
    """The maximum speed that still allows a stop at the target, braking in steps of one tick."""

    bounds: Bounds
    tick_s: float

    def speed(self, left: float, elapsed_s: float) -> float:
        """Return the speed to command.

        Args:
            left: signed remaining distance when the command takes effect, in m or rad.
            elapsed_s: seconds since the motion began; not used here.
        """
        step = self.bounds.acceleration * self.tick_s / 2.0
        fastest = sqrt(step**2 + 2.0 * self.bounds.acceleration * abs(left)) - step
        return copysign(min(fastest, self.bounds.speed, MAX_SPEED_PER_DISTANCE * abs(left)), left)


@dataclass(frozen=True, slots=True)
class Trapezoid:
    """A schedule of distance over time, followed with proportional feedback.

    Attributes:
        distance: signed distance of the whole motion.
    """

    bounds: Bounds
    distance: float

    def speed(self, left: float, elapsed_s: float) -> float:
        """Return the scheduled speed, corrected by the lag behind the schedule.

        Ahead of the schedule the rover waits. It reverses only beyond the target.
        """
        left_scheduled, speed = self._schedule(elapsed_s)
        behind = left - copysign(left_scheduled, self.distance)
        wanted = copysign(speed, self.distance) + CATCH_UP_PER_S * behind
        if wanted * left < 0.0:
            return 0.0
        return max(-self.bounds.speed, min(self.bounds.speed, wanted))

    def _schedule(self, elapsed_s: float) -> tuple[float, float]:
        distance, acceleration = abs(self.distance), self.bounds.acceleration
        total_s = duration_s(distance, self.bounds)
        peak = min(self.bounds.speed, sqrt(distance * acceleration))
        ramp_s = peak / acceleration
        if elapsed_s < ramp_s:
            return distance - acceleration * elapsed_s**2 / 2.0, acceleration * elapsed_s
        if elapsed_s < total_s - ramp_s:
            return distance - peak * (elapsed_s - ramp_s / 2.0), peak
        left_s = max(total_s - elapsed_s, 0.0)
        return acceleration * left_s**2 / 2.0, acceleration * left_s


SpeedProfile = SquareRoot | Trapezoid


def make_profile(
    kind: SpeedProfileKind, bounds: Bounds, distance: float, tick_s: float
) -> SpeedProfile:
    """Return the profile that the settings name, for a signed distance."""
    match kind:
        case SpeedProfileKind.TRAPEZOID:
            return Trapezoid(bounds, distance)
        case SpeedProfileKind.SQUARE_ROOT:
            return SquareRoot(bounds, tick_s)
        case _:
            assert_never(kind)


MIN_POSITION_TOLERANCE_M: Final = 0.005
FORWARD_FAVOUR_S: Final = 0.05

Step = Waypoint | MoveForward | RotateTo | RotateBy


@dataclass(frozen=True, slots=True)
class Leg:
    """One step of a motion goal, planned from the present pose.

    Attributes:
        toward_rad: heading to turn to before driving; None to drive off without a turn.
        target: end position of the control point; None for a turn alone.
        reverse: whether to drive backward.
        heading_rad: heading at the end; None to stay as the drive ends.
        turn_rad: signed angle of the turn to that heading; None for the shorter direction.
        compensated_target: end of the line, uphill of the target by the slide of the last turn.
        via_points: waypoints to pass without stopping.
        detour_points: corners of a detour around obstacles, if it is driven as a curve.
        force_turn_then_drive: whether turns and lines drive it, for any controller.
        curves: arcs of its turn, for a base that cannot turn on the spot.
        navigation: the task of the navigation, if that drives it; the rest of a relative one is
            derived from target and heading.
        path: of base_link, if the navigation drives it: that of its planner, or straight lines.
    """

    toward_rad: float | None
    target: Point | None
    reverse: bool
    heading_rad: float | None
    tolerance_m: float
    turn_rad: float | None = None
    compensated_target: Point | None = None
    via_points: tuple[Waypoint, ...] = ()
    detour_points: tuple[Point, ...] = ()
    force_turn_then_drive: bool = False
    curves: tuple[Curve, ...] = ()
    navigation: NavigateTo | DriveBy | TurnBy | None = None
    path: tuple[Point, ...] = ()

    def moved(self, origin: Pose) -> "Leg":
        """Return the end of the leg after its frame has moved, to be compared with the pose."""
        if self.target is None:
            return replace(self, heading_rad=_turned(self.heading_rad, origin))
        end = origin.compose(Pose(self.target.x_m, self.target.y_m))
        return replace(
            self,
            target=end.point,
            heading_rad=_turned(self.heading_rad, origin),
            via_points=tuple(each.moved(origin) for each in self.via_points),
        )

    @property
    def free(self) -> bool:
        """Whether base_link ends at the target, at any heading."""
        navigated = isinstance(self.navigation, NavigateTo)
        any_end = bool(self.via_points or self.detour_points) or navigated
        return any_end and self.heading_rad is None


def _turned(heading_rad: float | None, origin: Pose) -> float | None:
    return None if heading_rad is None else wrap_rad(heading_rad + origin.heading_rad)


def turn_bounds(settings: Settings, status: Status) -> Bounds:
    """Return the maximum speed and acceleration of a turn."""
    return Bounds(status.rotate_limit_radps, settings.drive.rotate_acceleration_radps2)


def plan_leg(
    step: Step,
    settings: Settings,
    status: Status,
    through: Sequence[Waypoint] = (),
    around: Sequence[Point] = (),
    navigated: bool = False,
) -> Leg:
    """Return the leg from the present pose through a step.

    Args:
        step: the end of the leg.
        settings: the asset.
        status: the pose and the speed limits.
        through: waypoints to pass before, without stopping.
        around: corners of a detour around obstacles, without stopping.
        navigated: whether the navigation drives it.
    """
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
            near_m = min(near_m, max(abs(distance_m) / 2, MIN_POSITION_TOLERANCE_M))
            return Leg(None, target, distance_m < 0, None, near_m)
        case Waypoint() if through or around or (navigated and not _reached(step, pose, settings)):
            return _along_path(step, through, around, settings, pose)
        case Waypoint():
            return _to_waypoint(step, settings, status)


def _along_path(
    waypoint: Waypoint,
    through: Sequence[Waypoint],
    around: Sequence[Point],
    settings: Settings,
    pose: Pose,
) -> Leg:
    law, point = settings.turn_drive, Point(waypoint.x_m, waypoint.y_m)
    before = [pose.point, *around, *(Point(each.x_m, each.y_m) for each in through)]
    toward_rad = before[-1].bearing_rad(point)
    target, heading_rad = point, waypoint.heading_rad
    if heading_rad is not None:
        target = Pose(point.x_m, point.y_m, heading_rad=heading_rad).ahead(law.control_point_m)
    near_m = waypoint.tolerance_m or law.position_tolerance_m
    return Leg(
        toward_rad,
        target,
        False,
        heading_rad,
        near_m,
        via_points=tuple(through),
        detour_points=tuple(around),
    )


def _to_waypoint(waypoint: Waypoint, settings: Settings, status: Status) -> Leg:
    pose, law = status.pose, settings.turn_drive
    point = Point(waypoint.x_m, waypoint.y_m)
    near_m = waypoint.tolerance_m or law.position_tolerance_m
    if _reached(waypoint, pose, settings):
        return Leg(None, None, False, waypoint.heading_rad, near_m)
    forward = _towards(pose, point, waypoint, False, law.control_point_m, near_m)
    if not law.reverse:
        return _uphill(forward, pose, settings, status)
    backward = _towards(pose, point, waypoint, True, law.control_point_m, near_m)
    bounds = turn_bounds(settings, status)
    if _turning_s(pose, forward, bounds) <= _turning_s(pose, backward, bounds) + FORWARD_FAVOUR_S:
        return _uphill(forward, pose, settings, status)
    return _uphill(backward, pose, settings, status)


def _reached(waypoint: Waypoint, pose: Pose, settings: Settings) -> bool:
    """Return whether the rover is at a waypoint, and at most turns there."""
    law, end = settings.turn_drive, replace(pose, x_m=waypoint.x_m, y_m=waypoint.y_m)
    if waypoint.heading_rad is not None:
        end = replace(end, heading_rad=waypoint.heading_rad)
    turn_rad = abs(wrap_rad(end.heading_rad - pose.heading_rad))
    on_spot = settings.drive.min_turning_radius_m is None
    off_m = pose.ahead(law.control_point_m).distance_m(end.ahead(law.control_point_m))
    near_m = waypoint.tolerance_m or law.position_tolerance_m
    within = off_m <= effective_tolerance_m(near_m, settings) / 2
    return within and (on_spot or turn_rad <= law.heading_tolerance_rad)


def _uphill(leg: Leg, pose: Pose, settings: Settings, status: Status) -> Leg:
    """Return a leg that compensates the learnt slide of its turns on a slope."""
    if leg.target is None or leg.toward_rad is None:
        return leg
    start = pose.ahead(settings.turn_drive.control_point_m)
    first = status.turn_slide(wrap_rad(leg.toward_rad - pose.heading_rad))
    last = Point(0.0, 0.0)
    if leg.heading_rad is not None:
        last = status.turn_slide(wrap_rad(leg.heading_rad - leg.toward_rad))
    if first == last == Point(0.0, 0.0):
        return leg
    start = Point(start.x_m + first.x_m, start.y_m + first.y_m)
    aim = Point(leg.target.x_m - last.x_m, leg.target.y_m - last.y_m)
    toward_rad = wrap_rad(start.bearing_rad(aim) + (pi if leg.reverse else 0.0))
    return replace(leg, toward_rad=toward_rad, compensated_target=aim)


def effective_tolerance_m(tolerance_m: float, settings: Settings) -> float:
    """Return the tolerance to drive to: the smaller of the requested one and the asset's."""
    return min(tolerance_m, settings.turn_drive.position_tolerance_m)


def _towards(
    pose: Pose, point: Point, waypoint: Waypoint, reverse: bool, ahead_m: float, near_m: float
) -> Leg:
    start = pose.ahead(ahead_m)
    target = point
    if waypoint.heading_rad is not None:
        target = Pose(point.x_m, point.y_m, heading_rad=waypoint.heading_rad).ahead(ahead_m)
    heading = wrap_rad(start.bearing_rad(target) + (pi if reverse else 0.0))
    if waypoint.heading_rad is None:
        target = Pose(point.x_m, point.y_m, heading_rad=heading).ahead(ahead_m)
    return Leg(heading, target, reverse, waypoint.heading_rad, near_m)


def _turning_s(pose: Pose, leg: Leg, bounds: Bounds) -> float:
    if leg.toward_rad is None:
        return 0.0
    first = duration_s(wrap_rad(leg.toward_rad - pose.heading_rad), bounds)
    if leg.heading_rad is None:
        return first
    return first + duration_s(wrap_rad(leg.heading_rad - leg.toward_rad), bounds)


def leg_errors(leg: Leg, settings: Settings, status: Status) -> tuple[float, float]:
    """Return the distance of the rover from the end of a leg, in metres and radians."""
    pose, position_error_m, heading_rad = status.pose, 0.0, 0.0
    if leg.target is not None:
        ahead_m = 0.0 if leg.free else settings.turn_drive.control_point_m
        position_error_m = leg.target.distance_m(pose.ahead(ahead_m))
    if leg.heading_rad is not None:
        heading_rad = abs(wrap_rad(leg.heading_rad - pose.heading_rad))
    return position_error_m, heading_rad


class Motion(ABC):
    """A turn, a straight line or a velocity hold in execution.

    Attributes:
        expected_s: expected duration without disturbances.
        extra_s: additional time until its deadline.
        progress_note: a progress text to report; None without one.
        waypoints_passed: number of waypoints passed, of those of its leg.
    """

    expected_s: float
    extra_s: float = 0.0
    progress_note: str | None = None
    waypoints_passed: int = 0

    @property
    @abstractmethod
    def done(self) -> bool:
        """Whether the rover is stationary at the end of the motion."""

    @property
    def handover_allowed(self) -> bool:
        """Whether the next motion may start now; by default once this one is done."""
        return self.done

    @property
    def failure(self) -> Refusal | None:
        """Why the motion failed, or None."""
        return None

    @property
    def avoids_obstacles(self) -> bool:
        """Whether the motion itself avoids newly detected obstacles."""
        return False

    @property
    def aborted(self) -> bool:
        """Whether the rover is stationary and continues by a leg to the next waypoint alone."""
        return False

    @property
    def retry_as_curve(self) -> bool:
        """Whether the leg may be retried as a curve; otherwise turns and lines drive it."""
        return False

    @property
    @abstractmethod
    def remaining_text(self) -> str:
        """The remaining part of the motion, for display."""

    def update_limits(self, _: float) -> bool:
        """Plan again if the speed limit changed; return whether it did."""
        return False

    def observe(self, leg: Leg) -> None:
        """Compare the rover with the leg, which moves with its frame; only of a navigated one."""
        return

    @abstractmethod
    def intent(self, now_s: float) -> MotionIntent:
        """Return the intent of this tick."""


class Locomotion(Protocol):
    """Makes motions of commands, which begin now.

    Attributes:
        excludes_camera: whether the camera must not be pointed during a motion.
    """

    excludes_camera: bool

    def navigates(self, command: Command) -> bool:
        """Return whether a navigation drives the legs of a command."""
        return False

    def supports_curve(self, command: Command, waypoint: Waypoint) -> bool:
        """Return whether it drives to a waypoint in one curve, around obstacles between."""
        return False

    def can_pass_through(self, command: Command, waypoint: Waypoint) -> bool:
        """Return whether it passes an intermediate waypoint of a path without stopping."""
        return False

    def make_turn(self, command: Command, leg: Leg, final: bool) -> Motion | None:
        """Return the turn of a leg, towards its target or to its last heading; None without one."""

    def make_line(self, command: Command, leg: Leg) -> Motion | None:
        """Return the straight line of a leg, or None if it has none."""

    def make_velocity_hold(self, command: Command, request: DriveFor) -> Motion:
        """Return a velocity hold."""


class BaseDriver(Protocol):
    """Commands the rover's motion. Only `executive.motion.arbiter` calls it."""

    @property
    def velocity(self) -> Velocity:
        """The velocity that is commanded now."""

    @property
    def expected(self) -> tuple[Velocity, Velocity]:
        """The lower and upper bound of the expected velocity; equal where it is known exactly."""

    def stop(self) -> None:
        """Command zero velocity now."""

    def hold(self) -> None:
        """Hold zero velocity, in each tick after a stop."""

    def commit(self, wanted: MotionIntent | None, now_s: float, step_s: float) -> None:
        """Command the intent of this tick; None: no motion is wanted."""
