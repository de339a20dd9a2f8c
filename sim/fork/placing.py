"""`PlacedRover` puts a simulated rover where that of a recording was, at the moment of a fork.

During the replay it stores the commands of the core. With a recorded state of the simulation, or
its seed, physics then repeats these commands: the fork begins in the same state, to the last bit.
Without, the rover is put at the true pose, or at that of the odometry; its sensors continue those
of the recording in stamp, pose and constant errors.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from math import floor
from typing import Final

from executive.core.recording import (
    CargoChanged,
    Entry,
    ExecutiveKilled,
    FactObserved,
    SimulatedFaultChanged,
    SimulationItem,
    SimulationState,
    Truth,
)
from executive.settings import Settings
from executive.values.facts import Fact
from executive.values.geometry import STANDING, Velocity
from executive.values.ports import CameraIntent, NavigationGoal, PathRequest
from sim.fork.model import Placing
from sim.fork.seam import RecordedMotion, shifted
from sim.rover import faults
from sim.rover.body import PERIOD_S, SOON_S
from sim.rover.faults import SimulatedFault
from sim.rover.jackal import SimulatedJackal
from sim.rover.simulation import Simulation, fault_of

_SKIPPED_S: Final = 0.5
"""Time without a command beyond which the run skipped it: the rover rested."""
_VALID_S: Final = 0.25
"""Timeout of a velocity in the base."""
_OVER: Final = (
    faults.OdometryJump,
    faults.SecondOdometryJump,
    faults.Pushed,
    faults.Tip,
)
"""Faults that act at their begin only: the recorded pose contains their effect."""

Act = Callable[[SimulatedJackal], None]


class PlacedRover:
    """Rover of a replayed core: stores its commands until `start`, then forwards them.

    Args:
        settings: settings of the asset in the fork.
        simulation: world, seed and accuracy of the simulation of the fork.
        exact: whether these, the sensors and the mux are those of the recorded run.
        same_ground: whether the world is that of the run, also if the seed differs.

    Attributes:
        simulated: the simulated rover; not to be used before `start`.
    """

    def __init__(
        self, settings: Settings, simulation: Simulation, exact: bool, same_ground: bool = False
    ) -> None:
        self.simulated = SimulatedJackal(
            simulation.world,
            simulation.seed,
            simulation.odometry,
            simulation.picture,
            settings.sensors,
            settings.mux,
        )
        self._exact, self._same_ground, self._tick_s = exact, same_ground, settings.tick_s
        self._now_s, self._frame_s = 0.0, -1.0
        self._is_placed = self._is_stopping = self._is_killed = False
        self._state: SimulationState | None = None
        self._since: list[tuple[float, Act]] = []
        """Commands, faults and cargo since the state, or since the start."""
        self._faults: dict[type[SimulatedFault], SimulatedFault] = {}
        self._cargo_kg = 0.0
        self._held = False
        self._driven_s, self._driven = -1.0, STANDING
        self._pointed: CameraIntent | None = None
        self._motion = RecordedMotion(simulation.world.charge_ratio)

    def enter(self, entry: Entry) -> None:
        """Follow the next entry of the recording; called before the core runs it."""
        self._now_s = entry.now_s
        if self._is_stopping:
            self._is_stopping = False
            self._do(SimulatedJackal.emergency_stop)
        if isinstance(entry, FactObserved):
            repeats = self._faults.keys() & {faults.OdometryFrozen, faults.OdometryRepeated}
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
            case ExecutiveKilled():
                self._is_killed = True
            case CargoChanged():
                self._cargo_kg = item.mass_kg
                self._do(partial(SimulatedJackal.set_cargo_mass, mass_kg=item.mass_kg))
            case SimulatedFaultChanged():
                self._change_fault(fault_of(item), item.injected)
            case _:
                pass

    def start(self, at_s: float) -> Placing:
        """Put the simulated rover where the recorded one was, on the core's monotonic clock.

        Raises:
            CheckpointError: the recorded state is damaged, or of another version.
        """
        rover = self.simulated
        if self._state is None and not self._motion.truths:
            self._exact = False  # a live simulation may have begun before its recording
        if self._exact:
            placing = Placing.PHYSICS if self._state is None else Placing.STATE
            self._repeat(at_s)
        else:
            placing = Placing.TRUE_POSE if self._motion.truths else Placing.ODOMETRY
            self._put(floor((at_s + SOON_S) / PERIOD_S) * PERIOD_S)
            rover.advance(at_s - rover.time_s)
        rover.facts()
        self._is_placed = True
        if self._frame_s >= at_s - SOON_S:
            rover.request_frame()
        if self._is_stopping:
            rover.emergency_stop()
        return placing

    def facts(self) -> list[Fact]:
        """Return the facts published since the last call, with stamps of the recorded clock."""
        due, ahead_s = self.simulated.facts(), self._motion.ahead_s
        return due if self._exact or not ahead_s else [shifted(each, ahead_s) for each in due]

    def _change_fault(self, fault: SimulatedFault, begins: bool) -> None:
        kind = type(fault)
        if kind is faults.LinkLost:
            return
        self._faults.pop(kind, None)
        if begins:
            self._faults[kind] = fault
            self._do(partial(SimulatedJackal.inject, fault=fault))
        else:
            self._do(partial(SimulatedJackal.clear, kind=kind))

    def _repeat(self, at_s: float) -> None:
        """Repeat the physics since the recorded state."""
        rover = self.simulated
        if self._state is not None:
            rover.restore(self._state.text)
        for now_s, act in (*self._since, (at_s, SimulatedJackal.facts)):
            time_s = now_s + self._motion.ahead_s
            skipped_s = time_s - rover.time_s - self._tick_s
            if skipped_s > _SKIPPED_S and not self._is_killed:
                rover.skip(skipped_s)
            rover.advance(time_s - rover.time_s)
            rover.facts()
            act(rover)

    def _put(self, time_s: float) -> None:
        """Put the rover in motion, at the end of a period of its base."""
        rover = self.simulated
        rover.skip(time_s - rover.time_s)
        rover.set_cargo_mass(self._cargo_kg)
        for fault in self._faults.values():
            if isinstance(fault, _OVER):
                rover.mark(fault)
            elif faults.unsupported_reason(type(fault), rover.parts) is None:
                rover.inject(fault)
        rover.lock(self._held)
        if self._pointed is not None:
            rover.point_camera(self._pointed)
        commanded = STANDING
        if time_s - self._driven_s < _VALID_S:
            rover.drive(self._driven)
            commanded = STANDING if faults.CmdVelLost in self._faults else self._driven
        late = rover.fault(faults.OdometryLate)
        at = self._motion.placement(time_s, 0.0 if late is None else late.by_s)
        exact = self._same_ground and bool(self._motion.truths)
        rover.continue_from(replace(at, commanded=commanded, exact=exact))

    def _do(self, act: Act) -> None:
        if self._is_placed:
            act(self.simulated)
        elif self._exact:
            self._since.append((self._now_s, act))

    def drive(self, velocity: Velocity) -> None:
        """Command a velocity."""
        self._driven_s, self._driven = self._now_s, velocity
        self._do(partial(SimulatedJackal.drive, velocity=velocity))

    def lock(self, held: bool) -> None:
        """Hold or release the mux lock."""
        self._held = held
        self._do(partial(SimulatedJackal.lock, held=held))

    def emergency_stop(self) -> None:
        """Stop; during the replay at the next entry, which is when the recorded rover stopped."""
        if self._is_placed:
            self.simulated.emergency_stop()
        self._is_stopping = not self._is_placed

    def point_camera(self, wanted: CameraIntent) -> None:
        """Command the camera's angles."""
        self._pointed = wanted
        self._do(partial(SimulatedJackal.point_camera, wanted=wanted))

    def request_frame(self) -> None:
        """Request a picture; before the fork the recording has it."""
        self._frame_s = self._now_s
        if self._is_placed:
            self.simulated.request_frame()

    def navigate(self, goal: NavigationGoal) -> None:
        """Send a goal; the simulation has no navigation."""
        self._do(partial(SimulatedJackal.navigate, goal=goal))

    def cancel_navigation(self) -> None:
        """Cancel nothing."""

    def open_gate(self, is_open: bool) -> None:
        """Leave the gate shut."""

    def plan_path(self, request: PathRequest) -> None:
        """Request a path; the simulation has no planner."""
        self._do(partial(SimulatedJackal.plan_path, request=request))
