"""The scenarios at hand hold, and one that does not hold says where."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from sim.scenario.commands import scenario
from sim.scenario.lockstep_run import run_in_lock_step
from sim.scenario.reading import load_scenario, scenario_folder
from sim.scenario.record import Record
from tests.docs.pages import CHECKOUT, PAGES, as_shipped, blocks
from tests.support.patience import shipped_names

NAMES = shipped_names(scenario_folder())
PAGE = CHECKOUT / "docs" / "scenarios.md"
LIVE_ONLY = {"relay", "video"}
TYPED = [played for page in PAGES for played in as_shipped(page).values()]
"""Scenarios that the documentation plays, and whether it writes their files."""
WRONG = """
title: Half wrong
duration: 4
timeline:
  - {at: 0.5, command: {moveForward: {distance: 1}}, label: ahead}
expect:
  - {command: ahead, ends: EXECUTED}
  - {pose: {x: 2, y: 0}, tolerance: 0.1}
"""


DARK = """
title: Dark
settings: {status_interval: 0.5}
duration: 6
timeline:
  - {at: 0.5, command: {moveForward: {distance: 0.5}}, label: ahead}
  - {at: 1, outage: 3}
  - {at: 2, command: stop, label: unheard}
  - {at: 2, query: nobody}
  - {at: 2, fetch: no.jpg}
  - {after: ahead EXECUTED, command: {rotateBy: {angle: 90deg}}, label: turn}
expect:
  - {command: ahead, stages: [RECEIVED, ACCEPTED, STARTED, EXECUTED], within: 2}
  - {command: unheard, stages: [], answers: [lost]}
  - {files: [], query: nobody}
  - {rover: stationary, at: 2.5, for: 1.5}
  - {command: turn, ends: EXECUTED}
  - {telemetry: 0, at: 1.1, for: 2.8}
"""

CONDITIONS = """
title: Stopped on the way, and back
duration: 14
timeline:
  - {at: 0.5, command: {moveForward: {distance: 3}}, label: ahead}
  - {near: {x: 2, y: 0, within: 0.5}, command: stop}
  - {after: ahead ENDED + 1, command: resume}
  - {after: resume ENDED, command: {moveForward: {distance: 500}}, label: far}
  - {after: far ENDED, command: {moveForward: {distance: -1}}, label: back}
  - {after: back STARTED, near: {x: 1.5, y: 0, within: 0.1}, query: passing}
expect:
  - {pose: {x: 1.55, y: 0}, tolerance: 0.06, near: {x: 2, y: 0, within: 0.5}}
  - {command: ahead, ends: CANCELLED, reason: STOPPED}
  - {command: far, ends: REJECTED}
  - {command: back, ends: EXECUTED}
  - {parameter: POS_X, value: 1.5, tolerance: 0.15, query: passing}
"""


def play(*arguments: str) -> Result:
    return CliRunner().invoke(scenario, arguments, catch_exceptions=False)


@pytest.mark.parametrize("name", sorted({*NAMES} - LIVE_ONLY | {name for name, _ in TYPED}))
def test_holds(name: str, tmp_path: Path) -> None:
    result = play(name, *(("--out", str(tmp_path)) if (name, True) in TYPED else ()))
    assert result.exit_code == 0, result.output
    assert not re.search(r"^FAILED", result.output, re.MULTILINE)


def test_those_of_the_thesis_are_there() -> None:
    first = {"telemetry", "locomotion", "camera", "files", "video"}
    assert first | {"mocup_locomotion", "mocup_camera", "relay", "marvin"} <= set(NAMES)


@pytest.mark.parametrize("name", sorted(LIVE_ONLY))
def test_what_only_real_processes_do_is_refused_in_lock_step(name: str) -> None:
    result = play(name)
    assert result.exit_code == 2
    assert "only" in result.output
    assert "--live" in result.output


def test_a_wrong_expectation_fails_with_its_own_line(tmp_path: Path) -> None:
    path = tmp_path / "wrong.yaml"
    path.write_text(WRONG)
    result = play(str(path))
    failing = [line for line in result.output.splitlines() if line.startswith("FAILED")]
    assert result.exit_code == 1
    assert len(failing) == 1
    assert "true pose" in failing[0]
    assert "x 2.00 y 0.00" in failing[0]
    assert "x 0.99" in failing[0].split("at the end")[1]
    assert result.output.splitlines()[-1] == "6 of 7 expectations are met"


def test_marvin_returns_heavier_than_at_its_start(tmp_path: Path) -> None:
    text = (scenario_folder() / "marvin.yaml").read_text()
    path = tmp_path / "light.yaml"
    path.write_text(text.replace("cargo: 20", "cargo: 0"))
    failing = [line for line in play(str(path)).output.splitlines() if line.startswith("FAILED")]
    assert len(failing) == 1
    assert "BATERY_VOLTAGE" in failing[0]


def test_in_an_outage_nothing_is_received_or_sent_until_it_ends(tmp_path: Path) -> None:
    path = tmp_path / "dark.yaml"
    path.write_text(DARK)
    result = play(str(path))
    assert result.exit_code == 0, result.output


def test_a_step_waiting_for_an_end_or_a_position_is_executed_then(tmp_path: Path) -> None:
    path = tmp_path / "conditions.yaml"
    path.write_text(CONDITIONS)
    result = play(str(path))
    assert result.exit_code == 0, result.output


def test_a_step_waiting_for_an_unreached_position_is_never_executed(tmp_path: Path) -> None:
    path = tmp_path / "conditions.yaml"
    path.write_text(CONDITIONS.replace("y: 0, within: 0.1", "y: 1, within: 0.1"))
    result = play(str(path))
    failing = [line for line in result.output.splitlines() if line.startswith("FAILED")]
    assert result.exit_code == 1
    assert any("all 6 entries of the timeline are executed" in line for line in failing)


@pytest.mark.parametrize("example", blocks(PAGE, "yaml"))
def test_an_example_of_the_page_holds(example: str, tmp_path: Path) -> None:
    path = tmp_path / "example.yaml"
    path.write_text(example)
    result = play(str(path))
    assert result.exit_code == 0, result.output


def test_several_files_are_summed_up_and_verbose_shows_every_report() -> None:
    result = play("expired", "replaced", "--verbose")
    assert result.exit_code == 0
    assert result.output.splitlines()[-1] == "20 of 20 expectations are met"
    assert "EXPIRED" in result.output
    assert "too-old" in result.output


def test_the_list_names_each_scenario() -> None:
    output = play("--list").output
    assert all(name in output for name in NAMES)


def drive(folder: Path) -> Record:
    return run_in_lock_step(load_scenario("drive3m_turn_picture"), folder)


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Record:
    return drive(tmp_path_factory.mktemp("driven"))


def test_two_runs_are_alike_bit_for_bit(driven: Record, tmp_path: Path) -> None:
    second = drive(tmp_path)
    assert driven.reports == second.reports
    assert driven.poses == second.poses
    assert driven.values == second.values
    (picture,), (again,) = driven.files.glob("pictures/*.jpg"), second.files.glob("pictures/*.jpg")
    assert picture.read_bytes() == again.read_bytes()
    assert len(driven.poses) == 130
    assert driven.poses[0].pose != driven.poses[-1].pose


def test_another_seed_is_another_run(driven: Record, tmp_path: Path) -> None:
    scenario = replace(load_scenario("drive3m_turn_picture"), seed=1)
    assert run_in_lock_step(scenario, tmp_path).poses != driven.poses
