"""Changed and repeated runs, and what programs read of them."""

import io
import json
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from click.shell_completion import ShellComplete
from click.testing import CliRunner, Result
from junitparser import Error, Failure, JUnitXml

from sim.scenario import session
from sim.scenario.commands import scenario
from sim.scenario.junit import CaseStatus, JunitCase, JunitSuite, write_junit
from sim.scenario.outcome import ScenarioResult
from sim.scenario.run import RunError, run_scenario

FILE = """
title: Ahead
duration: 4
timeline:
  - {at: 0.5, command: {moveForward: {distance: 1}}, label: ahead}
expect:
  - {command: ahead, ends: EXECUTED, within: 3}
"""


@pytest.fixture
def file(tmp_path: Path) -> str:
    path = tmp_path / "ahead.yaml"
    path.write_text(FILE)
    return str(path)


def run(*arguments: str) -> Result:
    return CliRunner().invoke(scenario, arguments, catch_exceptions=False)


def documented(*arguments: str) -> Any:
    return json.loads(run(*arguments, "--json").stdout)


def test_json_is_one_document_of_every_run_and_error(file: str) -> None:
    result = run(file, "nowhere", "--json", "--seed", "3", "--set", "world.friction=0.5")
    document = json.loads(result.stdout)
    assert result.exit_code == 2
    assert "there is no scenario 'nowhere'" in result.stderr
    assert document["passed"] is False
    (error,) = document["errors"]
    assert (error["scenario"], error["text"][:8]) == ("nowhere", "there is")
    (played,) = document["runs"]
    assert (played["scenario"], played["seed"], played["passed"]) == (file, 3, True)
    assert played["changes"] == ["world.friction=0.5"]
    assert len(played["findings"]) == 6
    assert played["findings"][0]["observed"].startswith("ends EXECUTED")
    assert played["figures"]["executed"] == 1
    assert played["figures"]["reasons"] == []


def test_the_command_of_a_run_plays_it_again_bit_for_bit(file: str) -> None:
    first = documented(file, "--seed", "5", "--set", "inject={left_wheels_stuck, at: 1}")["runs"][0]
    assert first["passed"] is False
    rover, command, *arguments = first["command"].replace("'", "").split(" --set ")[0].split()
    assert (rover, command, arguments) == ("rover", "scenario", [file])
    again = documented(file, "--set", first["changes"][0], "--seed", str(first["seed"]))["runs"][0]
    assert again["digest"] == first["digest"]
    assert again["digest"] != documented(file, "--seed", "5")["runs"][0]["digest"]


def test_repeats_have_the_next_seeds_and_are_counted(file: str) -> None:
    result = run(file, "--repeat", "3", "--seed", "4")
    assert result.exit_code == 0
    assert result.output.splitlines() == [f"{file}: 3 of 3 runs passed, seeds 4 to 6"]
    assert [run["seed"] for run in documented(file, "--repeat", "2")["runs"]] == [0, 1]


def test_artifacts_of_repeats_are_stored_by_seed(file: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = run(file, "--repeat", "2", "--seed", "4", "--out", str(out))
    assert result.output.splitlines()[-1] == f"maps, timelines, reports and ledgers are in {out}"
    assert {path.parent.parent.name for path in out.rglob("map.png")} == {"seed-4", "seed-5"}


def test_a_repeat_that_fails_is_reported_with_its_command(file: str) -> None:
    result = run(file, "--repeat", "2", "--set", "inject={left_wheels_stuck, at: 1}")
    assert result.exit_code == 1
    count, command, found, *_ = result.output.splitlines()
    assert count == f"{file}: 0 of 2 runs passed, seeds 0 to 1"
    assert (
        command == f"  rover scenario {file} --set 'inject={{left_wheels_stuck, at: 1}}' --seed 0"
    )
    assert "command ahead: ends EXECUTED, within 3 s; observed: " in found


def test_junit_is_read_back_by_a_parser(file: str, tmp_path: Path) -> None:
    path = tmp_path / "results.xml"
    result = run(
        file, "nowhere", "--junit", str(path), "--set", "inject={left_wheels_stuck, at: 1}"
    )
    assert result.exit_code == 2
    assert re.search(r"^FAILED", result.stdout, re.MULTILINE)
    played, missing = JUnitXml.fromfile(str(path))
    assert played.name == f"{file} seed 0"
    seed, _ = ElementTree.parse(path).iter("property")
    assert seed.attrib == {"name": "seed", "value": "0"}
    assert (played.tests, played.failures, played.errors) == (6, 1, 0)
    failures = [each for case in played for each in case.result]
    assert all(isinstance(each, Failure) for each in failures)
    assert failures[0].message.startswith("ends FAILED")
    (case,) = missing
    assert isinstance(case.result[0], Error)
    assert "there is no scenario" in case.result[0].message


def test_junit_accepts_any_text_and_distinguishes_cases() -> None:
    cases = [JunitCase("same", "a\x00b\n<&>", CaseStatus.FAILURE), JunitCase("same", "fine")]
    file = io.BytesIO()
    write_junit(file, "all", [JunitSuite("s\x1b", cases, 1.5)])
    (suite,) = JUnitXml.fromstring(file.getvalue())
    assert (suite.name, suite.time) == ("s\\x1b", 1.5)
    assert [case.name for case in suite] == ["same", "same (2)"]
    assert next(iter(suite)).result[0].message == "a\\x00b\\n<&>"


def test_a_run_that_breaks_down_does_not_prevent_the_run_of_others(
    file: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    errors = iter([RunError("it: rover-sim ended"), TimeoutError("not ready")])

    def break_twice(*arguments: Any) -> ScenarioResult:
        error = next(errors, None)
        if error is not None:
            raise error
        return run_scenario(*arguments)

    monkeypatch.setattr(session, "run_scenario", break_twice)
    result = run(file, file, file)
    assert result.exit_code == 3
    assert "Error: it: rover-sim ended" in result.stderr
    assert "cannot reach the rover: not ready" in result.stderr
    assert result.stdout.splitlines()[-1] == "6 of 6 expectations are met"


@pytest.mark.parametrize(
    ("arguments", "blamed"),
    [
        (("--set", "friction"), "'friction' is not KEY=VALUE"),
        (("--repeat", "0"), "0 is not in the range"),
        (("--seed", "-1"), "-1 is not in the range"),
        (("--json", "--verbose"), "--json goes with neither"),
        (("--junit", "no/such/folder.xml"), "No such file or directory"),
    ],
)
def test_options_that_make_no_sense(file: str, arguments: tuple[str, ...], blamed: str) -> None:
    result = run(file, *arguments)
    assert result.exit_code == 2
    assert blamed in result.stderr


@pytest.mark.parametrize(
    ("begun", "found"),
    [
        ("world.fr", {"world.friction="}),
        ("see", {"seed="}),
        ("settings.drive.travel_s", {"settings.drive.travel_speed="}),
        ("odometry.gyro_b", {"odometry.gyro_bias="}),
        ("world=r", {"world=rough"}),
        ("asset=m", {"asset=mocup"}),
        ("comm", {"command."}),
        ("x", set()),
    ],
)
def test_a_shell_completes_what_can_be_changed(file: str, begun: str, found: set[str]) -> None:
    complete = ShellComplete(scenario, {}, "scenario", "_X").get_completions
    assert {item.value for item in complete([file, "--set"], begun)} == found
