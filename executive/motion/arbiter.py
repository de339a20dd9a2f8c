"""The only writer of the actuators: once a tick, after the tick, and at once on a stop.

A stop is the one thing that does not wait for the core's thread: `emergency_stop` makes the rover
stand from the thread that received it. No lock is needed, since the stop stands in the queue
before: the core looks there before it commands a motion and again after it, so that whatever the
order of the two threads, the last that the rover is told is to stand.

It takes the intents of the leaves, keeps the stop latch and the dead-man, and holds whatever the
tree does. `make_locomotion` chooses how the rover of an asset is moved.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, assert_never

from executive.commands.lifecycle import CommandLifecycle
from executive.motion.delegated_motion import DelegatedDriver, DelegatedLocomotion
from executive.motion.locomotion import BaseDriver, Locomotion
from executive.motion.plan import TrajectorySolver
from executive.motion.predictive_control import PredictiveLocomotion
from executive.motion.velocity_control import VelocityDriver, VelocityLocomotion
from executive.settings import LocomotionKind, Settings, SettingsError
from executive.state import Status
from executive.values.clock import Clock
from executive.values.geometry import STANDING, Velocity
from executive.values.ports import CameraIntent, DelegatedMotionRover, Rover, VelocityRover, Wanted
from executive.values.reasons import Refusal

NO_SOLVER: Final = "mpc needs a solver of plans, and the executive was started without one"


@dataclass(slots=True)
class Intents:
    """What the leaves want of each actuator in this tick; emptied before the next."""

    motion: Wanted | None = None
    camera: CameraIntent | None = None
    frame: bool = False

    def clear(self) -> None:
        """Remove all intents."""
        self.motion = None
        self.camera = None
        self.frame = False


class Arbiter:
    """Turns intents into actuator commands. While latched it makes the rover stand in each tick.

    Args:
        stop_waits: whether a stop has been received that the core has not come to yet.
    """

    def __init__(
        self,
        clock: Clock,
        settings: Settings,
        rover: Rover,
        mover: BaseDriver,
        stop_waits: Callable[[], bool],
    ) -> None:
        self._clock = clock
        self._settings = settings
        self._rover = rover
        self._mover = mover
        self._stop_waits = stop_waits
        self.latched = False
        self._committed_at_s = clock.now_s()

    @property
    def velocity(self) -> Velocity:
        """What the rover is made to do now."""
        return self._mover.velocity

    @property
    def expected(self) -> tuple[Velocity, Velocity]:
        """Between which velocities the rover should be now; the same twice where that is known."""
        return self._mover.expected

    def emergency_stop(self) -> None:
        """Make the rover stand, from any thread; for a stop, once `stop_waits`."""
        self._rover.emergency_stop()

    def stand(self) -> None:
        """Make the rover stand now."""
        self._mover.stop()

    def stop(self) -> None:
        """Make the rover stand now, and hold it until `release`."""
        self.latched = True
        self.stand()
        self._rover.lock(True)

    def release(self) -> None:
        """End the stop latch."""
        self.latched = False
        if not self._stop_waits():
            self._rover.lock(False)

    def commit(self, intents: Intents) -> None:
        """Command the actuators by this tick's intents."""
        now_s = self._clock.now_s()
        step_s = min(max(now_s - self._committed_at_s, 0.0), 2 * self._settings.tick_s)
        self._committed_at_s = now_s
        if self.latched:
            self._mover.hold()
            self._rover.lock(True)
        elif not self._stop_waits():
            self._rover.lock(False)
            self._mover.commit(intents.motion, now_s, step_s)
            if self._stop_waits():
                self.stand()
                self._rover.lock(True)
        if intents.camera is not None:
            self._rover.point_camera(intents.camera)
        if intents.frame:
            self._rover.request_frame()

    def guard(self) -> None:
        """Dead-man: stand if intents have gone stale while moving. Called between ticks."""
        stale_s = self._settings.intent_stale_ticks * self._settings.tick_s
        if self.velocity != STANDING and self._clock.now_s() - self._committed_at_s > stale_s:
            self.stand()


class Latches:
    """Set by stop commands and faults, cleared by resume, or with the fault.

    Attributes:
        stopped_by: the command that stopped the rover, for people; None when not stopped.
        hazard: why the rover must stand; None when it may move.
        safe: whether a hazard makes it SAFE; else it is STOPPED by it.
        paused: why motion waits; None when it does not.
        stopping: stop commands under way, until the rover stands.
        stopped_from: what the rover was last made to do when a stop came.
    """

    def __init__(self) -> None:
        self.stopped_by: str | None = None
        self.hazard: Refusal | None = None
        self.safe = False
        self.paused: Refusal | None = None
        self.stopping: list[CommandLifecycle] = []
        self.stopped_from = STANDING

    @property
    def held(self) -> bool:
        """Whether the rover must not move."""
        return self.stopped_by is not None or self.hazard is not None

    def take_stopping(self) -> list[CommandLifecycle]:
        """Return the stop commands under way, for the caller to end."""
        stopping, self.stopping = self.stopping, []
        return stopping

    def clear(self) -> None:
        """Release stop, hazard and pause."""
        self.stopped_by = None
        self.hazard = None
        self.safe = False
        self.paused = None


def make_locomotion(
    rover: VelocityRover | DelegatedMotionRover,
    clock: Clock,
    settings: Settings,
    status: Status,
    solver: TrajectorySolver | None = None,
) -> tuple[Locomotion, BaseDriver]:
    """Return what makes motions, and what commands them, of an asset.

    The solver plans for model predictive control, where the asset offers that.

    Raises:
        SettingsError: the settings offer model predictive control, and there is no solver.
        TypeError: the rover is not of the kind that the settings name.
    """
    match settings.locomotion:
        case LocomotionKind.VELOCITY if isinstance(rover, VelocityRover):
            mover = VelocityDriver(clock, settings, status, rover)
            if settings.offers_mpc:
                if solver is None:
                    raise SettingsError(NO_SOLVER)
                return PredictiveLocomotion(clock, settings, status, mover, solver), mover
            return VelocityLocomotion(clock, settings, status), mover
        case LocomotionKind.WHOLE_MOTION if isinstance(rover, DelegatedMotionRover):
            return DelegatedLocomotion(settings, status), DelegatedDriver(
                clock, settings, status, rover
            )
        case LocomotionKind.VELOCITY | LocomotionKind.WHOLE_MOTION:
            raise TypeError(f"{rover} does not move by {settings.locomotion.value}")
        case _:
            assert_never(settings.locomotion)
