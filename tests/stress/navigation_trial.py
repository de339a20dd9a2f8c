"""The trial of navigated motions: drives over every navigation, interruptions, random acts."""

import tempfile
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import Final

from executive.commands import FollowPath, MoveTo, Resume, Stop, Waypoint
from executive.settings import NavigationGate
from tests.stress.findings import Findings, Log
from tests.stress.navigated_drives import (
    EXPECTED,
    EXPECTED_OF_STRANGE,
    PASSING_M,
    DriveFault,
    Watch,
    carry_out,
    drives,
    judge,
    judge_success,
)
from tests.stress.navigated_interruptions import interrupt, interruptions
from tests.stress.strange_navigations import RandomNavigation
from tests.support.figures import Figure
from tests.support.kinematic import STEP_S
from tests.support.navigated import NavigatedBench

SHARE: Final = 5
"""Drives over a behaviour of `Navigation` for each one over a strange one, or with all sensors."""
COMMANDS: Final = 5
"""Commands of one random run."""
STOP_SHARE: Final = 0.2


def random_run(gate: NavigationGate, seed: int, folder: Path) -> Iterator[tuple[DriveFault, str]]:
    """Send commands over a navigation that acts at random; yield what is wrong."""
    random = Random(f"{gate.value} {seed}")
    with NavigatedBench(folder, gate, RandomNavigation(seed=seed)) as bench:
        bench.rover.random = Random(seed)
        bench.rover.loss_ratio = random.choice((0.0, 0.0, 0.2))
        bench.rover.smoother = random.random() < 0.5
        bench.rover.preempted_late = random.random() < 0.5
        bench.run(1.0)
        for number in range(1, COMMANDS + 1):
            waypoints = tuple(
                Waypoint(random.uniform(-3, 3), random.uniform(-3, 3), None, tolerance_m)
                for tolerance_m in random.choice(((None,), (PASSING_M, None), (None, None)))
            )
            one = len(waypoints) == 1
            bench.submit(MoveTo(waypoints[0]) if one else FollowPath(waypoints), number)
            watch = Watch(bench, number, waypoints)
            if random.random() < STOP_SHARE:
                for _ in range(random.randrange(round(10.0 / STEP_S))):
                    watch.step()
                bench.submit(Stop(), 100 + number)
            result = watch.result()
            yield from judge_success(result, f"random, gate {gate.value}, seed {seed}: {result}")
            bench.submit(Resume(), 200 + number)
            bench.run(1.0)


def measure(count: int, seed: int, log: Log) -> list[Figure]:
    """Return how often a navigated drive ended wrongly.

    Args:
        count: drives for each behaviour, command and gate; and of each interruption and gate.
        seed: selects their targets.
        log: called with a line on each of the first failures.
    """
    findings, tried = Findings(log), 0
    few = -(-count // SHARE)
    strange = drives(few, seed, EXPECTED_OF_STRANGE)
    sensed = drives(few, seed, EXPECTED, sensed=True) if count >= SHARE else ()
    for drive in (*drives(count, seed, EXPECTED), *strange, *sensed):
        tried += 1
        with tempfile.TemporaryDirectory() as folder:
            for fault, about in judge(drive, carry_out(drive, Path(folder))):
                findings.add(fault, about)
    beside = f"{tried} drives"
    tried = 0
    for what in interruptions(count, seed):
        tried += 1
        with tempfile.TemporaryDirectory() as folder:
            for fault, about in interrupt(what, Path(folder)):
                findings.add(fault, about)
    for gate in NavigationGate:
        for number in range(count):
            with tempfile.TemporaryDirectory() as folder:
                for fault, about in random_run(gate, seed * 1_000_000 + number, Path(folder)):
                    findings.add(fault, about)
    beside += (
        f", {tried} interruptions, {2 * count * COMMANDS} commands over random acts, lock step"
    )
    return findings.figures("navigation", DriveFault, beside)
