"""How much faster than real time the lock step runs, and whether it repeats."""

import tempfile
import time
from pathlib import Path
from typing import Final

from sim.scenario.lockstep_run import run_in_lock_step
from sim.scenario.reading import load_scenario
from tests.support.figures import Figure, Goal, quantile

SCENARIO: Final = "drive3m_turn_picture"
RUNS: Final = 5


def _play() -> tuple[float, str]:
    """Play the scenario: simulated seconds per second, and all that was said and driven."""
    scenario = load_scenario(SCENARIO)
    with tempfile.TemporaryDirectory() as folder:
        began_s = time.perf_counter()
        record = run_in_lock_step(scenario, Path(folder))
        real_s = time.perf_counter() - began_s
    return record.simulated_s / real_s, repr((record.reports, record.poses, record.values))


def measure() -> list[Figure]:
    """Return the figures of five runs, after one that is not counted."""
    _play()
    runs = [_play() for _ in range(RUNS)]
    factor = quantile([speed for speed, _ in runs], 0.5)
    alike = RUNS if len({message for _, message in runs}) == 1 else 0
    scenario = f"{SCENARIO}, the making of the rover included"
    every = Goal(RUNS, at_least=True)
    return [
        Figure("lock step, median speed", factor, "× real", scenario, Goal(50.0, at_least=True)),
        Figure("lock step, alike runs", alike, "runs", f"{RUNS} runs, bit for bit", every),
    ]
