"""`DelegatedLocomotion`: for a rover that executes whole motions itself, as MOCUP (thesis 6.1)."""

from dataclasses import dataclass, replace
from itertools import count
from math import copysign
from typing import Final, assert_never

from executive.commands import Command, DriveFor
from executive.motion.locomotion import Bounds, Leg, Locomotion, Motion, duration_s
from executive.settings import DriveLimits, Settings
from executive.state import Status, is_slow
from executive.values.clock import Clock
from executive.values.facts import MotionEnded
from executive.values.geometry import STANDING, Pose, Velocity, wrap_rad
from executive.values.ports import (
    DelegatedMotion,
    DelegatedMotionRover,
    DriveBy,
    MotionIntent,
    TurnBy,
    VelocityHold,
)
from executive.values.quantities import angle_text
from executive.values.reasons import Reason, Refusal

MAX_START_DELAY_S: Final = 4.0
"""Maximum start delay of a rover that does not report the start, also after lost messages."""
RAMP_TOLERANCE_S: Final = 0.15
"""Tolerance of the times when the rover reaches full speed, and starts to brake."""
MAX_ODOMETRY_PERIOD_S: Final = 0.3
"""Maximum period of odometry. The end of a motion is detected this much in advance."""
REPEAT_HALT_S: Final = 1.0
"""Retry interval of a halt while the rover still moves."""
SETTLE_S: Final = 2.0


class DelegatedLocomotion(Locomotion):
    """Makes straight motions that command one whole motion and wait for the rover's reply."""

    excludes_camera = True

    def __init__(self, settings: Settings, status: Status) -> None:
        self._settings = settings
        self._status = status
        self._numbers = count(1)

    def make_turn(self, command: Command, leg: Leg, final: bool) -> "PendingMotion | None":
        """Return the turn of a leg, or None if it is at most half the tolerance."""
        heading_rad = leg.heading_rad if final else leg.toward_rad
        if heading_rad is None:
            return None
        angle_rad = wrap_rad(heading_rad - self._status.pose.heading_rad)
        if final and leg.turn_rad is not None:
            angle_rad = leg.turn_rad
        if abs(angle_rad) <= self._settings.turn_drive.heading_tolerance_rad / 2:
            return None
        speed_radps = self._status.rotate_limit_radps
        what = TurnBy(angle_rad, speed_radps)
        return self._awaited(command, what, abs(angle_rad) / speed_radps)

    def make_line(self, command: Command, leg: Leg) -> "PendingMotion | None":
        """Return the straight line of a leg, or None if it has none."""
        if leg.target is None:
            return None
        start = self._status.pose.ahead(self._settings.turn_drive.control_point_m)
        length_m, speed_mps = start.distance_m(leg.target), self._status.travel_limit_mps
        distance_m = -length_m if leg.reverse else length_m
        return self._awaited(command, DriveBy(distance_m, speed_mps), length_m / speed_mps)

    def make_velocity_hold(self, command: Command, request: DriveFor) -> "PendingMotion":
        """Return a velocity hold, longer by the time of its deceleration.

        Its distance is then velocity times duration, as with a rover that accepts velocities.
        """
        what = VelocityHold(Velocity(request.travel_mps, request.rotate_radps), request.duration_s)
        gain_s = profile_of(what, self._settings.drive).gain_s
        what = replace(what, duration_s=request.duration_s + gain_s)
        return self._awaited(command, what, what.duration_s)

    def _awaited(
        self, command: Command, what: TurnBy | DriveBy | VelocityHold, expected_s: float
    ) -> "PendingMotion":
        motion = DelegatedMotion(next(self._numbers), what, command.identity)
        return PendingMotion(motion, expected_s + SETTLE_S, self._status)


class PendingMotion(Motion):
    """A whole motion in execution, until the rover reports its end."""

    def __init__(self, motion: DelegatedMotion, expected_s: float, status: Status) -> None:
        self.expected_s = expected_s
        self._motion = motion
        self._status = status

    @property
    def done(self) -> bool:
        """Whether the rover has executed it, and is stationary."""
        ended = self._ended
        return ended is not None and ended.executed and self._status.stationary_since_motion

    @property
    def failure(self) -> Refusal | None:
        """Why the rover did not execute it; None if it did or has not ended."""
        ended = self._ended
        if ended is None or ended.executed:
            return None
        return Refusal(Reason.MOTION_NOT_EXECUTED, f"the rover did not execute it: {ended.text}")

    @property
    def _ended(self) -> MotionEnded | None:
        ended = self._status.motion_ended
        return ended if ended is not None and ended.number == self._motion.number else None

    @property
    def remaining_text(self) -> str:
        """The motion in execution, for display."""
        match self._motion.primitive:
            case TurnBy(angle_rad):
                return f"rover turns by {angle_text(angle_rad, '+.1f')}"
            case DriveBy(distance_m):
                return f"rover drives {distance_m:+.3f} m"
            case VelocityHold(_, duration_s):
                return f"rover holds a velocity for {duration_s:g} s"

    def intent(self, _: float) -> DelegatedMotion:
        """Return the motion as the intent of this tick."""
        return self._motion


class DelegatedDriver:
    """Commands each whole motion once, and a halt when no motion is wanted."""

    def __init__(
        self, clock: Clock, settings: Settings, status: Status, rover: DelegatedMotionRover
    ) -> None:
        self._clock = clock
        self._settings = settings
        self._status = status
        self._rover = rover
        self._motion: DelegatedMotion | None = None
        self._begun = 0
        self._sent_at_s = 0.0
        self._from = Pose()
        self._halt_sent_s: float | None = None

    @property
    def velocity(self) -> Velocity:
        """The measured velocity while a motion is in execution, else zero."""
        return STANDING if self._motion is None else self._status.velocity

    @property
    def expected(self) -> tuple[Velocity, Velocity]:
        """The bounds of the expected velocity: that of the motion, and from zero during its ramps.

        A command that the rover received over another link is unknown here: up to the speed limits.
        """
        motion, drive = self._motion, self._settings.drive
        own = motion is not None and self._in_progress
        if not own and is_slow(self._status.velocity):
            return STANDING, STANDING
        if motion is None or not own or self._status.executed_by_relay == motion.command:
            fastest = Velocity(drive.travel_speed_mps, drive.rotate_speed_radps)
            return Velocity(-fastest.travel_mps, -fastest.rotate_radps), fastest
        full = profile_of(motion.primitive, drive).velocity
        return full if self._steady(motion) else STANDING, full

    def _steady(self, motion: DelegatedMotion) -> bool:
        """Return whether the rover should be at full speed now, for any possible start time."""
        started, earliest_s, latest_s = (
            self._status.motion_started,
            self._sent_at_s,
            MAX_START_DELAY_S,
        )
        if started is not None and started.number == motion.number:
            earliest_s, latest_s = self._status.motion_started_at_s, 0.0
        since_s = self._clock.now_s() - earliest_s
        profile = profile_of(motion.primitive, self._settings.drive)
        margin_s = profile.gain_s + RAMP_TOLERANCE_S
        in_time = latest_s + margin_s <= since_s <= profile.duration_s - margin_s
        before_s = profile.gain_s / 2 + MAX_ODOMETRY_PERIOD_S
        return in_time and not self._near_end(motion.primitive, since_s, before_s)

    def _near_end(
        self, what: TurnBy | DriveBy | VelocityHold, since_s: float, before_s: float
    ) -> bool:
        """Return whether odometry shows less remaining than full speed covers in `before_s`.

        The report that the rover started may have been delayed.
        """
        pose = self._status.pose
        match what:
            case TurnBy(angle_rad, speed_radps):
                expected_rad = copysign(speed_radps * since_s, angle_rad)
                beyond_rad = wrap_rad(pose.heading_rad - self._from.heading_rad - expected_rad)
                return abs(angle_rad) - abs(expected_rad + beyond_rad) <= speed_radps * before_s
            case DriveBy(distance_m, speed_mps):
                travelled_m = self._from.point.distance_m(pose.point)
                return abs(distance_m) - travelled_m <= speed_mps * before_s
            case VelocityHold():
                return False
            case _:
                assert_never(what)

    def stop(self) -> None:
        """Halt the rover."""
        self._motion = None
        self._halt_sent_s = self._clock.now_s()
        self._rover.halt()

    def hold(self) -> None:
        """Repeat the halt until the rover was stationary once: later motion is another link's."""
        if self._halt_sent_s is None:
            return
        if self._status.standing:
            self._halt_sent_s = None
        elif self._clock.now_s() - self._halt_sent_s >= REPEAT_HALT_S:
            self.stop()

    def commit(self, wanted: MotionIntent | None, now_s: float, step_s: float) -> None:
        """Command a motion that is wanted for the first time; halt one that is no longer wanted.

        A halted motion is not started again, since the rover would repeat all of it.
        """
        del step_s
        if isinstance(wanted, Velocity) and wanted != STANDING:
            raise TypeError(f"{wanted} is no whole motion, as this rover requires")
        if isinstance(wanted, DelegatedMotion) and self._status.odometry_fresh:
            if wanted.number > self._begun:
                self._motion, self._begun, self._sent_at_s = wanted, wanted.number, now_s
                self._from = self._status.pose
                self._rover.execute_motion(wanted)
        elif self._in_progress:
            self.stop()
        elif wanted is None:
            self._motion = None
        elif self._halt_sent_s is None and not self._status.standing:
            self.stop()
        else:
            self.hold()

    @property
    def _in_progress(self) -> bool:
        if self._motion is None:
            return False
        ended = self._status.motion_ended
        return ended is None or ended.number != self._motion.number


@dataclass(frozen=True, slots=True)
class MotionProfile:
    """The velocity of a whole motion over time: a ramp up, full speed, a ramp down.

    Attributes:
        velocity: at full speed.
        gain_s: duration of each ramp.
        duration_s: from standstill to standstill; a motion shorter than both ramps peaks lower.
    """

    velocity: Velocity
    gain_s: float
    duration_s: float

    def held_s(self, since_s: float) -> float:
        """Return the equivalent time at full velocity of the distance moved up to `since_s`."""
        ramp_s = min(self.gain_s, self.duration_s / 2)
        if ramp_s == 0.0:
            return min(max(since_s, 0.0), self.duration_s)
        gained_s = min(max(since_s, 0.0), ramp_s)
        even_s = min(max(since_s - ramp_s, 0.0), self.duration_s - 2 * ramp_s)
        left_s = min(max(self.duration_s - since_s, 0.0), ramp_s)
        full = ramp_s / self.gain_s
        return full * (even_s + (gained_s**2 + ramp_s**2 - left_s**2) / (2 * ramp_s))


def profile_of(what: TurnBy | DriveBy | VelocityHold, drive: DriveLimits) -> MotionProfile:
    """Return the profile of a whole motion with these accelerations."""
    match what:
        case TurnBy(angle_rad, speed_radps):
            bounds = Bounds(speed_radps, drive.rotate_acceleration_radps2)
            velocity = Velocity(0.0, copysign(speed_radps, angle_rad))
            return _profile(velocity, bounds, angle_rad)
        case DriveBy(distance_m, speed_mps):
            bounds = Bounds(speed_mps, drive.travel_acceleration_mps2)
            velocity = Velocity(copysign(speed_mps, distance_m), 0.0)
            return _profile(velocity, bounds, distance_m)
        case VelocityHold(velocity, held_s):
            gain_s = abs(velocity.travel_mps) / drive.travel_acceleration_mps2
            gain_s += abs(velocity.rotate_radps) / drive.rotate_acceleration_radps2
            return MotionProfile(velocity, gain_s, held_s)
        case _:
            assert_never(what)


def _profile(velocity: Velocity, bounds: Bounds, distance: float) -> MotionProfile:
    return MotionProfile(velocity, bounds.speed / bounds.acceleration, duration_s(distance, bounds))
