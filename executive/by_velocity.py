"""Moving a rover that takes velocities: turn-then-drive by its laws, ramps, silence when idle."""

from typing import Final

from executive.clock import Clock
from executive.commands import Command, DriveFor
from executive.geometry import STANDING, Velocity
from executive.legs import Leg
from executive.motions import Wanted
from executive.ports import VelocityRover
from executive.reasons import Refusal
from executive.settings import Settings
from executive.status import Status
from executive.turn_drive import DriveLaw, TurnLaw

RELEASE_S: Final = 0.5
SETTLE_S: Final = 5.0


class VelocityLocomotion:
    """Makes motions that want a velocity in each tick."""

    alone = False

    def __init__(self, clock: Clock, settings: Settings, status: Status) -> None:
        """Move the rover of this status."""
        self._clock = clock
        self._settings = settings
        self._status = status

    def turn(self, _: Command, leg: Leg, final: bool) -> TurnLaw | None:
        """Return the turn of a leg, if it has one."""
        heading_rad = leg.heading_rad if final else leg.toward_rad
        if heading_rad is None:
            return None
        return TurnLaw(
            heading_rad,
            self._settings,
            self._status,
            self._clock.now_s(),
            leg.turn_rad if final else None,
        )

    def line(self, _: Command, leg: Leg) -> DriveLaw | None:
        """Return the straight line of a leg, if it has one."""
        if leg.target is None:
            return None
        return DriveLaw(
            leg.target,
            leg.reverse,
            leg.tolerance_m,
            self._settings,
            self._status,
            self._clock.now_s(),
        )

    def hold(self, _: Command, request: DriveFor) -> "HoldLaw":
        """Return the holding of a velocity."""
        return HoldLaw(request, self._clock, self._status)


class HoldLaw:
    """Holds a velocity for its time, then stands."""

    fault: Refusal | None = None

    def __init__(self, request: DriveFor, clock: Clock, status: Status) -> None:
        """Begin now."""
        self.expected_s = request.duration_s + SETTLE_S
        self._velocity = Velocity(request.travel_mps, request.rotate_radps)
        self._until_s = clock.now_s() + request.duration_s
        self._clock = clock
        self._status = status

    @property
    def done(self) -> bool:
        """Whether its time is over and the rover stands."""
        return self._left_s <= 0.0 and self._status.standing

    @property
    def ending(self) -> bool:
        """Whether another motion may take over: not before it stands."""
        return self.done

    @property
    def left(self) -> str:
        """The time left, for people."""
        return f"{max(self._left_s, 0.0):.2f} s left"

    def renew(self, _: float) -> bool:
        """Keep to what was asked: the arbiter sees to the greatest speeds."""
        return False

    def want(self, _: float) -> Velocity:
        """Return the velocity, or to stand once its time is over."""
        return self._velocity if self._left_s > 0.0 else STANDING

    @property
    def _left_s(self) -> float:
        left_s = self._until_s - self._clock.now_s()
        return left_s if left_s > 1e-9 else 0.0


class VelocityMover:
    """Sends velocities within speed and acceleration limits.

    When nothing is wanted it ramps down, sends zero for `RELEASE_S` (longer than the rover's own
    command timeout) and then keeps silent, so that another publisher, a joystick, may drive
    (thesis 5.1.4).

    Attributes:
        velocity: what was last sent.
    """

    def __init__(
        self, clock: Clock, settings: Settings, status: Status, rover: VelocityRover
    ) -> None:
        """Send nothing yet."""
        self._settings = settings
        self._status = status
        self._rover = rover
        self.velocity = STANDING
        self._moved_at_s = clock.now_s() - RELEASE_S

    def stop(self) -> None:
        """Send zero now."""
        self._send(STANDING)

    def hold(self) -> None:
        """Send zero again."""
        self.stop()

    def commit(self, wanted: Wanted | None, now_s: float, step_s: float) -> None:
        """Send what becomes of a velocity."""
        if wanted is None:
            if self.velocity != STANDING:
                self._send(self._slew(STANDING, step_s))
            elif now_s - self._moved_at_s < RELEASE_S:
                self._send(STANDING)
        elif not isinstance(wanted, Velocity):
            raise TypeError(f"{wanted} is no velocity")
        elif not (wanted.finite and self._status.odometry_fresh):
            self._send(STANDING)
        else:
            self._send(self._slew(wanted, step_s))
        if wanted is not None or self.velocity != STANDING:
            self._moved_at_s = now_s

    def _slew(self, wanted: Velocity, step_s: float) -> Velocity:
        limits, status = self._settings.drive, self._status
        return Velocity(
            _approach(
                self.velocity.travel_mps,
                _clamp(wanted.travel_mps, status.travel_speed_mps),
                limits.travel_acceleration_mps2 * step_s,
            ),
            _approach(
                self.velocity.rotate_radps,
                _clamp(wanted.rotate_radps, status.rotate_speed_radps),
                limits.rotate_acceleration_radps2 * step_s,
            ),
        )

    def _send(self, velocity: Velocity) -> None:
        self.velocity = velocity
        self._rover.drive(velocity)


def _clamp(value: float, bound: float) -> float:
    return max(-bound, min(bound, value))


def _approach(present: float, wanted: float, step: float) -> float:
    return max(present - step, min(present + step, wanted))
