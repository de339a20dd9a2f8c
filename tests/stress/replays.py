"""Recorded runs of all kinds, replayed in another process: does the core decide the same?

Three of five runs are of campaigns with a fault each, the others of the remaining campaigns and of
all scenarios. A third of the runs gets random commands besides, with a plan among them, and a third
loses its executive once as by kill -9, and starts another on its ledger.
"""

import multiprocessing
import tempfile
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing
from dataclasses import dataclass, replace
from enum import Enum, unique
from functools import cache
from itertools import islice
from pathlib import Path
from random import Random
from typing import Final

from adapters.recording import RecordingError, RunFile
from adapters.recording.replay import replay
from executive.settings import SettingsError, names_in
from sim.campaign.draws import draw
from sim.campaign.model import Campaign
from sim.campaign.reading import campaign_folder, load_campaign
from sim.scenario.changes import Override
from sim.scenario.lockstep_run import run_in_lock_step
from sim.scenario.model import Crash, Entry, RunMode, Scenario, Send
from sim.scenario.reading import load_scenario, scenario_folder
from tests.stress.command_generator import PER_PLAN, random_request
from tests.stress.findings import Findings, Log
from tests.support.figures import Figure

WITH_FAULTS: Final = 0.6
"""Of the runs: those of campaigns in which a fault is injected."""
CRASHES: Final = 1 / 3
VISITORS: Final = 1 / 3
"""Of the runs: those in which another source sends random commands, too."""
MAX_COMMANDS: Final = 12
MAX_DURATION_S: Final = 25.0
"""Of a run: most motions of the campaigns have ended by then."""
MAX_DOWN_S: Final = 2.0
ODD: Final = 0.05
DRAWN_FROM: Final = 1_000_000
REPORTED_EVERY: Final = 50


@unique
class ReplayFault(Enum):
    """What no replay may show."""

    DIFFERENT = "recordings that decide otherwise"
    UNREADABLE = "recordings that cannot be replayed"
    INCOMPLETE = "recordings that lack their end"


@dataclass(frozen=True, slots=True)
class Kind:
    """What a run is of.

    Attributes:
        fault: whether a fault is injected.
        visitor: whether a second source sends random commands.
    """

    name: str
    asset: str
    fault: bool
    visitor: bool


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a replay came to; the fault is None where there is none."""

    fault: ReplayFault | None
    text: str
    starts: int = 0
    ticks: int = 0
    decisions: int = 0


def measure(count: int, seed: int, log: Log, output: Path | None = None) -> list[Figure]:
    """Return how many of so many recorded runs decide otherwise when they are replayed.

    Args:
        count: how many runs.
        seed: of which runs.
        log: called with a line on each run that does not decide the same.
        output: an empty folder for the recordings; None deletes each once it is replayed.
    """
    findings = Findings(log)
    kinds: list[Kind] = []
    outcomes: list[Outcome] = []
    # A process that was not forked shares neither the seed of hashes nor anything in memory.
    other = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"))
    with other, tempfile.TemporaryDirectory(prefix="rover-replays-") as scratch:
        for number, (scenario, kind) in enumerate(islice(_runs(seed), count), 1):
            path = Path(output or scratch, f"{number:04d}.mcap")
            _record(scenario, path, Path(scratch, str(number)))
            outcome = other.submit(_replayed, path).result()
            if outcome.fault is not None:
                findings.add(outcome.fault, f"run {number}, {kind}: {outcome.text}")
            if output is None:
                path.unlink()
            kinds.append(kind)
            outcomes.append(outcome)
            if number % REPORTED_EVERY == 0:
                log(f"{number} of {count}")
    beside = f"{count} runs, seed {seed}, lock step"
    numbers = [
        *sorted(Counter(each.asset for each in kinds).items()),
        ("with an injected fault", sum(each.fault for each in kinds)),
        ("with random commands", sum(each.visitor for each in kinds)),
        ("with a crash", sum(each.starts > 1 for each in outcomes)),
    ]
    return [
        *(Figure(f"replays: {name}", number, "runs", beside) for name, number in numbers),
        Figure("replays: ticks", sum(each.ticks for each in outcomes), "ticks", beside),
        Figure("replays: decisions", sum(each.decisions for each in outcomes), "", beside),
        *findings.figures("replays", ReplayFault, beside),
    ]


def _runs(seed: int) -> Iterator[tuple[Scenario, Kind]]:
    """Yield runs without end, each by the seed alone."""
    campaigns = _campaigns()
    faulty = [each for each in campaigns if _injects(each)]
    others = [each for each in campaigns if not _injects(each)]
    names = list(_playable())
    random = Random(seed)
    while True:
        if random.random() < WITH_FAULTS:
            name, changes = _drawn(random.choice(faulty), random)
        elif random.random() < len(others) / (len(others) + len(names)):
            name, changes = _drawn(random.choice(others), random)
        else:
            seeded = Override("seed", str(random.randrange(DRAWN_FROM)))
            name, changes = random.choice(names), (seeded,)
        scenario = _quick(load_scenario(name, RunMode.LOCK_STEP, changes))
        fault = any(each.key == "inject" and each.value != "none" for each in changes)
        visitor = random.random() < VISITORS
        if visitor:
            scenario = _with(scenario, *_visits(random, scenario.duration_s))
        if random.random() < CRASHES:
            scenario = _with(scenario, _crash(random, scenario.duration_s))
        yield scenario, Kind(name, scenario.settings.asset, fault, visitor)


@cache
def _campaigns() -> tuple[Campaign, ...]:
    return tuple(load_campaign(name) for name in names_in(campaign_folder()))


def _injects(campaign: Campaign) -> bool:
    return any(each.key == "inject" for each in campaign.vary)


def _playable() -> Iterator[str]:
    """Yield the scenarios that can be played in lock step."""
    for name in names_in(scenario_folder()):
        try:
            load_scenario(name, RunMode.LOCK_STEP)
        except SettingsError:
            continue
        yield name


def _drawn(campaign: Campaign, random: Random) -> tuple[str, tuple[Override, ...]]:
    found = draw(campaign, random.randrange(DRAWN_FROM))
    return found.scenario, found.changes


def _quick(scenario: Scenario) -> Scenario:
    """Return a scenario that is short, with small pictures: nothing but their end decides."""
    camera = replace(scenario.settings.camera, width_px=16, height_px=12)
    settings = replace(scenario.settings, camera=camera)
    return replace(scenario, settings=settings, duration_s=min(scenario.duration_s, MAX_DURATION_S))


def _with(scenario: Scenario, *entries: Entry) -> Scenario:
    return replace(scenario, timeline=(*scenario.timeline, *entries))


def _crash(random: Random, lasts_s: float) -> Crash:
    down_s = random.uniform(0.0, MAX_DOWN_S)
    return Crash(at_s=random.uniform(0.0, lasts_s - down_s - 1.0), crash_s=down_s)


def _visits(random: Random, lasts_s: float) -> Iterator[Send]:
    """Yield random commands, of which the first submits a plan."""
    first = 1 + PER_PLAN * random.randrange(100)
    times_s = sorted(random.uniform(0.5, lasts_s) for _ in range(MAX_COMMANDS))
    for number, at_s in enumerate(times_s, first):
        request = random_request(random, number, ODD)
        yield Send(at_s=at_s, command=request, label=f"visit-{number}", source="VISITOR")


def _record(scenario: Scenario, path: Path, folder: Path) -> None:
    folder.mkdir()
    with closing(RunFile(path)) as tape:
        run_in_lock_step(scenario, folder, tape)


def _replayed(path: Path) -> Outcome:
    try:
        replayed = replay(path)
    except RecordingError as error:
        return Outcome(ReplayFault.UNREADABLE, str(error))
    found, fault, text = replayed.difference, None, ""
    if found is not None:
        fault = ReplayFault.DIFFERENT
        text = f"after {found.time_s:.2f} s, {' | '.join(found.lines)}"
    elif not replayed.whole:
        fault = ReplayFault.INCOMPLETE
    return Outcome(fault, text, replayed.starts, replayed.ticks, replayed.decisions)
