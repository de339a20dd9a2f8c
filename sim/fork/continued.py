"""`continued` replays a recording up to a moment, and continues it in lock step from there.

The core is the replayed one, with all of its state; the rover is a simulated one, put where the
recorded rover was. Recordings without a timeline of their simulation are forked so.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from adapters.recording import RecordingError
from adapters.recording.replayed import RecordedEntry, ReplayedCore, differing, topic_of
from executive.core.recording import (
    CoreCall,
    CoreCalled,
    Entry,
    ProcessStart,
    RecordingSink,
    SimulationItem,
    Truth,
)
from executive.core.runner import Executive
from executive.settings import Settings
from executive.values.clock import ManualClock
from sim.fork.model import Placing
from sim.fork.placing import PlacedRover
from sim.fork.run_log import Step
from sim.rover import World
from sim.rover.lockstep import STEP_S, LockStep
from sim.scenario.record import ALMOST_S

TICK: Final = "/in/tick"


class _ForkedClock(ManualClock):
    """Seconds since the first entry of a recording; it sets the clock of the replayed core."""

    def __init__(self, core: ReplayedCore, first: Entry, ahead_s: float) -> None:
        super().__init__(first.utc_s)
        self._core, self._core_s, self._ahead_s = core, first.now_s, ahead_s

    def set(self, now_s: float) -> None:
        """Set the time."""
        super().set(now_s)
        utc_s = self.utc_s() + self._ahead_s
        core_s = self._core_s + self.now_s() + self._ahead_s
        self._core.clock.entry = CoreCalled(core_s, utc_s, CoreCall.TICK)


class ContinuedLockStep(LockStep):
    """Lock step after a fork has left its recording.

    Args:
        steps: items of the recording in their order.
        settings: settings of the fork, from the start of the recording on.
        rover: the rover that continues it.
        latest_s: latest time, since the first entry; an earlier difference is earlier.
        folder: new folder for ledgers and files.
        tape: receives the recording of the fork, from its start on.

    Attributes:
        placing: how the rover was put there.
        seam_s: time of the last recorded tick, since the first entry.

    Raises:
        RecordingError: the recording has no tick, or the core raises during its replay.
        ValueError: the rover cannot be simulated: its world or its recorded state is not valid.
    """

    placing: Placing
    seam_s: float
    clock: _ForkedClock
    rover: PlacedRover

    def __init__(
        self,
        steps: Sequence[Step],
        settings: Settings,
        rover: PlacedRover,
        latest_s: float,
        folder: Path,
        tape: RecordingSink,
    ) -> None:
        self._recorded, self._latest_s, self._sink = steps, latest_s, tape
        self._core: ReplayedCore | None = None
        super().__init__(settings, World(), folder, tape=tape, rover=rover)

    def record(self, item: SimulationItem) -> None:
        """Add an item to the recording, with the time of the replayed core."""
        assert self._core is not None
        self._sink.put(replace(item, time_s=self._core.clock.now_s()))

    def _start(self) -> Executive:
        if self._core is not None:
            return super()._start()
        entries = [each.entry for each in self._recorded if isinstance(each, RecordedEntry)]
        ticks_s = [each.now_s for each in entries if topic_of(each).name == TICK]
        if not ticks_s:
            raise RecordingError("the recording has no tick: it cannot be continued")
        began_s, tick_s = entries[0].now_s, self.settings.tick_s
        latest_s = began_s + self._latest_s + ALMOST_S
        until_s = max((each for each in ticks_s if each <= latest_s), default=ticks_s[0])
        self._core, until_s = self._replay(until_s, ticks_s)
        following = (each for each in entries if each.now_s > until_s + ALMOST_S)
        self.placing = self.rover.start(until_s, following)
        executive = self._core.continue_live(self._solver)
        executive.wake = self._wake
        self._seen = self.rover
        self.seam_s = until_s - began_s
        self._steps = round(self.seam_s / tick_s) * round(tick_s / STEP_S)
        ahead_s = self.seam_s - self._steps * STEP_S
        ahead_s = 0.0 if abs(ahead_s) < ALMOST_S else ahead_s
        self.clock = _ForkedClock(self._core, entries[0], ahead_s)
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
                    start, self._folder, self.rover, solver, self._sink, self._downlinks
                )
            elif isinstance(each, SimulationItem):
                if each.time_s <= until_s + ALMOST_S:
                    self.rover.take(each)
                    if isinstance(each, Truth):
                        self._sink.put(each)
            elif core is not None:
                if each.entry.now_s > until_s + ALMOST_S:
                    break
                self.rover.enter(each.entry)
                core.enter(each)
                if core.raised:
                    raise RecordingError(f"cannot be replayed: {core.raised}")
                if differing(each.decisions, core.decisions):
                    until_s = next((t for t in ticks_s if t >= each.entry.now_s), until_s)
        assert core is not None
        return core, until_s
