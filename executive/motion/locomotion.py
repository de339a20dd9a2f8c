"""How an asset moves: legs, speed profiles, and the port between leaves and rovers.

Leaves plan a `Leg`, ask a `Locomotion` for a `Motion` and write what it wants into the intents.
The arbiter gives that to a `BaseDriver`, which alone commands the rover. `velocity_control` is for
rovers that take velocities, `delegated_motion` for those that carry out whole motions themselves.

What is steered is the control point, the point ahead of base_link that stands still when the
rover spins; the target is shifted by as much, so that base_link ends where it was sent.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import copysign, pi, sqrt
from typing import Final, Protocol, assert_never

from executive.commands import Command, DriveFor, MoveForward, RotateBy, RotateTo, Waypoint
from executive.settings import Settings, SpeedProfileKind
from executive.state import Status
from executive.values.geometry import Point, Pose, Velocity, wrap_rad
from executive.values.ports import Wanted
from executive.values.reasons import Refusal


@dataclass(frozen=True, slots=True)
class Bounds:
    """Greatest speed and acceleration, in units of the dimension (m or rad) and seconds."""

    speed: float
    acceleration: float


def duration_s(way: float, bounds: Bounds) -> float:
    """Return the shortest time from rest to rest over a way (bang-bang or trapezoid)."""
    way = abs(way)
    if way <= bounds.speed**2 / bounds.acceleration:
        return 2.0 * sqrt(way / bounds.acceleration)
    return way / bounds.speed + bounds.speed / bounds.acceleration


STEEPEST_PER_S: Final = 10.0
"""Greatest speed per way left of `SquareRoot`, so that the end is reached without hunting."""
CATCH_UP_PER_S: Final = 2.0
"""Speed of `Trapezoid` per unit behind the schedule."""


@dataclass(frozen=True, slots=True)
class SquareRoot:
    """The fastest speed from which braking step by step, tick after tick, ends at the target."""

    bounds: Bounds
    tick_s: float

    def speed(self, left: float, elapsed_s: float) -> float:
        """Return the speed to command.

        Args:
            left: signed way left when the command takes effect, in m or rad.
            elapsed_s: seconds since the motion began; here it does not matter.
        """
        step = self.bounds.acceleration * self.tick_s / 2.0
        fastest = sqrt(step**2 + 2.0 * self.bounds.acceleration * abs(left)) - step
        return copysign(min(fastest, self.bounds.speed, STEEPEST_PER_S * abs(left)), left)


@dataclass(frozen=True, slots=True)
class Trapezoid:
    """A schedule of place over time, followed with proportional feedback.

    Attributes:
        way: signed way of the whole motion.
    """

    bounds: Bounds
    way: float

    def speed(self, left: float, elapsed_s: float) -> float:
        """Return the scheduled speed, corrected by how far behind the schedule the rover is.

        One that is ahead of it waits; it turns round only beyond the target.
        """
        left_scheduled, speed = self._schedule(elapsed_s)
        behind = left - copysign(left_scheduled, self.way)
        wanted = copysign(speed, self.way) + CATCH_UP_PER_S * behind
        if wanted * left < 0.0:
            return 0.0
        return max(-self.bounds.speed, min(self.bounds.speed, wanted))

    def _schedule(self, elapsed_s: float) -> tuple[float, float]:
        way, acceleration = abs(self.way), self.bounds.acceleration
        total_s = duration_s(way, self.bounds)
        peak = min(self.bounds.speed, sqrt(way * acceleration))
        ramp_s = peak / acceleration
        if elapsed_s < ramp_s:
            return way - acceleration * elapsed_s**2 / 2.0, acceleration * elapsed_s
        if elapsed_s < total_s - ramp_s:
            return way - peak * (elapsed_s - ramp_s / 2.0), peak
        left_s = max(total_s - elapsed_s, 0.0)
        return acceleration * left_s**2 / 2.0, acceleration * left_s


SpeedProfile = SquareRoot | Trapezoid


def make_profile(kind: SpeedProfileKind, bounds: Bounds, way: float, tick_s: float) -> SpeedProfile:
    """Return the profile that the settings name, for a signed way."""
    match kind:
        case SpeedProfileKind.TRAPEZOID:
            return Trapezoid(bounds, way)
        case SpeedProfileKind.SQUARE_ROOT:
            return SquareRoot(bounds, tick_s)
        case _:
            assert_never(kind)


FINEST_M: Final = 0.005
FORWARD_FAVOUR_S: Final = 0.05

Step = Waypoint | MoveForward | RotateTo | RotateBy


@dataclass(frozen=True, slots=True)
class Leg:
    """One step of a motion goal, planned from where the rover stands.

    Attributes:
        toward_rad: heading to take before driving; None to begin as it stands.
        target: where the control point is to go; None for a turn alone.
        reverse: whether to drive backward.
        heading_rad: heading to take at the end; None to stay as the drive ends.
        tolerance_m: how near is near enough.
        turn_rad: signed angle to turn to that heading; None for the shorter way.
        aim: where the line ends, uphill of the target by what the last turn will slide.
        through: waypoints to pass on the way without standing.
        around: corners of a way around obstacles, where it is driven as a curve.
        straight: whether it is to be driven by turns and lines, whatever drives the command.
    """

    toward_rad: float | None
    target: Point | None
    reverse: bool
    heading_rad: float | None
    tolerance_m: float
    turn_rad: float | None = None
    aim: Point | None = None
    through: tuple[Waypoint, ...] = ()
    around: tuple[Point, ...] = ()
    straight: bool = False

    @property
    def free(self) -> bool:
        """Whether base_link is to stand at the target, at whatever heading."""
        return bool(self.through or self.around) and self.heading_rad is None


def turn_bounds(settings: Settings, status: Status) -> Bounds:
    """Return the bounds of a turn."""
    return Bounds(status.rotate_limit_radps, settings.drive.rotate_acceleration_radps2)


def plan_leg(
    step: Step,
    settings: Settings,
    status: Status,
    through: Sequence[Waypoint] = (),
    around: Sequence[Point] = (),
) -> Leg:
    """Return the leg that leads from the present pose through a step.

    Args:
        step: where it ends.
        settings: the asset.
        status: where the rover is, and how fast it may go.
        through: waypoints to pass before, without standing.
        around: corners of a way around obstacles, without standing.
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
            near_m = min(near_m, max(abs(distance_m) / 2, FINEST_M))
            return Leg(None, target, distance_m < 0, None, near_m)
        case Waypoint() if through or around:
            return _along_path(step, through, around, settings)
        case Waypoint():
            return _to_waypoint(step, settings, status)


def _along_path(
    waypoint: Waypoint, through: Sequence[Waypoint], around: Sequence[Point], settings: Settings
) -> Leg:
    law, place = settings.turn_drive, Point(waypoint.x_m, waypoint.y_m)
    before = [*around, *(Point(each.x_m, each.y_m) for each in through)]
    toward_rad = before[-1].bearing_rad(place)
    target, heading_rad = place, waypoint.heading_rad
    if heading_rad is not None:
        target = Pose(place.x_m, place.y_m, heading_rad=heading_rad).ahead(law.control_point_m)
    near_m = waypoint.tolerance_m or law.position_tolerance_m
    return Leg(
        toward_rad,
        target,
        False,
        heading_rad,
        near_m,
        through=tuple(through),
        around=tuple(around),
    )


def _to_waypoint(waypoint: Waypoint, settings: Settings, status: Status) -> Leg:
    pose, law = status.pose, settings.turn_drive
    place = Point(waypoint.x_m, waypoint.y_m)
    near_m = waypoint.tolerance_m or law.position_tolerance_m
    start = pose.ahead(law.control_point_m)
    end = replace(pose, x_m=place.x_m, y_m=place.y_m)
    if waypoint.heading_rad is not None:
        end = replace(end, heading_rad=waypoint.heading_rad)
    if start.distance_m(end.ahead(law.control_point_m)) <= aim_m(near_m, settings) / 2:
        return Leg(None, None, False, waypoint.heading_rad, near_m)
    forward = _towards(pose, place, waypoint, False, law.control_point_m, near_m)
    if not law.reverse:
        return _uphill(forward, pose, settings, status)
    backward = _towards(pose, place, waypoint, True, law.control_point_m, near_m)
    bounds = turn_bounds(settings, status)
    if _turning_s(pose, forward, bounds) <= _turning_s(pose, backward, bounds) + FORWARD_FAVOUR_S:
        return _uphill(forward, pose, settings, status)
    return _uphill(backward, pose, settings, status)


def _uphill(leg: Leg, pose: Pose, settings: Settings, status: Status) -> Leg:
    """Return a leg that allows for the slide of its turns on a slope, where that was learnt."""
    if leg.target is None or leg.toward_rad is None:
        return leg
    start = pose.ahead(settings.turn_drive.control_point_m)
    first = status.slide(wrap_rad(leg.toward_rad - pose.heading_rad))
    last = Point(0.0, 0.0)
    if leg.heading_rad is not None:
        last = status.slide(wrap_rad(leg.heading_rad - leg.toward_rad))
    if first == last == Point(0.0, 0.0):
        return leg
    start = Point(start.x_m + first.x_m, start.y_m + first.y_m)
    aim = Point(leg.target.x_m - last.x_m, leg.target.y_m - last.y_m)
    toward_rad = wrap_rad(start.bearing_rad(aim) + (pi if leg.reverse else 0.0))
    return replace(leg, toward_rad=toward_rad, aim=aim)


def aim_m(tolerance_m: float, settings: Settings) -> float:
    """Return how near to drive: the asset's tolerance, where the wanted one is wider."""
    return min(tolerance_m, settings.turn_drive.position_tolerance_m)


def _towards(
    pose: Pose, place: Point, waypoint: Waypoint, reverse: bool, ahead_m: float, near_m: float
) -> Leg:
    start = pose.ahead(ahead_m)
    target = place
    if waypoint.heading_rad is not None:
        target = Pose(place.x_m, place.y_m, heading_rad=waypoint.heading_rad).ahead(ahead_m)
    heading = wrap_rad(start.bearing_rad(target) + (pi if reverse else 0.0))
    if waypoint.heading_rad is None:
        target = Pose(place.x_m, place.y_m, heading_rad=heading).ahead(ahead_m)
    return Leg(heading, target, reverse, waypoint.heading_rad, near_m)


def _turning_s(pose: Pose, leg: Leg, bounds: Bounds) -> float:
    if leg.toward_rad is None:
        return 0.0
    first = duration_s(wrap_rad(leg.toward_rad - pose.heading_rad), bounds)
    if leg.heading_rad is None:
        return first
    return first + duration_s(wrap_rad(leg.heading_rad - leg.toward_rad), bounds)


def leg_errors(leg: Leg, settings: Settings, status: Status) -> tuple[float, float]:
    """Return how far the rover stands from the end of a leg, in metres and radians."""
    pose, place_m, heading_rad = status.pose, 0.0, 0.0
    if leg.target is not None:
        ahead_m = 0.0 if leg.free else settings.turn_drive.control_point_m
        place_m = leg.target.distance_m(pose.ahead(ahead_m))
    if leg.heading_rad is not None:
        heading_rad = abs(wrap_rad(leg.heading_rad - pose.heading_rad))
    return place_m, heading_rad


class Motion(ABC):
    """A turn, a straight line or a velocity held, under way.

    Attributes:
        expected_s: how long it takes if nothing goes wrong.
        notice: what is to be reported of how it goes, once there is something; else None.
        passed: how many waypoints it has passed, of those that its leg leads through.
    """

    expected_s: float
    notice: str | None = None
    passed: int = 0

    @property
    @abstractmethod
    def done(self) -> bool:
        """Whether the rover stands where the motion ends."""

    @property
    def ending(self) -> bool:
        """Whether another motion may take over now; by default once this one is done."""
        return self.done

    @property
    def fault(self) -> Refusal | None:
        """Why it cannot be done, once that is known."""
        return None

    @property
    def evades(self) -> bool:
        """Whether it keeps away itself from what comes into view."""
        return False

    @property
    def abandoned(self) -> bool:
        """Whether the rover stands, and is to go on by another leg: to the next waypoint alone."""
        return False

    @property
    def again(self) -> bool:
        """Whether that leg may be a curve again; else it is driven by turns and lines."""
        return False

    @property
    @abstractmethod
    def left(self) -> str:
        """What is left of it, for people."""

    def renew(self, _: float) -> bool:
        """Plan anew if another greatest speed was set; return whether there was need."""
        return False

    @abstractmethod
    def want(self, now_s: float) -> Wanted:
        """Return what to command in this tick."""


class Locomotion(Protocol):
    """Makes motions of commands, beginning now.

    Attributes:
        alone: whether the rover points no camera while it carries out a motion.
    """

    alone: bool

    def curves(self, command: Command, waypoint: Waypoint) -> bool:
        """Return whether it drives to a waypoint in one curve, around what lies between."""

    def passes(self, command: Command, waypoint: Waypoint) -> bool:
        """Return whether it passes a waypoint of a path that goes on, without standing there."""

    def turn(self, command: Command, leg: Leg, final: bool) -> Motion | None:
        """Return the turn of a leg, towards its target or to its last heading, if it has one."""

    def line(self, command: Command, leg: Leg) -> Motion | None:
        """Return the straight line of a leg, if it has one."""

    def hold(self, command: Command, request: DriveFor) -> Motion:
        """Return the holding of a velocity."""


class BaseDriver(Protocol):
    """Commands the rover's motion. Only `executive.motion.arbiter` calls it."""

    @property
    def velocity(self) -> Velocity:
        """What the rover is made to do now."""

    @property
    def expected(self) -> tuple[Velocity, Velocity]:
        """Between which velocities the rover should be now; the same twice where that is known."""

    def stop(self) -> None:
        """Make the rover stand, now."""

    def hold(self) -> None:
        """Have the rover go on standing, in each tick after a stop."""

    def commit(self, wanted: Wanted | None, now_s: float, step_s: float) -> None:
        """Command what is wanted in this tick; None: nothing is."""
