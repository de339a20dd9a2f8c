"""`Arbiter`, the only writer of the actuators: after each tick, and at once on a stop (e-stop).

Only a stop does not wait for the core's thread: `emergency_stop` commands zero velocity from the
thread that received it. No lock is needed. The stop is queued first, and the core checks the queue
before it commands a motion and again after it. In any order of the two threads, zero velocity is
commanded last.

The arbiter merges the intents of the leaves and owns the stop latch and the dead-man. Its hold does
not depend on the tree. `make_locomotion` selects the locomotion of an asset.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, assert_never

from executive.commands.lifecycle import CommandLifecycle
from executive.motion.delegated_motion import DelegatedDriver, DelegatedLocomotion
from executive.motion.locomotion import BaseDriver, Locomotion
from executive.motion.navigation import NavigationDriver, NavigationLocomotion
from executive.motion.predictive_control import PredictiveLocomotion
from executive.motion.trajectory import TrajectorySolver
from executive.motion.velocity_control import VelocityDriver, VelocityLocomotion
from executive.settings import LocomotionKind, Settings, SettingsError
from executive.state import Status
from executive.values.clock import Clock
from executive.values.geometry import STANDING, Velocity
from executive.values.ports import (
    CameraIntent,
    DelegatedMotionRover,
    MotionIntent,
    NavigationRover,
    PathRequest,
    Rover,
    VelocityRover,
)
from executive.values.reasons import Identity, Refusal

NO_SOLVER: Final = "mpc needs a trajectory solver, and the executive was started without one"

NO_NAVIGATION: Final = "the settings have the section navigation, but this rover has no navigation"


@dataclass(slots=True)
class Intents:
    """The actuator commands that the leaves request in this tick; cleared before the next."""

    motion: MotionIntent | None = None
    camera: CameraIntent | None = None
    frame: bool = False
    path: PathRequest | None = None

    def clear(self) -> None:
        """Remove all intents."""
        self.motion = None
        self.camera = None
        self.frame = False
        self.path = None


class Arbiter:
    """Turns intents into actuator commands. While latched it holds zero velocity in each tick.

    Args:
        stop_pending: whether a received stop is still pending in the core's queue.
    """

    def __init__(
        self,
        clock: Clock,
        settings: Settings,
        rover: Rover,
        mover: BaseDriver,
        stop_pending: Callable[[], bool],
    ) -> None:
        self._clock = clock
        self._settings = settings
        self._rover = rover
        self._driver = mover
        self._stop_pending = stop_pending
        self.latched = False
        self._committed_at_s = clock.now_s()

    @property
    def velocity(self) -> Velocity:
        """The velocity that is commanded now."""
        return self._driver.velocity

    @property
    def expected(self) -> tuple[Velocity, Velocity]:
        """The lower and upper bound of the expected velocity; equal where it is known exactly."""
        return self._driver.expected

    def emergency_stop(self) -> None:
        """Command zero velocity, from any thread.

        A stop must be pending before (`stop_pending`).
        """
        self._rover.emergency_stop()

    def zero_velocity(self) -> None:
        """Command zero velocity now."""
        self._driver.stop()

    def stop(self) -> None:
        """Command zero velocity now, and hold it until `release`."""
        self.latched = True
        self.zero_velocity()
        self._rover.lock(True)

    def release(self) -> None:
        """End the stop latch."""
        self.latched = False
        if not self._stop_pending():
            self._rover.lock(False)

    def commit(self, intents: Intents) -> None:
        """Command the actuators according to the intents of this tick."""
        now_s = self._clock.now_s()
        step_s = min(max(now_s - self._committed_at_s, 0.0), 2 * self._settings.tick_s)
        self._committed_at_s = now_s
        if self.latched:
            self._driver.hold()
            self._rover.lock(True)
        elif not self._stop_pending():
            self._rover.lock(False)
            self._driver.commit(intents.motion, now_s, step_s)
            if self._stop_pending():
                self.zero_velocity()
                self._rover.lock(True)
        if intents.camera is not None:
            self._rover.point_camera(intents.camera)
        if intents.frame:
            self._rover.request_frame()
        if intents.path is not None and isinstance(self._rover, NavigationRover):
            self._rover.plan_path(intents.path)

    def stop_if_stale(self) -> None:
        """Dead-man: stop if intents are stale while moving. Called between ticks."""
        stale_s = self._settings.intent_stale_ticks * self._settings.tick_s
        if self.velocity != STANDING and self._clock.now_s() - self._committed_at_s > stale_s:
            if isinstance(self._driver, NavigationDriver):
                self._driver.shut()
            else:
                self.zero_velocity()


class Latches:
    """State that stop commands and faults set; cleared by a resume, or with the fault.

    Attributes:
        stopped_by: the command that stopped the rover, for display; None when not stopped.
        hazard: why the rover must not move; None when it may.
        safe: whether a hazard puts it into SAFE; otherwise into STOPPED.
        paused: why motion is paused; None when it is not.
        stopping: stop commands in execution, until the rover is stationary.
        stopped_from: the velocity that was commanded when a stop arrived.
    """

    def __init__(self) -> None:
        self.stopped_by: str | None = None
        self.hazard: Refusal | None = None
        self.safe = False
        self.paused: Refusal | None = None
        self.stopping: list[CommandLifecycle] = []
        self.stopped_from = STANDING

    @property
    def stop(self) -> Identity | None:
        """The id of the command that stopped the rover; None if not stopped, or if it is lost."""
        return None if self.stopped_by is None else Identity.parse(self.stopped_by)

    @property
    def held(self) -> bool:
        """Whether the rover must not move."""
        return self.stopped_by is not None or self.hazard is not None

    def take_stopping(self) -> list[CommandLifecycle]:
        """Return the stop commands in execution, which the caller ends."""
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
    """Return the locomotion of an asset, and the driver that commands its base.

    The solver computes trajectories for model predictive control, if the asset offers that.

    Raises:
        SettingsError: the settings offer model predictive control, and there is no solver; or a
            navigation, and the rover has none.
        TypeError: the rover is not of the kind that the settings name.
    """
    match settings.locomotion:
        case LocomotionKind.VELOCITY if isinstance(rover, VelocityRover):
            mover = VelocityDriver(clock, settings, status, rover)
            own = VelocityLocomotion(clock, settings, status)
            if settings.offers_mpc:
                if solver is None:
                    raise SettingsError(NO_SOLVER)
                own = PredictiveLocomotion(clock, settings, status, mover, solver)
            if settings.navigation is None:
                return own, mover
            if not isinstance(rover, NavigationRover):
                raise SettingsError(NO_NAVIGATION)
            driver = NavigationDriver(clock, settings, status, rover, mover)
            return NavigationLocomotion(clock, settings, status, own), driver
        case LocomotionKind.DELEGATED if isinstance(rover, DelegatedMotionRover):
            return DelegatedLocomotion(settings, status), DelegatedDriver(
                clock, settings, status, rover
            )
        case LocomotionKind.VELOCITY | LocomotionKind.DELEGATED:
            raise TypeError(f"{rover} does not support locomotion {settings.locomotion.value}")
        case _:
            assert_never(settings.locomotion)
