"""Motion of a rover that carries out whole motions by itself, as MOCUP's brick (thesis 6.1)."""

from itertools import count
from typing import Final

from executive.clock import Clock
from executive.commands import Command, DriveFor
from executive.geometry import STANDING, Velocity, wrap_rad
from executive.motion.locomotion import Leg, Motion
from executive.ports import Advance, Hold, MotionRover, TurnBy, Wanted, WholeMotion
from executive.reasons import Reason, Refusal
from executive.settings import Settings
from executive.state import MotionEnded, Status

REPEAT_HALT_S: Final = 1.0
"""After which a halt is repeated to a rover that still moves."""
SETTLE_S: Final = 2.0


class DelegatedLocomotion:
    """Makes motions that command one whole motion and wait for the rover's answer."""

    alone = True

    def __init__(self, settings: Settings, status: Status) -> None:
        self._settings = settings
        self._status = status
        self._numbers = count(1)

    def turn(self, command: Command, leg: Leg, final: bool) -> "PendingMotion | None":
        """Return the turn of a leg, if it has one larger than half the tolerance."""
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

    def line(self, command: Command, leg: Leg) -> "PendingMotion | None":
        """Return the straight line of a leg, if it has one."""
        if leg.target is None:
            return None
        start = self._status.pose.ahead(self._settings.turn_drive.control_point_m)
        length_m, speed_mps = start.distance_m(leg.target), self._status.travel_limit_mps
        distance_m = -length_m if leg.reverse else length_m
        return self._awaited(command, Advance(distance_m, speed_mps), length_m / speed_mps)

    def hold(self, command: Command, request: DriveFor) -> "PendingMotion":
        """Return the holding of a velocity."""
        velocity = Velocity(request.travel_mps, request.rotate_radps)
        return self._awaited(command, Hold(velocity, request.duration_s), request.duration_s)

    def _awaited(
        self, command: Command, what: TurnBy | Advance | Hold, expected_s: float
    ) -> "PendingMotion":
        motion = WholeMotion(next(self._numbers), what, command.identity)
        return PendingMotion(motion, expected_s + SETTLE_S, self._status)


class PendingMotion(Motion):
    """A whole motion under way, until the rover reports its end."""

    def __init__(self, motion: WholeMotion, expected_s: float, status: Status) -> None:
        self.expected_s = expected_s
        self._motion = motion
        self._status = status

    @property
    def done(self) -> bool:
        """Whether the rover has carried it out, and stands."""
        ended = self._ended
        return ended is not None and ended.executed and self._status.standing

    @property
    def fault(self) -> Refusal | None:
        """Why the rover did not carry it out."""
        ended = self._ended
        if ended is None or ended.executed:
            return None
        return Refusal(Reason.MOTION_NOT_EXECUTED, f"the rover did not carry it out: {ended.text}")

    @property
    def _ended(self) -> MotionEnded | None:
        ended = self._status.motion_ended
        return ended if ended is not None and ended.number == self._motion.number else None

    @property
    def left(self) -> str:
        """What is under way, for people."""
        match self._motion.what:
            case TurnBy(angle_rad):
                return f"turns by {angle_rad:+.3f} rad by itself"
            case Advance(distance_m):
                return f"drives {distance_m:+.3f} m by itself"
            case Hold(_, duration_s):
                return f"holds a velocity for {duration_s:g} s by itself"

    def want(self, _: float) -> WholeMotion:
        """Return the motion."""
        return self._motion


class DelegatedMover:
    """Commands each whole motion once, and a halt when none is wanted any more."""

    def __init__(self, clock: Clock, status: Status, rover: MotionRover) -> None:
        self._clock = clock
        self._status = status
        self._rover = rover
        self._motion: WholeMotion | None = None
        self._begun = 0
        self._told_at_s: float | None = None

    @property
    def velocity(self) -> Velocity:
        """What the rover does of the motion under way."""
        return STANDING if self._motion is None else self._status.velocity

    def stop(self) -> None:
        """Have the rover stand."""
        self._motion = None
        self._told_at_s = self._clock.now_s()
        self._rover.halt()

    def hold(self) -> None:
        """Repeat the halt until the rover has stood once; later motion is another link's."""
        if self._told_at_s is None:
            return
        if self._status.standing:
            self._told_at_s = None
        elif self._clock.now_s() - self._told_at_s >= REPEAT_HALT_S:
            self.stop()

    def commit(self, wanted: Wanted | None, now_s: float, step_s: float) -> None:
        """Begin a motion that is wanted for the first time; halt one that is not any more.

        A halted motion is not begun again, since the rover would do all of it once more.
        """
        del now_s, step_s
        if isinstance(wanted, Velocity) and wanted != STANDING:
            raise TypeError(f"{wanted} is no motion that this rover carries out by itself")
        if isinstance(wanted, WholeMotion) and self._status.odometry_fresh:
            if wanted.number > self._begun:
                self._motion, self._begun = wanted, wanted.number
                self._rover.carry_out(wanted)
        elif self._under_way:
            self.stop()
        elif wanted is None:
            self._motion = None
        elif self._told_at_s is None and not self._status.standing:
            self.stop()
        else:
            self.hold()

    @property
    def _under_way(self) -> bool:
        if self._motion is None:
            return False
        ended = self._status.motion_ended
        return ended is None or ended.number != self._motion.number
