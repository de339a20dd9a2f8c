"""One acceptance scenario passes, as the file is, with every controller and every kind of rover.

`test_scenarios.py` plays it with the controller of the Jackal, turn_drive; the commands of
docs/controllers.md with mpc and with the whole motions of MOCUP; this file with a navigation.
"""

import json
from collections.abc import Sequence
from pathlib import Path

import pytest

from executive.settings import parse_yaml
from executive.values.ports import NavigateTo
from executive.values.reasons import Reason
from sim.scenario.changes import Override
from sim.scenario.lockstep_run import run_in_lock_step
from sim.scenario.model import RunMode, Scenario
from sim.scenario.outcome import ScenarioResult, evaluate, run_once
from sim.scenario.reading import load_scenario
from tests.docs.pages import CHECKOUT, blocks, lines
from tests.support.navigated_jackal import NavigatedJackal
from tests.support.navigation import Navigation

NAME = "targets"
PAGE = CHECKOUT / "docs" / "above-nav2.md"
CONTROLLERS = CHECKOUT / "docs" / "controllers.md"
RELAY = ("settings.controller=navigation", "settings.navigation={gate: relay}")

pytestmark = pytest.mark.at_length


def sections_of_the_page() -> list[str]:
    """Return the sections of an asset with a navigation, as the page shows them."""
    (sections,) = (
        each
        for each in (parse_yaml(block, PAGE.name) for block in blocks(PAGE, "yaml"))
        if isinstance(each, dict) and "controller" in each
    )
    return [f"settings.{key}={json.dumps(value)}" for key, value in sections.items()]


def scenario(changes: Sequence[str]) -> Scenario:
    return load_scenario(NAME, RunMode.LOCK_STEP, [Override.parse(each) for each in changes])


def failed(result: ScenarioResult) -> list[str]:
    return [str(each) for each in result.findings if not each.passed]


def test_the_commands_of_a_page_play_it_with_mpc_and_with_whole_motions() -> None:
    played = " ".join(line.text for line in lines(CONTROLLERS))
    assert f"{NAME} --set settings.mpc.selectable=true --set settings.controller=mpc" in played
    assert f"{NAME} --set asset=mocup" in played


@pytest.mark.parametrize("gate", ["lock", "relay"])
def test_targets_are_reached_with_a_navigation(gate: str, tmp_path: Path) -> None:
    navigated = scenario(RELAY if gate == "relay" else sections_of_the_page())
    rover = NavigatedJackal(navigated, Navigation())
    result = evaluate(navigated, run_in_lock_step(navigated, tmp_path, rover=rover))
    assert failed(result) == []
    assert result.figures.false_executed == 0
    assert len(rover.goals) == 5  # a leg each; the one that was stopped is another
    assert all(isinstance(goal.task, NavigateTo) for goal in rover.goals)


def test_without_a_navigation_the_drive_fails_as_unavailable(tmp_path: Path) -> None:
    result = run_once(NAME, scenario((*RELAY, "duration=8")), tmp_path)
    assert not result.passed
    assert result.figures.reasons == (Reason.NAVIGATION_UNAVAILABLE,)
