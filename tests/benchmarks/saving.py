"""How well `rover whatif --save` finds the minimal change: against all, by the scenario itself.

Runs of `config/scenarios/motion_*` fail by a limit that is too tight, or by a fault. For each the
search over forks of its recording is compared with one over the scenario itself, which tries every
candidate.
"""

import os
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import combinations
from math import ceil
from pathlib import Path
from random import Random
from statistics import median
from typing import Final

from adapters.recording import RunFile
from executive.commands import Request
from executive.settings import Settings, settings_reader
from executive.values.reports import Identity, Report, Stage
from sim.fork.candidates import (
    FACTORS,
    Adjustable,
    Candidate,
    arguments_of,
    candidate,
    candidates,
    controllers_for,
    limits_of,
    speeds_of,
)
from sim.fork.model import Change, Fidelity
from sim.fork.save import CONFIRMED, MAX_TOGETHER, Play, Verdict, judge, save
from sim.scenario.changes import Override
from sim.scenario.lockstep_run import run_in_lock_step
from sim.scenario.model import Inject, RunMode, Scenario, Send
from sim.scenario.reading import load_scenario
from sim.scenario.record import Record
from tests.support.figures import Figure, Goal

MOTIONS: Final = ("motion_forward", "motion_goal", "motion_turn", "motion_held", "motion_path")
FAULTS: Final[tuple[tuple[str, float, float], ...]] = (
    ("{odometry_drift: {rate: %.3f}, at: 2}", 0.03, 0.3),
    ("{gyro_gain: {factor: %.3f}, at: 1.5}", 0.7, 0.9),
    ("{gyro_gain: {factor: %.3f}, at: 1.5}", 1.1, 1.4),
    ("{gyro_bias: {rate: %.3f}, at: 1.5}", 0.02, 0.2),
    ("{encoder_scale: {factor: %.3f}, at: 1.5}", 1.05, 1.3),
    ("{low_friction: {factor: %.3f}, at: 1.5}", 0.1, 0.4),
    ("{brownout: {factor: %.3f}, at: 1.5}", 0.1, 0.5),
    ("{odometry_late: {by: %.3f}, at: 1.5}", 0.12, 0.3),
    ("{left_wheels_stuck, at: %.3f}", 1.5, 2.5),
    ("{odometry_lost, at: %.3f}", 1.5, 2.5),
    ("{pushed: {by: %.3f}, at: 2}", 0.1, 0.3),
    ("{motor_dead: {side: left}, at: %.3f}", 1.5, 2.5),
)
"""Faults, with the interval of a figure."""
MISFITS: Final = (
    ("settings.drive.distance=1.9",),
    ("settings.drive.travel_speed=0.4",),
    ("settings.drive.travel_acceleration=4", "settings.drive.travel_speed=2"),
)
"""Limits and speeds that do not fit a motion, or the rover."""
TIGHT: Final = ("motion_blocked", "wheel_slip", "wheel_travel_off_command", "turn_off_command")
"""Rows with tight bounds that end a motion without a fault."""
ALIKE: Final = 4
"""Maximum number of runs that fail by the same cause."""
DURATION_S: Final = 12.0
"""Duration of a run."""


@dataclass(frozen=True, slots=True)
class FailedRun:
    """A scenario with a failed command.

    Attributes:
        changes: of the file, which make it fail.
    """

    name: str
    changes: tuple[str, ...]
    scenario: Scenario
    record: Record
    command: Identity
    request: Request
    end: Report

    @property
    def settings(self) -> Settings:
        """Settings of the run."""
        return self.scenario.settings


def changed(scenario: Scenario, change: Change) -> Scenario:
    """Return a scenario with a change."""
    settings = scenario.settings
    for each in change.settings:
        raw: object = float(each.value)
        for key in reversed(each.key.split(".")):
            raw = {key: raw}
        settings = settings_reader().overlay(settings, raw, "settings")
    if change.controller is not None:
        settings = replace(settings, controller=change.controller)
    timeline = scenario.timeline
    for replaced in change.replaced:
        timeline = tuple(
            replace(each, command=replaced.request)
            if isinstance(each, Send) and _number(scenario, each) == replaced.identity.command_id
            else each
            for each in timeline
        )
    timeline += tuple(Inject(at_s=each.begin_s, inject=each.fault) for each in change.faults)
    seed = scenario.seed if change.seed is None else change.seed
    return replace(scenario, settings=settings, timeline=timeline, seed=seed)


def _number(scenario: Scenario, entry: Send) -> int:
    sent = [each for each in scenario.timeline if isinstance(each, Send)]
    return sent.index(entry) + 1


def played(scenario: Scenario, tape: Path | None = None) -> Record:
    """Run a scenario, with a recording if a file is given."""
    with tempfile.TemporaryDirectory(prefix="rover-saving-") as folder:
        if tape is None:
            return run_in_lock_step(scenario, Path(folder))
        with closing(RunFile(tape)) as recording:
            return run_in_lock_step(scenario, Path(folder), recording)


def scenario_play(run: FailedRun) -> Play:
    """Return a function that repeats the scenario itself."""

    def play(changes: Sequence[Change]) -> list[Verdict]:
        runs = (played(changed(run.scenario, each)) for each in changes)
        return [judge(run.command, run.record, each) for each in runs]

    return play


def failed_run(name: str, changes: Sequence[str]) -> FailedRun | None:
    """Return a run with changes of the scenario's file, if its command failed."""
    overrides = tuple(map(Override.parse, changes))
    scenario = load_scenario(
        name, RunMode.LOCK_STEP, (Override("duration", f"{DURATION_S}"), *overrides)
    )
    record = played(scenario)
    for identity, history in record.all_lifecycles().items():
        end = history.end
        if end is not None and end.stage in (Stage.FAILED, Stage.REJECTED):
            requests = {each.identity: each.request for each in record.requested}
            return FailedRun(
                name, tuple(changes), scenario, record, identity, requests[identity], end
            )
    return None


def failed_runs(number: int, seed: int) -> Iterator[FailedRun]:
    """Yield failed runs: three of five by limits or speeds that do not fit, others by faults."""
    random = Random(seed)
    used: Counter[str] = Counter()
    while used.total() < number:
        name = random.choice(MOTIONS)
        friction = random.uniform(0.45, 0.75)
        changes = [f"seed={random.randrange(10**6)}", f"world.friction={friction:.3f}"]
        kind = used.total() % 5
        if kind < 2:
            what, planted = tightened(random)
        elif kind == 2:
            planted = list(random.choice(MISFITS))
            what = planted[0]
        else:
            what, low, high = random.choice(FAULTS)
            planted = [f"inject={what % random.uniform(low, high)}"]
        run = failed_run(name, [*changes, *planted]) if used[what] < ALIKE else None
        if run is not None:
            used[what] += 1
            yield run


def tightened(random: Random) -> tuple[str, list[str]]:
    """Return the row of a fault, and keys that make its bound much tighter than usual."""
    settings = load_scenario(MOTIONS[0]).settings
    name = random.choice(TIGHT)
    declared, row = next(each for each in settings.faults if each[0].name == name)
    window = random.choice(row.windows)
    assert declared.above is not None
    assert window.above is not None
    value = max(declared.above.low, window.above * random.choice((0.2, 0.3, 0.5, 0.7)))
    path = ".".join(filter(None, ("settings.faults", declared.name, window.name)))
    changes = [f"{path}.above={value:.5g}"]
    if window.ratio:
        changes.append(f"{path}.ratio={window.ratio * 0.3:.5g}")
    return declared.name, changes


def brute_force(run: FailedRun, play: Play, seeds: Sequence[int]) -> tuple[Candidate | None, int]:
    """Return the minimal candidate that saves a run, with the number of seeds: all are tried."""
    limits: dict[str, Adjustable] = {}
    ends, fresh = [run.end], True
    while fresh:
        found = {each.key: each for end in ends for each in limits_of(end, run.settings)}
        fresh = not found.keys() <= limits.keys()
        limits |= found
        extreme = [candidate([*limits.values()], FACTORS[-1])] if limits else []
        ends = [each.end for each in play([each.change for each in extreme]) if each.end]
    figures: list[Sequence[Adjustable]] = [
        group
        for together in range(1, MAX_TOGETHER + 1)
        for group in combinations(limits.values(), together)
        if together == 1 or not play([candidate(group, FACTORS[-1]).change])[0].text
    ]
    figures += [[each] for each in speeds_of(run.settings)]
    figures += [[each] for each in arguments_of(run.command, run.request)]
    every = [*candidates(figures), *controllers_for(run.request, run.settings)]
    unchanged = _saved(play, Change(), seeds)
    least = max(unchanged, ceil(CONFIRMED * len(seeds)))
    for each in sorted(every, key=lambda found: found.order):
        if not play([each.change])[0].text:
            saved = _saved(play, each.change, seeds)
            if saved >= least:
                return each, saved
    return None, 0


def _saved(play: Play, change: Change, seeds: Sequence[int]) -> int:
    return sum(not each.text for each in play([replace(change, seed=seed) for seed in seeds]))


def measure(number: int, seeds: int, seed: int, log: Callable[[str], None]) -> list[Figure]:
    """Compare both searches over failed runs; log each run."""
    same = savable = exact = 0
    cpu_s = []
    for run in failed_runs(number, seed):
        with tempfile.TemporaryDirectory(prefix="rover-saving-") as folder:
            recording = Path(folder, "run.mcap")
            played(run.scenario, recording)
            began_s = _cpu_s()
            answer = save(recording, range(1, seeds + 1))
            cpu_s.append(_cpu_s() - began_s)
        best, saved = brute_force(run, scenario_play(run), range(1, seeds + 1))
        found = ("", 0) if answer.saving is None else (answer.saving.minimal, answer.saving.saved)
        expected = ("" if best is None else best.text, saved)
        savable += best is not None
        exact += answer.fidelity is Fidelity.BIT_EQUAL
        same += found == expected
        agrees = "as" if found == expected else "not as"
        log(f"{run.name} {' '.join(run.changes)}: {found}, {agrees} by the scenario {expected}")
    count = f"{number} failed runs, {seeds} seeds"
    return [
        Figure("same change and share", 100 * same / number, "%", count, Goal(95, at_least=True)),
        Figure("runs that a change saves", 100 * savable / number, "%", count),
        Figure("bit-equal without a change", 100 * exact / number, "%", count, Goal(100, True)),
        Figure("CPU time of a search, median", median(cpu_s), "s", count),
    ]


def _cpu_s() -> float:
    """Return the CPU time of this process and of its children that have ended."""
    return sum(os.times()[:4])
