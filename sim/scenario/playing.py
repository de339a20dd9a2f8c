"""Plays a scenario one way or the other, in a folder of its own, and judges what was seen."""

import tempfile
from pathlib import Path

from sim.scenario.finding import Finding
from sim.scenario.how import How
from sim.scenario.model import Scenario
from sim.scenario.reading import ScenarioError
from sim.scenario.record import Record
from sim.scenario.running import run_in_lock_step
from sim.scenario.verdict import judge
from sim.world import WorldError


class PlayError(Exception):
    """A live run broke down; the text says why."""


def play(name: str, scenario: Scenario, how: How) -> tuple[Record, list[Finding]]:
    """Play a scenario and return what was seen, and what came of each expectation.

    Args:
        name: of its file, for errors.
        scenario: what to play.
        how: to play it.

    Raises:
        ConnectionError, TimeoutError: the rover of a live run cannot be reached.
        PlayError: a live run broke down otherwise.
        ScenarioError: the world cannot be simulated.
    """
    with tempfile.TemporaryDirectory(prefix="rover-scenario-") as folder:
        if how is How.LOCK_STEP:
            record = _lock_step(name, scenario, Path(folder))
        else:
            record = _live(name, scenario, Path(folder), how)
        return record, judge(scenario, record)


def _lock_step(name: str, scenario: Scenario, folder: Path) -> Record:
    try:
        return run_in_lock_step(scenario, folder)
    except WorldError as error:
        raise ScenarioError(f"{name}: {error}") from error


def _live(name: str, scenario: Scenario, folder: Path, how: How) -> Record:
    from sim.processes.children import ChildError
    from sim.processes.place import PlaceError
    from sim.scenario.live import run_live

    try:
        return run_live(scenario, folder, how)
    except (ChildError, PlaceError) as error:
        raise PlayError(f"{name}: {error}") from error
