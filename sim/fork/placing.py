"""`PlacedRover` is a simulated rover that continues a recorded one from the moment of a fork.

During the replay it stores the commands of the core. With a recorded state of the simulation,
physics then repeats the commands since: the fork begins in the same state, to the last bit.
Without, the rover is put at the true pose, or at that of the odometry; its sensors continue those
of the recording in stamp, pose and constant errors.
"""

from collections import deque
from collections.abc import Callable, Iterable
from functools import partial
from math import cos, floor, inf, sin
from typing import Any, Final

import numpy as np

from executive.core.recording import (
    CargoChanged,
    Entry,
    FactObserved,
    SimulatedFaultChanged,
    SimulationItem,
    SimulationState,
    Truth,
)
from executive.settings import Settings
from executive.values.facts import (
    Battery,
    EmergencyStop,
    ExternalAuthorityUse,
    ExternalCommandEnded,
    ExternalCommandRunning,
    ExternalStop,
    Fact,
    ForeignPublishers,
    LaserScan,
    MapToOdom,
    Odometry,
    RejectedData,
    SecondOdometry,
)
from executive.values.geometry import STANDING, Velocity
from executive.values.ports import CameraIntent
from sim.fork.model import Placing
from sim.fork.seam import RecordedMotion, shifted
from sim.rover import faults
from sim.rover.body import PERIOD_S, SOON_S
from sim.rover.faults import SimulatedFault
from sim.rover.instruments import InertialUnit
from sim.rover.jackal import SimulatedJackal
from sim.rover.lockstep import STEP_S
from sim.rover.sensors import VisualOdometry
from sim.rover.simulation import Simulation, fault_of

_VALID_S: Final = 0.25
"""Timeout of a velocity in the base."""
_WHEEL_RATES: Final = slice(6, 10)
_LASTING: Final = ("set_cargo_mass", "lock", "point_camera")
"""Commands that hold until the next one of their kind."""
_OVER: Final = (
    faults.OdometryJump,
    faults.SecondOdometryJump,
    faults.Pushed,
    faults.Tip,
)
"""Faults that act at their begin only: the recorded pose contains their effect."""
_OTHERS: Final = (
    ForeignPublishers,
    ExternalCommandEnded,
    ExternalCommandRunning,
    ExternalStop,
    ExternalAuthorityUse,
    RejectedData,
    EmergencyStop,
    MapToOdom,
)
"""Facts that neither rover nor decisions cause: they occur in a fork as recorded."""
MAX_LATENCY_S: Final = 1.0
"""Maximum time from a measurement to its arrival: twice that of the second odometry."""


class PlacedRover(SimulatedJackal):
    """Rover of a replayed core: stores its commands until `start`, and then follows them.

    Args:
        settings: settings of the asset in the fork.
        simulation: world, seed and accuracy of the simulation of the fork.
        exact: whether these, the sensors and the mux are those of the recorded run.
        same_ground: whether the world is that of the run, also if the seed differs.
        late: whether odometry arrives when it did in the recording, with its age, and the battery
            is the recorded one: for a rover at work; its faults are not known.
    """

    def __init__(
        self,
        settings: Settings,
        simulation: Simulation,
        exact: bool,
        same_ground: bool = False,
        late: bool = False,
    ) -> None:
        parts = simulation.world, simulation.seed, simulation.odometry, simulation.picture
        super().__init__(*parts, settings.sensors, settings.mux)
        self._exact, self._same_ground, self._late = exact, same_ground, late
        self._now_s, self._frame_s = 0.0, -1.0
        self._is_placed = self._is_stopping = False
        self._state: SimulationState | None = None
        self._since: list[tuple[float, Callable[[], object]]] = []
        """Commands, faults and cargo since the state."""
        self._last: dict[str, Callable[[], object]] = {}
        self._injected: dict[type[SimulatedFault], SimulatedFault] = {}
        self._driven_s, self._driven = -1.0, STANDING
        self._motion = RecordedMotion(simulation.world.charge_ratio)
        self._recorded: deque[FactObserved] = deque()
        self._recorded_until_s = self._last_stamp_s = -inf
        self._measured: deque[Odometry] = deque()
        self._arrived: list[Fact] = []

    def enter(self, entry: Entry) -> None:
        """Follow the next entry of the recording; called before the core runs it."""
        self._now_s = entry.now_s
        if self._is_stopping:
            self._is_stopping = False
            self._do(super().emergency_stop)
        if isinstance(entry, FactObserved):
            repeats = self._injected.keys() & {faults.OdometryFrozen, faults.OdometryRepeated}
            self._motion.observe(entry.now_s, entry.fact, self._driven, not repeats)

    def take(self, item: SimulationItem) -> None:
        """Follow the next item of the simulation.

        Raises:
            ValueError: a fault is unknown here.
        """
        self._now_s = max(self._now_s, item.time_s)
        match item:
            case SimulationState():
                self._state, self._since = item, []
            case Truth():
                self._motion.truths.append((item.time_s, item.pose))
            case CargoChanged(mass_kg=mass_kg):
                self._do(super().set_cargo_mass, mass_kg)
            case SimulatedFaultChanged():
                self._change_fault(fault_of(item), item.injected)
            case _:
                pass

    def start(self, at_s: float, following: Iterable[Entry] = ()) -> Placing:
        """Continue where the recorded rover was.

        Args:
            at_s: time on the core's monotonic clock.
            following: entries of the recording after that.

        Raises:
            CheckpointError: the recorded state is damaged, or of another version.
        """
        self._is_placed, state = True, self._state if self._exact else None
        self._exact = state is not None
        if state is not None:
            placing = Placing.STATE
            self.restore(state.text)
            for now_s, act in (*self._since, (at_s, super().facts)):
                self.advance(now_s + self._motion.ahead_s - self.time_s)
                super().facts()
                act()
        else:
            placing = Placing.TRUE_POSE if self._motion.truths else Placing.ODOMETRY
            self._put(floor((at_s + SOON_S) / PERIOD_S) * PERIOD_S)
            self.advance(at_s - self.time_s)
            super().facts()
        if self._frame_s >= at_s - SOON_S:
            super().request_frame()
        if self._is_stopping:
            super().emergency_stop()
        for each in following:
            self._recorded_until_s = each.now_s
            if isinstance(each, FactObserved) and self._is_recorded(each.fact, at_s):
                self._recorded.append(each)
        return placing

    def facts(self) -> list[Fact]:
        """Return the simulated facts since the last call, and recorded ones of other sources.

        Their stamps are of the recorded clock.
        """
        found, ahead_s = super().facts(), self._motion.ahead_s
        now_s = self.time_s - (ahead_s if self._exact else 0.0)
        if ahead_s and not self._exact:
            found = [shifted(each, ahead_s) for each in found]
        if self._late and now_s <= self._recorded_until_s:
            self._measured += (each for each in found if isinstance(each, Odometry))
            found = [each for each in found if not isinstance(each, Odometry | Battery)]
        while self._recorded and self._recorded[0].now_s <= now_s + SOON_S:
            fact = self._recorded.popleft().fact
            found += self._odometry(fact) if isinstance(fact, Odometry) else [fact]
        return found

    def _is_recorded(self, fact: Fact, until_s: float) -> bool:
        """Return whether a fact after the seam is that of the recording, at least its arrival."""
        if isinstance(fact, SecondOdometry | LaserScan):  # measured before the seam
            return not self._exact and until_s - MAX_LATENCY_S < fact.stamp_s <= until_s
        return isinstance(fact, (*_OTHERS, Odometry, Battery) if self._late else _OTHERS)

    def _odometry(self, recorded: Odometry) -> list[Fact]:
        """Return the measured odometry for a recorded one: of its age, repeated if that was."""
        if recorded.stamp_s > self._last_stamp_s:
            self._last_stamp_s = recorded.stamp_s
            while self._measured and self._measured[0].stamp_s <= recorded.stamp_s + STEP_S:
                self._arrived = [self._measured.popleft()]
        return [*self._arrived]

    def _change_fault(self, fault: SimulatedFault, begins: bool) -> None:
        kind = type(fault)
        if kind is faults.LinkLost:
            return
        self._injected.pop(kind, None)
        if begins:
            self._injected[kind] = fault
            self._do(super().inject, fault)
        else:
            self._do(super().clear, kind)

    def _put(self, time_s: float) -> None:
        """Put the rover in motion, at the end of a period of its base."""
        self.skip(time_s - self.time_s)
        for each in (self._last[name] for name in _LASTING if name in self._last):
            each()
        for fault in self._injected.values():
            if isinstance(fault, _OVER):
                self._faults[type(fault)] = fault
            elif faults.unsupported_reason(type(fault), self.parts) is None:
                self.inject(fault)
        commanded = STANDING
        if time_s - self._driven_s < _VALID_S:
            super().drive(self._driven)
            commanded = STANDING if faults.CmdVelLost in self._injected else self._driven
        self._continue(time_s, commanded)

    def _continue(self, time_s: float, commanded: Velocity) -> None:
        """Continue the recorded motion and measurements; the base follows a velocity."""
        motion = self._motion
        pose, velocity = motion.at(time_s)
        is_same = self._same_ground and bool(motion.truths)
        self._disturbance.put(pose, None if is_same else 0.0)
        direction = np.array((cos(pose.heading_rad), sin(pose.heading_rad)))
        self._qvel[:2] = velocity.travel_mps * direction
        self._qvel[5] = velocity.rotate_radps
        if motion.camera is not None:
            self._qpos[self._head] = motion.camera.pan_rad, motion.camera.tilt_rad
            self._stuck_head = motion.camera if self._stuck_head else None
        self._battery.set_charge(motion.charge_ratio)
        self._pose, self._wheels_rad = pose, self._qpos[self._wheels].tolist()
        self._base.command(commanded, self.time_s)
        self._base.follow(commanded)
        speeds = self._unstuck(*self._base.wheels_radps(self.time_s, 0.0))
        self._qvel[_WHEEL_RATES] = 2 * speeds
        self._servos.set_now(*self._head_rad(*self._qpos[self._head].tolist()))
        late = self.fault(faults.OdometryLate)
        self._published, self._in_transit = motion.published, deque()
        for each in motion.measured(time_s, 0.0 if late is None else late.by_s):
            self._in_transit.append((each.stamp_s, each))
            self.odometry.pose = each.pose
        for instrument in self._suite.instruments:
            instrument.settle()
            if isinstance(instrument, VisualOdometry) and motion.second is not None:
                own = motion.second_pose(motion.second, pose)
                instrument.continue_from(motion.second, own)
            elif isinstance(instrument, InertialUnit) and motion.inertial_errors:
                instrument.set_errors(motion.inertial_errors)
        self._due.clear()
        self._actuate()

    def _do(self, act: Callable[..., object], *arguments: Any) -> None:
        """Carry out a command; before `start` store it."""
        if self._is_placed:
            act(*arguments)
            return
        self._last[act.__name__] = stored = partial(act, *arguments)
        if self._exact:
            self._since.append((self._now_s, stored))

    def drive(self, velocity: Velocity) -> None:
        """Command a velocity."""
        self._driven_s, self._driven = self._now_s, velocity
        self._do(super().drive, velocity)

    def lock(self, held: bool) -> None:
        """Hold or release the mux lock."""
        self._do(super().lock, held)

    def emergency_stop(self) -> None:
        """Stop; during the replay at the next entry, which is when the recorded rover stopped."""
        if self._is_placed:
            super().emergency_stop()
        self._is_stopping = not self._is_placed

    def point_camera(self, wanted: CameraIntent) -> None:
        """Command the camera's angles."""
        self._do(super().point_camera, wanted)

    def request_frame(self) -> None:
        """Request a picture; before the fork the recording has it."""
        self._frame_s = self._now_s
        if self._is_placed:
            super().request_frame()
