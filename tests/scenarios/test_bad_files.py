"""Strangers bring their own files: each bad one gives one line that names file and key."""

import re
from pathlib import Path

import pytest
from click.shell_completion import ShellComplete
from click.testing import CliRunner, Result

from sim.scenario.commands import scenario

GOOD = """\
title: Good
duration: 2
timeline:
  - {at: 1, command: {moveForward: {distance: 0.1}}, label: ahead}
expect:
  - {command: ahead, stages: [RECEIVED, ACCEPTED, STARTED, EXECUTED]}
"""
MOVE = "moveForward: {distance: 0.1}"
HUGE = f"0x1{'0' * 9999}"


def play(path: Path) -> Result:
    return CliRunner().invoke(scenario, [str(path)], catch_exceptions=False)


@pytest.mark.parametrize(
    ("good", "bad", "blamed"),
    [
        ("title: Good", "titel: Good", "unknown key 'titel'"),
        ("title: Good\n", "", "key 'title' is missing"),
        ("title: Good", "title: 7", "title: expected a text, got 7"),
        ("duration: 2", "duration: soon", "duration: 'soon' is no quantity in s"),
        ("duration: 2", "duration: .nan", "duration: expected a finite number"),
        ("duration: 2", "duration: 0", "duration: 0 is not in"),
        ("expect:", "expect:\n  - {fetched: x.jpg}", "expect[0].fetched: no 'x.jpg' in timeline"),
        ("expect:", "expect:\n  - {files: [], query: x}", "expect[0].query: no 'x' in timeline"),
        (
            "expect:",
            "expect:\n  - {file: x, events: [TRANSFERRED]}",
            "expect[0]: events: TRANSFERRED",
        ),
        (
            "expect:",
            "expect:\n  - {parameter: HEAD, value: 0, once: true}",
            "expect[0]: once needs for",
        ),
        ("expect:", "expect:\n  - {video: 1}", "expect[0]: key 'for' is missing"),
        ("expect:", "expect:\n  - {video: 0, for: 1}", "expect[0].video: video works with"),
        ("duration: 2", "duration: 2\nduration: 3", "duplicate key 'duration'"),
        ("duration: 2", "duration: 2\non: 3", "key on means True in YAML: quote it"),
        ("duration: 2", "duration: 0.5", "timeline[0]: is later than the end"),
        ("duration: 2", "duration: 2\nseed: 1.5", "seed: expected a whole number, got 1.5"),
        ("duration: 2", "duration: 2\nseed: -1", "seed: -1 is below 0"),
        (
            "duration: 2",
            "duration: 2\nworld: mars",
            "world: there is no world 'mars'; there are: flat",
        ),
        ("duration: 2", "duration: 2\nworld: {friction: 99}", "world.friction: 99 is not in"),
        ("duration: 2", "duration: 2\nworld: {gravity: 1}", "world: unknown key 'gravity'"),
        (
            "duration: 2",
            "duration: 2\nasset: sojourner",
            "asset: there is no asset 'sojourner'; there",
        ),
        ("duration: 2", "duration: 2\nsettings: {tick: 0}", "settings.tick: 0 s is no multiple"),
        (
            "duration: 2",
            "duration: 2\nsettings: {drive: {wings: 2}}",
            "settings.drive: unknown key",
        ),
        ("duration: 2", "duration: 2\nsettings: {drive: {rotate_speed: 0}}", "is not above 0"),
        (
            "duration: 2",
            f"duration: 2\nsettings: {{camera: {{width: 0x1{'0' * 9999}}}}}",
            "of digits is not",
        ),
        (
            "duration: 2",
            f"duration: 2\nasset: 0x1{'0' * 9999}",
            "asset: expected a text, got a number",
        ),
        ("at: 1,", "", "timeline[0]: at, after or near is needed"),
        ("at: 1,", "at: 1, after: ahead EXECUTED,", "timeline[0]: at and after exclude"),
        ("at: 1,", "at: -1,", "timeline[0].at: -1 is below 0"),
        ("at: 1,", "at: true,", "timeline[0].at: expected a number, got True"),
        ("at: 1,", "near: {x: 1},", "timeline[0].near: key 'y' is missing"),
        ("at: 1,", "near: {x: 1, y: 0, within: 0},", "near.within: 0 is below 0.01"),
        ("at: 1,", "after: ahead,", "timeline[0].after: 'ahead' is not LABEL STAGE"),
        ("at: 1,", "after: back EXECUTED,", "timeline[0].after: no 'back' in timeline"),
        ("moveForward", "fly", "timeline[0].command: 'fly' is no operation"),
        (MOVE, "moveTo: {x: 1, y: 2, controller: mcp}", "'mcp' is none of turn_drive, mpc"),
        (MOVE, "moveTo: {x: 1}", "timeline[0].command.moveTo: key 'y' is missing"),
        (MOVE, "moveTo: {x: 1, y: 2, z: 3}", "unknown key 'z'; known are x, y, heading, tol"),
        ("distance: 0.1", "length: 1", "timeline[0].command.moveForward: unknown key 'length'"),
        ("distance: 0.1", "", "timeline[0].command.moveForward: key 'distance' is missing"),
        ("distance: 0.1", "distance: .nan", "moveForward.distance: expected a finite number"),
        ("distance: 0.1", "distance: .inf", "moveForward.distance: expected a finite number"),
        ("distance: 0.1", "distance: 10deg", "moveForward.distance: '10deg' is no quantity"),
        ("distance: 0.1", f"distance: 1{'0' * 400}", "distance: expected a finite number"),
        ("distance: 0.1", f"distance: {HUGE}", "distance: expected a finite number"),
        ("label: ahead", "label: go ahead", "timeline[0]: 'go ahead' is no label"),
        ("label: ahead", f"id: 1{'0' * 30}", "timeline[0].id: 1000000000"),
        ("command: {moveForward: {distance: 0.1}}", "inject: gremlins", "timeline[0].inject: "),
        ("label: ahead}", "label: a}\n  - {at: 1, command: stop, label: a}", "there is a 'a'"),
        ("command: ahead", "comand: ahead", "expect[0]: one of command, event,"),
        ("command: ahead", "command: ahead, mode: IDLE", "command and mode together"),
        ("command: ahead", "command: aback", "expect[0].command: no 'aback'"),
        ("STARTED,", "BEGUN,", "expect[0].stages[2]: 'BEGUN' is none of RECEIVED"),
        ("[RECEIVED, ACCEPTED, STARTED, EXECUTED]", "EXECUTED", "stages: expected a list"),
        ("timeline:", "timeline:\n  - {at: 1, cargo: 51}", "cargo: 51 is not in 0 .. 50"),
        ("timeline:", "timeline:\n  - {at: 1, outage: 0}", "timeline[0].outage: 0 is below"),
        ("moveForward: {distance: 0.1}", "submitPlan: {plan: x}", "'x' cannot be read (No such"),
        ("moveForward: {distance: 0.1}", "submitPlan: {plan: x.xml}", "'x.xml' cannot be read"),
        ("moveForward: {distance: 0.1}", 'submitPlan: {plan: "a\\0"}', "cannot be read"),
        ("expect:", "expect:\n  - {link: ALARM}", "expect[0].link: works with --live --link"),
        (GOOD[GOOD.index("  - {command") :], "", "expect: expected a list, got None"),
        (GOOD, "expect: [", "is not YAML"),
        (GOOD, "{a: " * 999 + "}" * 999, "is nested too deeply"),
        ("duration: 2", 'duration: 2\nworld: "a\\0"', "world: 'a\\x00' is no name"),
        (GOOD, "at: 2026-02-31", "is not YAML"),
        (GOOD, "\a", "is not YAML"),
        (GOOD, "- 1\n- 2", "a scenario is keys and values"),
        (GOOD, "", "a scenario is keys and values"),
    ],
)
def test_each_fault_has_a_line(tmp_path: Path, good: str, bad: str, blamed: str) -> None:
    assert good in GOOD
    path = tmp_path / "theirs.yaml"
    path.write_text(GOOD.replace(good, bad))
    result = play(path)
    assert result.exit_code == 2, result.output
    first, *others = result.output.splitlines()
    assert first.startswith(f"Error: {path}:")
    assert all(line.startswith("  ") for line in others)
    assert any(blamed in line for line in (first, *others))


def test_a_bad_file_does_not_prevent_the_run_of_others(tmp_path: Path) -> None:
    good, bad = tmp_path / "good.yaml", tmp_path / "bad.yaml"
    good.write_text(GOOD)
    bad.write_text(GOOD.replace("duration: 2", "duration: soon\nseed: -1"))
    files = [str(bad), str(tmp_path / "none.yaml"), str(good)]
    result = CliRunner().invoke(scenario, files, catch_exceptions=False)
    assert result.exit_code == 2
    wrong, missing, *played = result.output.splitlines()
    assert "bad.yaml: duration: 'soon' is no quantity in s" in wrong
    assert "none.yaml: cannot be read" in missing
    assert played[-1] == "6 of 6 expectations are met"


@pytest.mark.parametrize(
    ("begun", "completed"), [("dri", ["dri", "drive3m_turn_picture"]), ("x/", ["x/"])]
)
def test_a_shell_completes_names_and_files(begun: str, completed: list[str]) -> None:
    found = ShellComplete(scenario, {}, "scenario", "_X").get_completions([], begun)
    assert [item.value for item in found] == completed
    assert found[0].type == "file"


@pytest.mark.parametrize(
    ("message", "blamed"),
    [
        ("timeline: [{at: 0, fetch: a.jpg}]", "timeline[0]: files do not travel over the relay"),
        ("timeline: [{at: 0, command: stop, replace: true}]", "timeline[0].replace: commands over"),
        ("timeline: [{at: 0.5, outage: 1}]", "timeline[0]: over the relay an outage begins"),
        (
            "timeline: [{at: 0, command: stop}, {after: stop EXECUTED, outage: 1}]",
            "timeline[1]: over the relay an outage is planned",
        ),
        (
            "timeline: [{at: 0, near: {x: 1, y: 0, within: 1}, outage: 1}]",
            "timeline[0]: over the relay an outage is planned",
        ),
        ("timeline: [{at: 0, command: stop, link: third}]", "'third' works in lock step only"),
        ("timeline: [{at: 0, crash: 1}]", "crash works in lock step only"),
        ("timeline: [{at: 0, fix: here}]", "fix works in lock step only"),
        ("timeline: [{at: 0, inject: link_lost}]", "timeline[0].inject: link_lost does not work"),
        ("expect: [{file: a, events: []}]", "expect[0].file: does not travel over the relay"),
        ("expect: [{video: 1, for: 1}]", "expect[0].video: does not travel over the relay"),
        (
            "expect: [{plan: a, status: COMPLETED}]",
            "expect[0].plan: does not travel over the relay",
        ),
    ],
)
def test_the_relay_carries_not_all(tmp_path: Path, message: str, blamed: str) -> None:
    path = tmp_path / "theirs.yaml"
    rest = "" if message.startswith("expect") else "expect: [{pictures: 0}]\n"
    path.write_text(f"title: T\nduration: 2\n{message}\n{rest}")
    arguments = [str(path), "--live", "--link", "relay"]
    result = CliRunner().invoke(scenario, arguments, catch_exceptions=False)
    assert result.exit_code == 2
    assert blamed in result.output


@pytest.mark.parametrize("world", ["", "\nworld: ice.yaml"])
def test_a_good_one_is_played_with_a_world_of_ones_own(tmp_path: Path, world: str) -> None:
    (tmp_path / "ice.yaml").write_text("friction: 0.3\n")
    path = tmp_path / "theirs.yaml"
    path.write_text(GOOD.replace("duration: 2", f"duration: 2{world}"))
    assert play(path).exit_code == 0


def test_octets_that_are_no_text(tmp_path: Path) -> None:
    path = tmp_path / "theirs.yaml"
    path.write_bytes(b"title: \xff\xfe\x00")
    result = play(path)
    assert result.exit_code == 2
    assert "is not YAML" in result.output


@pytest.mark.parametrize(
    ("typed", "blamed"),
    [
        ("gone/none.yaml", "none.yaml: cannot be read"),
        ("moonwalk", "there is no scenario 'moonwalk'; there are: after_fault_moving, "),
        ("killed --live", r"timeline\[2\]: .*lock step only"),
        ("expired --speed 2", "--speed does not work"),
        ("expired --live --link relay --speed 2", "--speed does not work"),
        ("expired --link relay", "--link relay works with --live only"),
    ],
)
def test_what_cannot_be_played_as_it_is_typed(typed: str, blamed: str) -> None:
    result = CliRunner().invoke(scenario, typed.split(), catch_exceptions=False)
    assert result.exit_code == 2
    assert re.search(blamed, result.output)
