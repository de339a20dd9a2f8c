"""Recordings that several tests fork."""

from contextlib import closing
from pathlib import Path

import pytest

from adapters.recording import RunFile
from sim.fork.forkable import Forkable, whatif
from sim.fork.model import Change, WhatIf
from sim.scenario.changes import Override
from sim.scenario.lockstep_run import run_in_lock_step
from sim.scenario.model import RunMode
from sim.scenario.reading import load_scenario
from sim.scenario.record import Record

SHORT = ("duration=3", "command.ahead.distance=1.2")


def play(folder: Path, name: str, *changes: str) -> Record:
    """Run a scenario with overrides, record it in the folder, and return its record."""
    scenario = load_scenario(name, RunMode.LOCK_STEP, tuple(map(Override.parse, changes)))
    folder.mkdir(exist_ok=True)
    with closing(RunFile(folder / "run.mcap")) as tape:
        return run_in_lock_step(scenario, folder / "data", tape)


@pytest.fixture(scope="session")
def stuck(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the recording of a drive that fails after 2.25 s: the wheels of a side are stuck."""
    folder = tmp_path_factory.mktemp("stuck")
    play(folder, "side_stuck", *SHORT)
    return folder / "run.mcap"


@pytest.fixture(scope="session")
def run(stuck: Path) -> Forkable:
    """Give that recording, ready for forks."""
    return Forkable(stuck)


@pytest.fixture(scope="session")
def answer(stuck: Path) -> WhatIf:
    """Give the answer for that run without its fault; the fork is recorded beside the run."""
    change = Change(without=("left_wheels_stuck",))
    return whatif(stuck, change, out=stuck.with_name("fork.mcap"))
