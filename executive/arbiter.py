"""The only writer of the actuators: once a tick, after the tick, and at once on a stop.

It applies speed and acceleration limits, the stop latch, and the dead-man. It holds whatever the
tree does.
"""

from executive.geometry import STANDING, Velocity
from executive.intents import Intents
from executive.ports import Clock, Rover
from executive.settings import Settings
from executive.status import Status

RELEASE_S = 0.5


class Arbiter:
    """Turns intents into actuator commands.

    When nothing is wanted it ramps down, sends zero for `RELEASE_S` (longer than the rover's own
    command timeout) and then keeps silent, so that another publisher, a joystick, may drive
    (thesis 5.1.4). While latched it keeps sending zero.

    Attributes:
        velocity: what was last sent.
        latched: whether the stop latch holds.
    """

    def __init__(self, clock: Clock, settings: Settings, status: Status, rover: Rover) -> None:
        """Stand, unlatched and silent."""
        self._clock = clock
        self._settings = settings
        self._status = status
        self._rover = rover
        self.velocity = STANDING
        self.latched = False
        self._committed_at_s = clock.now_s()
        self._moved_at_s = clock.now_s() - RELEASE_S

    def stop(self) -> None:
        """Send zero now and hold it until `release`."""
        self.latched = True
        self._send(STANDING)

    def release(self) -> None:
        """Let intents through again."""
        self.latched = False

    def commit(self, intents: Intents) -> None:
        """Send what becomes of this tick's intents."""
        now_s = self._clock.now_s()
        step_s = min(max(now_s - self._committed_at_s, 0.0), 2 * self._settings.tick_s)
        self._committed_at_s = now_s
        self._commit_motion(intents.motion, now_s, step_s)
        if intents.camera is not None:
            self._rover.point_camera(intents.camera.pan_rad, intents.camera.tilt_rad)
        if intents.frame:
            self._rover.request_frame()

    def set_camera_speed(self, speed_radps: float) -> None:
        """Set the greatest angular speed of the camera."""
        self._rover.set_camera_speed(speed_radps)

    def guard(self) -> None:
        """Dead-man: stand if intents have gone stale while moving. Called between ticks."""
        stale_s = self._settings.intent_stale_ticks * self._settings.tick_s
        if self.velocity != STANDING and self._clock.now_s() - self._committed_at_s > stale_s:
            self._send(STANDING)

    def _commit_motion(self, wanted: Velocity | None, now_s: float, step_s: float) -> None:
        if self.latched:
            self._send(STANDING)
        elif wanted is None:
            if self.velocity != STANDING:
                self._send(self._slew(STANDING, step_s))
            elif now_s - self._moved_at_s < RELEASE_S:
                self._send(STANDING)
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
