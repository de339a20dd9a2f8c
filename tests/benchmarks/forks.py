"""Forks of recordings of campaigns: without a change, and with one where the world is not known.

The second sort knows neither ground nor noise of the recorded run, only the true poses and the
faults: it is compared with the scenario itself under the same change.
"""

import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import cycle, islice
from math import inf
from pathlib import Path
from random import Random
from typing import Final

from adapters.recording import RunFile
from executive.commands import MoveForward, RotateBy
from sim.campaign.draws import draw
from sim.campaign.reading import load_campaign
from sim.fork.forkable import Forkable
from sim.fork.model import AddedCommand, AddedFault, Change, Fidelity, ForkRun
from sim.rover.faults import fault_declaration, read_fault
from sim.scenario.changes import Override
from sim.scenario.lockstep_run import LockstepRun, run_in_lock_step
from sim.scenario.model import Inject, RunMode
from sim.scenario.reading import load_scenario
from tests.support.figures import Figure, Goal, quantile

EXACT: Final = ("faults", "normal", "obstacles", "unknown_rocks", "after_faults", "takeover")
"""Campaigns of the forks without a change."""
PLACED: Final = ("faults", "faults", "faults", "normal")
"""Campaigns of the others: on ground without rocks."""
SETTLED_S: Final = 2.0
MAX_S: Final = 18.0
"""Maximum duration of a recording: the motions of the campaigns on level ground last less."""
FAULTS: Final = ("left_wheels_stuck", "odometry_lost", "gyro_dead", "brownout", "pushed")


class _EndingRun(LockstepRun):
    """A run that ends some time after its last entry and its last command."""

    _busy_s = 0.0

    @property
    def has_ended(self) -> bool:
        """Whether nothing has happened for that time."""
        lock = self._lock
        if not lock.alive or lock.executive.goal_count or self._timeline.next_s() < inf:
            self._busy_s = lock.time_s
        return lock.time_s > self._busy_s + SETTLED_S + 0.5


def record(campaign: str, number: int, folder: Path) -> Path:
    """Record a run of a campaign; return the file."""
    drawn = draw(load_campaign(campaign), number)
    scenario = load_scenario(drawn.scenario, RunMode.LOCK_STEP, drawn.changes)
    path = folder / f"{campaign}-{number}.mcap"
    scenario = replace(scenario, duration_s=min(scenario.duration_s, MAX_S))
    with tempfile.TemporaryDirectory() as run, closing(RunFile(path)) as file:
        run_in_lock_step(scenario, Path(run), file, run=_EndingRun)
    return path


def changes(run: Forkable, random: Random) -> Iterator[Change]:
    """Yield changes of a run: its fault, its speed, a further motion, a further fault."""
    at_s = round(random.uniform(1.3, 3.0), 2)
    faults = [each for each in run.timeline if isinstance(each, Inject)]
    if faults:
        yield Change(without=(fault_declaration(type(faults[0].inject)).name,))
    yield Change(settings=(Override("drive.travel_speed", "0.6"),))
    requests = (RotateBy(1.0), RotateBy(-0.7), MoveForward(0.8))
    yield Change(added=(AddedCommand(random.choice(requests), at_s),))
    fault = read_fault(random.choice(FAULTS))
    yield Change(faults=(AddedFault(fault, at_s),))


@dataclass(frozen=True, slots=True)
class Pair:
    """A fork in an unknown world, and the scenario itself under the same change.

    Attributes:
        kind, reason: whether each command ends in the same stage, and for the same reason too.
        off_m: distance of the true positions after the last end; infinite if the kind differs.
        cpu_s: time of the processor for the fork.
    """

    text: str
    kind: bool
    reason: bool
    off_m: float
    cpu_s: float


def compare(path: Path, known: Forkable, unknown: Forkable, change: Change) -> Pair:
    """Fork both recordings, and compare the outcomes."""
    scenario = known.fork(change)
    began_s = time.process_time()
    fork = unknown.fork(change)
    cpu_s = time.process_time() - began_s
    stages = [[(c.command, c.stage) for c in each.outcome.commands] for each in (scenario, fork)]
    same = stages[0] == stages[1]
    reason = scenario.outcome.kinds == fork.outcome.kinds
    text = f"{path.stem} {change}\n  {scenario.outcome.kinds}\n  {fork.outcome.kinds}"
    return Pair(text, same, reason, _off_m(scenario, fork) if same else inf, cpu_s)


def _off_m(scenario: ForkRun, fork: ForkRun) -> float:
    ends_s = [c.end_s for each in (scenario, fork) for c in each.outcome.commands]
    at_s = max(ends_s, default=0.0) + SETTLED_S
    here, there = (
        next((p.pose for p in each.record.poses if p.time_s >= at_s), each.outcome.pose)
        for each in (scenario, fork)
    )
    return inf if here is None or there is None else here.point.distance_m(there.point)


def measure(recordings: int, pairs: int, seed: int, log: Callable[[str], object]) -> list[Figure]:
    """Return the figures of forks of recordings of campaigns."""
    random, equal = Random(seed), 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for campaign in islice(cycle(EXACT), recordings):
            path = record(campaign, random.randrange(1000), folder)
            _, fidelity = Forkable(path).unchanged()
            equal += fidelity is Fidelity.BIT_EQUAL
            if fidelity is not Fidelity.BIT_EQUAL:
                log(f"{path.stem}: {fidelity.value}")
            path.unlink(missing_ok=True)  # a number may be drawn twice
        compared = list(islice(_pairs(random, folder), pairs))
    for each in compared:
        if not each.reason:
            log(each.text)
    every = Goal(recordings, at_least=True)
    return [
        Figure("forks without a change, bit-equal", equal, "forks", f"of {recordings}", every),
        *_figures(compared),
    ]


def _pairs(random: Random, folder: Path) -> Iterator[Pair]:
    for campaign in cycle(PLACED):
        path = record(campaign, random.randrange(1000), folder)
        known, unknown = Forkable(path), Forkable(path, exact=False)
        for change in changes(known, random):
            yield compare(path, known, unknown, change)
        path.unlink(missing_ok=True)


def _figures(compared: Sequence[Pair]) -> list[Figure]:
    if not compared:
        return []
    number = len(compared)
    off_m = [each.off_m for each in compared if each.kind] or [inf]
    scenario = f"{number} pairs with the scenario itself"
    kind = sum(each.kind for each in compared) / number
    reason = sum(each.reason for each in compared) / number
    cpu_s = quantile([each.cpu_s for each in compared], 0.5)
    return [
        Figure("placed forks, same outcome", 100 * kind, "%", scenario, Goal(97, at_least=True)),
        Figure("placed forks, and reason", 100 * reason, "%", scenario, Goal(95, at_least=True)),
        Figure("placed forks, end, p95", 100 * quantile(off_m, 0.95), "cm", scenario, Goal(3.0)),
        Figure("placed forks, CPU, median", cpu_s, "s", scenario, Goal(0.45)),
    ]
