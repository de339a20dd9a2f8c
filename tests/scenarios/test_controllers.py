"""One acceptance scenario passes, as the file is, with every controller and every kind of rover.

`test_scenarios.py` plays it with the controller of the Jackal, turn_drive.
"""

from pathlib import Path

import pytest

from sim.scenario.changes import Override
from sim.scenario.model import RunMode
from sim.scenario.outcome import run_once
from sim.scenario.reading import load_scenario

NAME = "targets"
ASSETS = {
    "mpc": ("settings.mpc.selectable=true", "settings.controller=mpc"),
    "whole motions": ("asset=mocup",),
}

pytestmark = pytest.mark.at_length


@pytest.mark.parametrize("controller", ASSETS)
def test_targets_are_reached_with_each_controller(controller: str, tmp_path: Path) -> None:
    changes = [Override.parse(text) for text in ASSETS[controller]]
    result = run_once(NAME, load_scenario(NAME, RunMode.LOCK_STEP, changes), tmp_path)
    assert [str(each) for each in result.findings if not each.passed] == []
    assert result.figures.false_executed == 0
