"""Replays a recording in memory with a `PlacedRover`, which is simulated from a moment on."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from adapters.recording.replayed import RecordedEntry, ReplayedCore
from executive.core.recording import (
    Entry,
    Input,
    Item,
    ProcessStart,
    SimulationItem,
    SimulationStarted,
    Truth,
    is_within,
)
from executive.values.geometry import Pose
from sim.fork.model import Placing
from sim.fork.placing import PlacedRover
from sim.rover.simulation import Simulation


@dataclass(slots=True)
class Followed:
    """True poses of recording and simulation, from the moment of placing on."""

    placing: Placing | None = None
    recorded: list[Pose] = field(default_factory=list)
    simulated: list[Pose] = field(default_factory=list)


def steps_of(items: Sequence[Item]) -> Iterator[ProcessStart | RecordedEntry | SimulationItem]:
    """Yield starts, entries with their inputs, and simulation items, in the order of their time."""
    entry: RecordedEntry | None = None
    waiting: list[SimulationItem] = []
    for item in items:
        if isinstance(item, SimulationItem):
            waiting.append(item)
        elif isinstance(item, Input) or is_within(item):
            assert entry is not None
            entry.inputs.append(item)
        elif isinstance(item, Entry | ProcessStart):
            if entry is not None:
                yield entry
            yield from waiting
            waiting, entry = [], None
            if isinstance(item, ProcessStart):
                yield item
            else:
                entry = RecordedEntry(item)
    if entry is not None:
        yield entry


def follow(
    items: Sequence[Item],
    at_s: float,
    folder: Path,
    exact: bool = True,
    has_truth: bool = True,
) -> Followed:
    """Replay a recording, start a rover at a time, and give it the further recorded commands."""
    (simulation,) = (Simulation.of(each) for each in items if isinstance(each, SimulationStarted))
    found, core, rover = Followed(), None, None
    for number, step in enumerate(steps_of(items)):
        now_s = (
            step.entry.now_s if isinstance(step, RecordedEntry) else getattr(step, "time_s", 0.0)
        )
        if rover is not None and found.placing is None and now_s > at_s + 1e-6:
            found.placing = rover.start(at_s)
        if rover is not None and found.placing is not None:
            rover.advance(now_s - rover.time_s)
        if isinstance(step, ProcessStart):
            rover = rover or PlacedRover(step.settings, simulation, exact, same_ground=True)
            core = ReplayedCore(step, folder / str(number), rover)
        elif isinstance(step, RecordedEntry):
            assert core is not None
            assert rover is not None
            rover.enter(step.entry)
            core.enter(step)
            assert not core.raised
        elif rover is not None:
            if has_truth or not isinstance(step, Truth):
                rover.take(step)
            if isinstance(step, Truth) and found.placing is not None:
                found.recorded.append(step.pose)
                found.simulated.append(rover.true_pose)
    return found
