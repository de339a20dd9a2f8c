"""`continued` replays a recording up to a moment, and continues it in lock step from there.

The core is the replayed one, with all of its state; the rover is a simulated one, put where the
recorded rover was. Recordings without a timeline of their simulation are forked so.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path
from typing import Final

from adapters.recording import RecordingError
from adapters.recording.replayed import RecordedEntry, ReplayedCore, topic_of
from executive.core.recording import (
    CoreCall,
    CoreCalled,
    Entry,
    FactObserved,
    ProcessStart,
    RecordingSink,
    SimulationItem,
    Truth,
)
from executive.core.runner import Executive
from executive.settings import Settings
from executive.values.clock import ManualClock
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
from sim.fork.model import Placing
from sim.fork.placing import PlacedRover
from sim.fork.run_log import Step, differing
from sim.rover.lockstep import STEP_S, LockStep
from sim.rover.simulation import Simulation
from sim.scenario.record import ALMOST_S

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
TICK: Final = "/in/tick"


@dataclass(frozen=True, slots=True)
class Seam:
    """Where a fork leaves the recording.

    Attributes:
        simulation: world and seed of the simulation.
        exact, same_ground: see `PlacedRover`.
        late: whether odometry arrives when it did in the recording, with its age, and the battery
            is the recorded one: for a rover at work; its faults are not known.
        latest_s: latest time, since the first entry; an earlier difference is earlier.
    """

    simulation: Simulation
    exact: bool
    same_ground: bool
    late: bool
    latest_s: float = inf


class _ForkedClock(ManualClock):
    """Seconds since the first entry of a recording; it sets the clock of the replayed core."""

    def __init__(self, core: ReplayedCore, first: Entry, ahead_s: float) -> None:
        super().__init__(first.utc_s)
        self._core, self._core_s, self._ahead_s = core, first.now_s, ahead_s

    def set(self, now_s: float) -> None:
        """Set the time."""
        super().set(now_s)
        utc_s = self.utc_s() + self._ahead_s
        self._core.clock.entry = CoreCalled(self.core_s, utc_s, CoreCall.TICK)

    @property
    def core_s(self) -> float:
        """Time on the monotonic clock of the core."""
        return self._core_s + self.now_s() + self._ahead_s


class ContinuedLockStep(LockStep):
    """Lock step from the seam on.

    Args:
        steps: items of the recording in their order.
        settings: settings of the fork, from the start of the recording on.
        seam: its conditions.
        folder: new folder for ledgers and files.
        tape: receives the recording of the fork, from its start on.

    Attributes:
        placing: how the rover was put there.

    Raises:
        RecordingError: the recording has no tick, or the core raises during its replay.
        ValueError: the rover cannot be simulated: its world or its recorded state is not valid.
    """

    placing: Placing
    clock: _ForkedClock

    def __init__(
        self,
        steps: Sequence[Step],
        settings: Settings,
        seam: Seam,
        folder: Path,
        tape: RecordingSink,
    ) -> None:
        self._recorded, self._seam, self._sink = steps, seam, tape
        self._placed = PlacedRover(settings, seam.simulation, seam.exact, seam.same_ground)
        self._core: ReplayedCore | None = None
        self._others: deque[FactObserved] = deque()
        self._until_s = self._last_stamp_s = -inf
        self._measured: deque[Odometry] = deque()
        self._arrived: list[Fact] = []
        world, rover = seam.simulation.world, self._placed.simulated
        super().__init__(settings, world, folder, tape=tape, rover=rover)

    def record(self, item: SimulationItem) -> None:
        """Add an item to the recording, with the time of the replayed core."""
        assert self._core is not None
        self._sink.put(replace(item, time_s=self._core.clock.now_s()))

    def facts(self) -> list[Fact]:
        """Return the simulated facts since the last call, and recorded ones of other sources."""
        found, now_s = self._placed.facts(), self.clock.core_s
        if self._seam.late and now_s <= self._until_s:
            self._measured += (each for each in found if isinstance(each, Odometry))
            found = [each for each in found if not isinstance(each, Odometry | Battery)]
        while self._others and self._others[0].now_s <= now_s + ALMOST_S:
            fact = self._others.popleft().fact
            found += self._odometry(fact) if isinstance(fact, Odometry) else [fact]
        return found

    def _is_recorded(self, fact: Fact, until_s: float) -> bool:
        """Return whether a fact after the seam is that of the recording, at least its arrival."""
        if isinstance(fact, SecondOdometry | LaserScan):  # measured before the seam
            return not self._seam.exact and until_s - MAX_LATENCY_S < fact.stamp_s <= until_s
        return isinstance(fact, (*_OTHERS, Odometry, Battery) if self._seam.late else _OTHERS)

    def _odometry(self, recorded: Odometry) -> list[Fact]:
        """Return the measured odometry for a recorded one: of its age, repeated if that was."""
        if recorded.stamp_s > self._last_stamp_s:
            self._last_stamp_s = recorded.stamp_s
            while self._measured and self._measured[0].stamp_s <= recorded.stamp_s + STEP_S:
                self._arrived = [self._measured.popleft()]
        return [*self._arrived]

    def _start(self) -> Executive:
        if self._core is not None:
            return super()._start()
        entries = [each for each in self._recorded if isinstance(each, RecordedEntry)]
        ticks_s = [each.entry.now_s for each in entries if topic_of(each.entry).name == TICK]
        if not ticks_s:
            raise RecordingError("the recording has no tick: it cannot be continued")
        began_s, tick_s = entries[0].entry.now_s, self.settings.tick_s
        latest_s = began_s + self._seam.latest_s + ALMOST_S
        until_s = max((each for each in ticks_s if each <= latest_s), default=ticks_s[0])
        self._core, until_s = self._replay(until_s, ticks_s)
        self.placing = self._placed.start(until_s)
        executive = self._core.continue_live(self._solver)
        executive.wake = self._wake
        self._seen = self  # type: ignore[assignment]
        following = (each.entry for each in entries if each.entry.now_s > until_s + ALMOST_S)
        self._others = deque(
            each
            for each in following
            if isinstance(each, FactObserved) and self._is_recorded(each.fact, until_s)
        )
        self._until_s = entries[-1].entry.now_s
        self._steps = round((until_s - began_s) / tick_s) * round(tick_s / STEP_S)
        ahead_s = until_s - began_s - self._steps * STEP_S
        ahead_s = 0.0 if abs(ahead_s) < ALMOST_S else ahead_s
        self.clock = _ForkedClock(self._core, entries[0].entry, ahead_s)
        self.clock.set(self._steps * STEP_S)
        return executive

    def _replay(self, until_s: float, ticks_s: Sequence[float]) -> tuple[ReplayedCore, float]:
        """Replay up to a tick, or that of an earlier difference; return the core and its time."""
        core: ReplayedCore | None = None
        folder = self._folder
        for number, each in enumerate(self._recorded):
            if isinstance(each, ProcessStart):
                self._folder = folder / str(number)
                start = replace(each, settings=self.settings)
                solver = self._solver if each.solver_lead_ticks is None else None
                core = ReplayedCore(
                    start, self._folder, self._placed, solver, self._sink, self._downlinks
                )
            elif isinstance(each, SimulationItem):
                if each.time_s <= until_s + ALMOST_S:
                    self._placed.take(each)
                    if isinstance(each, Truth):
                        self._sink.put(each)
            elif core is not None:
                if each.entry.now_s > until_s + ALMOST_S:
                    break
                self._placed.enter(each.entry)
                core.enter(each)
                if core.raised:
                    raise RecordingError(f"cannot be replayed: {core.raised}")
                if differing(each.decisions, core.decisions):
                    until_s = next((t for t in ticks_s if t >= each.entry.now_s), until_s)
        assert core is not None
        return core, until_s
