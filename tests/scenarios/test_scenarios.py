"""The scenarios at hand hold, and one that does not hold says where."""

from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from sim.scenario.commands import scenario
from sim.scenario.reading import scenario_folder

NAMES = sorted(path.stem for path in scenario_folder().glob("*.yaml"))
LIVE_ONLY = {"video"}
WRONG = """
title: Half wrong
lasts: 4
timeline:
  - {at: 0.5, command: {moveForward: {distance: 1}}, label: ahead}
expect:
  - {command: ahead, ends: EXECUTED}
  - {pose: {x: 2, y: 0}, tolerance: 0.1}
"""


def play(*arguments: str) -> Result:
    return CliRunner().invoke(scenario, arguments, catch_exceptions=False)


@pytest.mark.parametrize("name", sorted(set(NAMES) - LIVE_ONLY))
def test_holds(name: str) -> None:
    result = play(name)
    assert result.exit_code == 0, result.output
    assert "FAILS" not in result.output


def test_those_of_the_thesis_are_there() -> None:
    assert {"telemetry", "locomotion", "camera", "files", "video"} <= set(NAMES)


@pytest.mark.parametrize("name", sorted(LIVE_ONLY))
def test_what_only_real_processes_do_is_refused_in_lock_step(name: str) -> None:
    result = play(name)
    assert result.exit_code == 2
    assert "--live only" in result.output


def test_a_wrong_expectation_fails_with_its_own_line(tmp_path: Path) -> None:
    path = tmp_path / "wrong.yaml"
    path.write_text(WRONG)
    result = play(str(path))
    failing = [line for line in result.output.splitlines() if line.startswith("FAILS")]
    assert result.exit_code == 1
    assert len(failing) == 1
    assert "true pose" in failing[0]
    assert "x 2.00 y 0.00" in failing[0]
    assert "x 0.99" in failing[0].split("at the end")[1]
    assert result.output.splitlines()[-1] == "5 of 6 expectations hold"


def test_several_files_are_summed_up() -> None:
    result = play("expired", "replaced")
    assert result.exit_code == 0
    assert result.output.splitlines()[-1] == "18 of 18 expectations hold"


def test_verbose_shows_every_report() -> None:
    output = play("expired", "--verbose").output
    assert "EXPIRED" in output
    assert "too-old" in output


def test_the_list_names_each_scenario() -> None:
    output = play("--list").output
    assert all(name in output for name in NAMES)
