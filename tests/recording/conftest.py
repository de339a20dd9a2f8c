"""A recording that several tests look at."""

from contextlib import closing
from pathlib import Path

import pytest

from adapters.recording import RunFile, RunReader, decode
from sim.scenario.changes import Override
from sim.scenario.lockstep_run import run_in_lock_step
from sim.scenario.model import RunMode
from sim.scenario.reading import load_scenario


@pytest.fixture(scope="session")
def stuck(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the recording of a drive that fails after 1.25 s: the wheels of a side are stuck."""
    folder = tmp_path_factory.mktemp("stuck")
    scenario = load_scenario("side_stuck", RunMode.LOCK_STEP, (Override.parse("duration=8"),))
    with closing(RunFile(folder / "run.mcap")) as tape:
        run_in_lock_step(scenario, folder / "data", tape)
    return folder / "run.mcap"


@pytest.fixture(scope="session")
def flushed(stuck: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the recording of this drive as a process writes it: several chunks a second."""
    path = tmp_path_factory.mktemp("flushed") / "run.mcap"
    with closing(RunFile(path)) as file:
        for number, message in enumerate(RunReader(stuck).messages()):
            file.put(decode(message.topic, message.data))
            if number % 300 == 0:
                file.flush()
    return path
