"""`VelocityLocomotion` turns, drives, turns; `VelocityDriver` limits and ramps the velocities.

Turn on the spot towards the target, drive a straight line, turn to the heading. The steered point
is the control point of `executive.motion.locomotion`.
"""

from abc import abstractmethod
from dataclasses import replace
from math import copysign, cos, pi, sin
from typing import Final

from executive.commands import Command, Curve, DriveFor
from executive.motion.curves import CurvesLaw
from executive.motion.locomotion import (
    Bounds,
    Leg,
    Locomotion,
    Motion,
    SpeedProfile,
    duration_s,
    effective_tolerance_m,
    make_profile,
    turn_bounds,
)
from executive.settings import Settings
from executive.state import Status
from executive.values.clock import Clock
from executive.values.geometry import STANDING, Point, Velocity, arc_end, wrap_rad
from executive.values.ports import MotionIntent, VelocityRover
from executive.values.quantities import quantity_text

STEER_PER_M = 2.0
STEER_PER_S = 3.0
STEER_LAST_M = 0.05
BLEND_TRAVEL_MPS = 0.15
BLEND_ROTATE_RADPS = 0.5
BLEND_DISTANCE_M = 0.01
MIN_HEADING_TOLERANCE_RAD = 0.01


class _Law(Motion):
    """Reduces a signed distance or angle to zero by a speed profile.

    Args:
        near: tolerance of the remainder at the end.
        blend_distance, blend_speed: bounds within which the next motion may start.
    """

    unit: str

    def __init__(
        self,
        settings: Settings,
        status: Status,
        now_s: float,
        near: float,
        blend_distance: float,
        blend_speed: float,
    ) -> None:
        self._settings = settings
        self._status = status
        self._tolerance = near
        self._blend_distance = blend_distance
        self._blend_speed = blend_speed
        self._plan(self._present_bounds(), now_s)

    @property
    @abstractmethod
    def remaining(self) -> float:
        """The signed distance or angle that remains."""

    @property
    @abstractmethod
    def _moving(self) -> float:
        """The measured speed towards the target."""

    @abstractmethod
    def _present_bounds(self) -> Bounds:
        """Return the bounds for the present speed limits."""

    @property
    def done(self) -> bool:
        """Whether the rover is stationary at the end."""
        return abs(self.remaining) <= self._tolerance and self._status.standing

    @property
    def handover_allowed(self) -> bool:
        """Whether the rover is slow, and braking now would end at the target."""
        moving = self._moving
        rest = self._remaining_at_effect(self.remaining) - moving * abs(moving) / (
            2 * self._bounds.acceleration
        )
        return abs(rest) <= self._blend_distance and abs(moving) <= self._blend_speed

    @property
    def remaining_text(self) -> str:
        """The remaining distance or angle, for display."""
        spec = "+.1f" if self.unit == "rad" else "+.3f"
        return f"{quantity_text(self.remaining, self.unit, spec)} remaining"

    def update_limits(self, now_s: float) -> bool:
        """Plan again if the speed limit changed; return whether it did."""
        bounds = self._present_bounds()
        if bounds == self._bounds:
            return False
        self._plan(bounds, now_s)
        return True

    def _plan(self, bounds: Bounds, now_s: float) -> None:
        self._began_s = now_s
        self._bounds = bounds
        self._profile: SpeedProfile = make_profile(
            self._settings.turn_drive.profile, bounds, self.remaining, self._settings.tick_s
        )
        self.expected_s = duration_s(self.remaining, bounds)

    def _remaining_at_effect(self, distance: float) -> float:
        """Return the remainder at the time when a command given now takes effect."""
        return distance - self._moving * self._settings.turn_drive.latency_s

    def _speed(self, distance: float, now_s: float) -> float:
        return self._profile.speed(self._remaining_at_effect(distance), now_s - self._began_s)


class TurnLaw(_Law):
    """Turns to a heading, without reversing the direction of the turn.

    Args:
        turn_rad: the signed angle of the turn; None for the shorter direction.
        along_m_per_rad: path for each radian to the left; 0 on the spot, negative if this arc is
            driven backward to the left.
    """

    unit = "rad"

    def __init__(
        self,
        heading_rad: float,
        settings: Settings,
        status: Status,
        now_s: float,
        turn_rad: float | None = None,
        along_m_per_rad: float = 0.0,
    ) -> None:
        self._along_m_per_rad = along_m_per_rad
        self._heading_rad = heading_rad
        self._left_rad = 0.0 if turn_rad is None else turn_rad
        tolerance_rad = near_rad = settings.turn_drive.heading_tolerance_rad
        if turn_rad is not None:
            near_rad = min(near_rad, max(abs(turn_rad) / 2, MIN_HEADING_TOLERANCE_RAD))
        super().__init__(settings, status, now_s, near_rad, tolerance_rad, BLEND_ROTATE_RADPS)

    @property
    def remaining(self) -> float:
        """The signed angle that remains."""
        left_rad = wrap_rad(self._heading_rad - self._status.pose.heading_rad)
        self._left_rad += wrap_rad(left_rad - self._left_rad)
        return self._left_rad

    @property
    def _moving(self) -> float:
        return self._status.velocity.rotate_radps

    def _present_bounds(self) -> Bounds:
        bounds = turn_bounds(self._settings, self._status)
        if not (along := abs(self._along_m_per_rad)):
            return bounds
        return Bounds(
            min(bounds.speed, self._status.travel_limit_mps / along),
            min(bounds.acceleration, self._settings.drive.travel_acceleration_mps2 / along),
        )

    def intent(self, now_s: float) -> Velocity:
        """Return the velocity to command."""
        rotate_radps = self._speed(self.remaining, now_s)
        return Velocity(self._along_m_per_rad * rotate_radps, rotate_radps)


class DriveLaw(_Law):
    """Drives the control point along a straight line; done at the target's perpendicular."""

    unit = "m"

    def __init__(
        self,
        target: Point,
        reverse: bool,
        tolerance_m: float,
        settings: Settings,
        status: Status,
        now_s: float,
    ) -> None:
        self._target = target
        self._sign = -1.0 if reverse else 1.0
        start = status.pose.ahead(settings.turn_drive.control_point_m)
        length_m = start.distance_m(target)
        self._direction_rad = (
            start.bearing_rad(target)
            if length_m > STEER_LAST_M
            else wrap_rad(status.pose.heading_rad + (pi if reverse else 0.0))
        )
        near_m = effective_tolerance_m(tolerance_m, settings)
        super().__init__(settings, status, now_s, near_m, BLEND_DISTANCE_M, BLEND_TRAVEL_MPS)

    @property
    def remaining(self) -> float:
        """The remaining distance along the line, negative beyond the target."""
        return self._along_and_aside()[0]

    @property
    def _moving(self) -> float:
        return self._status.velocity.travel_mps * self._sign

    def _present_bounds(self) -> Bounds:
        acceleration_mps2 = self._settings.drive.travel_acceleration_mps2
        return Bounds(self._status.travel_limit_mps, acceleration_mps2)

    def intent(self, now_s: float) -> Velocity:
        """Return the velocity to command."""
        left_m, aside_m = self._along_and_aside()
        return Velocity(self._sign * self._speed(left_m, now_s), self._steer(left_m, aside_m))

    def _steer(self, left_m: float, aside_m: float) -> float:
        if abs(left_m) < STEER_LAST_M:
            return 0.0
        nose_rad = self._direction_rad + (pi if self._sign < 0 else 0.0)
        slant_rad = max(-0.5, min(0.5, STEER_PER_M * aside_m))
        return STEER_PER_S * wrap_rad(nose_rad - slant_rad - self._status.pose.heading_rad)

    def _along_and_aside(self) -> tuple[float, float]:
        point = self._status.pose.ahead(self._settings.turn_drive.control_point_m)
        dx_m = self._target.x_m - point.x_m
        dy_m = self._target.y_m - point.y_m
        cosine, sine = cos(self._direction_rad), sin(self._direction_rad)
        return dx_m * cosine + dy_m * sine, dx_m * sine - dy_m * cosine


RELEASE_S: Final = 0.5
SETTLE_S: Final = 5.0
MAX_ARC_CORRECTION_RAD: Final = 0.08
"""Maximum correction towards the arc, so that the final heading is nearly that of the arc."""
ARC_CORRECTION_PER_S: Final = 2.0
MAX_FINAL_TURN_RAD: Final = 0.5
"""Maximum turn on the spot after a velocity hold; a larger one is a fault."""


class VelocityLocomotion(Locomotion):
    """Makes motions that command a velocity in each tick: straight lines from stop to stop."""

    excludes_camera = False

    def __init__(self, clock: Clock, settings: Settings, status: Status) -> None:
        self._clock = clock
        self._settings = settings
        self._status = status

    def make_turn(self, _: Command, leg: Leg, final: bool) -> Motion | None:
        """Return the turn of a leg, or None if it has none."""
        if leg.curves:
            return CurvesLaw(leg.curves, self._make_arc) if final else None
        heading_rad = leg.heading_rad if final else leg.toward_rad
        if heading_rad is None or self._settings.drive.min_turning_radius_m is not None:
            return None
        return TurnLaw(
            heading_rad,
            self._settings,
            self._status,
            self._clock.now_s(),
            leg.turn_rad if final else None,
        )

    def _make_arc(self, curve: Curve) -> Motion:
        return TurnLaw(
            curve.end.heading_rad,
            self._settings,
            self._status,
            self._clock.now_s(),
            curve.by_rad,
            curve.by_m / curve.by_rad,
        )

    def make_line(self, _: Command, leg: Leg) -> Motion | None:
        """Return the straight line of a leg, or None if it has none."""
        if leg.target is None:
            return None
        return DriveLaw(
            leg.compensated_target or leg.target,
            leg.reverse,
            leg.tolerance_m,
            self._settings,
            self._status,
            self._clock.now_s(),
        )

    def make_velocity_hold(self, _: Command, request: DriveFor) -> "HoldLaw":
        """Return a velocity hold."""
        return HoldLaw(request, self._clock, self._settings, self._status)


def hold_extent(
    request: DriveFor, status: Status, settings: Settings
) -> tuple[float, float] | None:
    """Return the distance and the angle until standstill of a velocity hold that begins now.

    In motion the velocity changes from the present one, and braking is not balanced by a start. An
    arc ends at its declared heading nevertheless. Zero velocity promises a standstill only: None.
    """
    if not (request.travel_mps or request.rotate_radps):
        return None
    begun, drive = STANDING if status.standing else status.velocity, settings.drive
    distance_m = _extent(
        begun.travel_mps, request.travel_mps, drive.travel_acceleration_mps2, request, settings
    )
    if request.travel_mps or begun == STANDING:
        return distance_m, request.rotate_radps * request.duration_s
    return distance_m, _extent(
        begun.rotate_radps,
        request.rotate_radps,
        drive.rotate_acceleration_radps2,
        request,
        settings,
    )


def _extent(
    begun: float, wanted: float, acceleration: float, request: DriveFor, settings: Settings
) -> float:
    ramped, reached = _ramp(begun, wanted, acceleration, request.duration_s)
    braking = reached * abs(reached) / (2 * acceleration)
    return begun * settings.turn_drive.latency_s + ramped + braking


def _ramp(
    begun: float, wanted: float, acceleration: float, elapsed_s: float
) -> tuple[float, float]:
    """Return the integral of a velocity that approaches another one, and the velocity reached."""
    ramp_s = min(elapsed_s, abs(wanted - begun) / acceleration)
    reached = _approach(begun, wanted, acceleration * ramp_s)
    return (begun + reached) / 2 * ramp_s + reached * (elapsed_s - ramp_s), reached


class HoldLaw(Motion):
    """Holds a velocity for a duration, then stops; `VelocityDriver` limits the speed.

    The rotation steers back to the arc. The base turns at 0.9 to 1.45 of the commanded rate (speed,
    ground, load): without it 18 of 36 arcs failed, and six ended up to 0.56 m off. A final heading
    error, as after late odometry, is corrected by a turn on the spot.
    """

    def __init__(self, request: DriveFor, clock: Clock, settings: Settings, status: Status) -> None:
        self.expected_s = request.duration_s + SETTLE_S
        self._request = request
        self._velocity = Velocity(request.travel_mps, request.rotate_radps)
        self._until_s = clock.now_s() + request.duration_s
        self._clock = clock
        self._settings = settings
        self._status = status
        self._from = self._last = status.pose
        self._begun = STANDING if status.standing else status.velocity
        _, self._wanted_rad = hold_extent(request, status, settings) or (0.0, 0.0)
        self._distance_m = self._turned_rad = 0.0
        self._turn: TurnLaw | None = None
        on_spot = settings.drive.min_turning_radius_m is None and self._velocity != STANDING
        self._max_turn_rad = MAX_FINAL_TURN_RAD if on_spot else 0.0

    @property
    def done(self) -> bool:
        """Whether the duration is over and the rover is stationary, with no final turn left."""
        if self._left_s > 0.0 or not self._status.standing:
            return False
        if self._turn is not None:
            return self._turn.done
        tolerance_rad = self._settings.turn_drive.heading_tolerance_rad
        return not tolerance_rad < abs(self._turn_left_rad) <= self._max_turn_rad

    @property
    def remaining_text(self) -> str:
        """The remaining time, for display."""
        return f"{max(self._left_s, 0.0):.2f} s left"

    def intent(self, now_s: float) -> Velocity:
        """Return the velocity; after the duration zero, then the final turn."""
        travel_mps, continues = self._velocity.travel_mps, self._left_s > 0.0
        if self._turn is None and not continues and self._status.standing:
            left_rad = self._turn_left_rad
            heading_rad = self._status.pose.heading_rad + left_rad
            self._turn = TurnLaw(heading_rad, self._settings, self._status, now_s, left_rad)
        if self._turn is not None:
            return self._turn.intent(now_s)
        if not continues and not travel_mps:
            return STANDING
        self._integrate()
        rotate_radps = self._along_radps(continues) if travel_mps else self._in_place_radps()
        return Velocity(travel_mps if continues else 0.0, rotate_radps)

    @property
    def _turn_left_rad(self) -> float:
        """The angle from the present heading to that of the arc's end."""
        since_rad = wrap_rad(self._status.pose.heading_rad - self._last.heading_rad)
        return self._wanted_rad - self._turned_rad - since_rad

    def _integrate(self) -> None:
        """Integrate the distance and the angle of the motion."""
        before, pose = self._last, self._status.pose
        x_m, y_m = pose.x_m - before.x_m, pose.y_m - before.y_m
        self._distance_m += x_m * cos(pose.heading_rad) + y_m * sin(pose.heading_rad)
        self._turned_rad += wrap_rad(pose.heading_rad - before.heading_rad)
        self._last = pose

    def _in_place_radps(self) -> float:
        """Return the rotation that corrects the accumulated error of the turn."""
        begun_radps, rotate_radps = self._begun.rotate_radps, self._velocity.rotate_radps
        acceleration_radps2 = self._settings.drive.rotate_acceleration_radps2
        elapsed_s = self._request.duration_s - self._left_s
        before_s = min(elapsed_s, self._settings.turn_drive.latency_s)
        turned_rad, _ = _ramp(begun_radps, rotate_radps, acceleration_radps2, elapsed_s - before_s)
        off_rad = begun_radps * before_s + turned_rad - self._turned_rad
        return rotate_radps + ARC_CORRECTION_PER_S * off_rad

    def _along_radps(self, continues: bool) -> float:
        """Return the rotation that holds the control point on the arc, up to its final heading.

        Args:
            continues: whether braking has not begun yet.
        """
        pose, speed_mps = self._status.pose, self._status.velocity.travel_mps
        travel_mps = self._velocity.travel_mps
        turn_radpm = self._velocity.rotate_radps / travel_mps
        turn_rad, slant_rad = turn_radpm * self._distance_m, 0.0
        if continues:
            ahead_m = self._settings.turn_drive.control_point_m
            position, point = self._from.ahead(ahead_m), pose.ahead(ahead_m)
            begun = replace(self._from, x_m=position.x_m, y_m=position.y_m)
            wanted = arc_end(begun, self._distance_m, turn_rad)
            x_m, y_m = point.x_m - wanted.x_m, point.y_m - wanted.y_m
            left_m = y_m * cos(wanted.heading_rad) - x_m * sin(wanted.heading_rad)
            slant_rad = -copysign(1.0, travel_mps) * _clamp(
                STEER_PER_M * left_m, MAX_ARC_CORRECTION_RAD
            )
        else:
            braking_mps2 = self._settings.drive.travel_acceleration_mps2
            rest_m = speed_mps * abs(speed_mps) / (2 * braking_mps2)
            turn_rad = self._wanted_rad - turn_radpm * rest_m
        off_rad = turn_rad + slant_rad - self._turned_rad
        return turn_radpm * speed_mps + STEER_PER_S * off_rad

    @property
    def _left_s(self) -> float:
        left_s = self._until_s - self._clock.now_s()
        return left_s if left_s > 1e-9 else 0.0


class VelocityDriver:
    """Sends velocities within speed and acceleration limits.

    Without an intent it ramps down, sends zero for `RELEASE_S` (longer than the rover's own command
    timeout) and then sends nothing, so that another publisher, as a joystick, may drive (thesis
    5.1.4).

    Attributes:
        velocity: the last one sent.
    """

    def __init__(
        self, clock: Clock, settings: Settings, status: Status, rover: VelocityRover
    ) -> None:
        self._settings = settings
        self._status = status
        self._rover = rover
        self.velocity = STANDING
        self._moved_at_s = clock.now_s() - RELEASE_S

    @property
    def expected(self) -> tuple[Velocity, Velocity]:
        """The last velocity sent, twice: the base follows it soon."""
        return self.velocity, self.velocity

    def stop(self) -> None:
        """Send zero now."""
        self._send(STANDING)

    def hold(self) -> None:
        """Send zero again."""
        self.stop()

    def commit(self, wanted: MotionIntent | None, now_s: float, step_s: float) -> None:
        """Send the intent within the limits."""
        if wanted is None:
            if self.velocity != STANDING:
                self._send(self._slew(STANDING, step_s))
            elif now_s - self._moved_at_s < RELEASE_S:
                self._send(STANDING)
        elif not isinstance(wanted, Velocity):
            raise TypeError(f"{wanted} is not a velocity")
        elif not (wanted.finite and self._status.odometry_fresh):
            self._send(STANDING)
        else:
            self._send(self._slew(wanted, step_s))
        if wanted is not None or self.velocity != STANDING:
            self._moved_at_s = now_s

    def _slew(self, wanted: Velocity, step_s: float) -> Velocity:
        """Return the velocity to send; its first and last step are at least one tick."""
        tick_s = self._settings.tick_s
        begins = self.velocity == STANDING
        if begins or wanted == STANDING == self._toward(STANDING, tick_s):
            step_s = max(step_s, tick_s)
        return self._toward(wanted, step_s)

    def _toward(self, wanted: Velocity, step_s: float) -> Velocity:
        limits, status = self._settings.drive, self._status
        travel_mps = _approach(
            self.velocity.travel_mps,
            _clamp(wanted.travel_mps, status.travel_limit_mps),
            limits.travel_acceleration_mps2 * step_s,
        )
        rotate_radps = _approach(
            self.velocity.rotate_radps,
            _clamp(wanted.rotate_radps, status.rotate_limit_radps),
            limits.rotate_acceleration_radps2 * step_s,
        )
        if limits.min_turning_radius_m is not None:
            rotate_radps = _clamp(rotate_radps, abs(travel_mps) / limits.min_turning_radius_m)
        return Velocity(travel_mps, rotate_radps)

    def _send(self, velocity: Velocity) -> None:
        self.velocity = velocity
        self._rover.drive(velocity)


def _clamp(value: float, bound: float) -> float:
    return max(-bound, min(bound, value))


def _approach(present: float, wanted: float, step: float) -> float:
    return max(present - step, min(present + step, wanted))
