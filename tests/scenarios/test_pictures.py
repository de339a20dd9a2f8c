"""Map, timeline and reports of a run show what was played and what came of it."""

import json
from pathlib import Path
from typing import Final

import pytest
from click.testing import CliRunner, Result
from PIL import Image

from executive.commands import Mode
from executive.values.reports import Stage
from sim.scenario.commands import scenario as scenario_command
from sim.scenario.lockstep_run import run_in_lock_step
from sim.scenario.model import Scenario
from sim.scenario.pictures import drive_of, timeline_of, write_run
from sim.scenario.reading import load_scenario
from sim.scenario.record import Record

RUN: Final = """
title: Stuck, stopped, lost
duration: 9
settings: {status_interval: 0.5}
timeline:
  - {at: 0.5, command: {moveTo: {x: 1, y: 0}}, label: near}
  - {at: 0.6, command: {moveForward: {distance: 2}}, label: further}
  - {after: further STARTED + 1, inject: {low_friction: {factor: 0.9}}}
  - {after: further STARTED + 1.5, command: stop}
  - {after: stop EXECUTED, clear: low_friction}
  - {after: stop EXECUTED + 1, crash: 1}
  - {after: stop EXECUTED + 1.5, command: resume, label: unheard}
  - {after: unheard EXECUTED, inject: camera_dead}
expect:
  - {command: near, ends: EXECUTED}
"""


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> tuple[Scenario, Record]:
    folder = tmp_path_factory.mktemp("run")
    path = folder / "run.yaml"
    path.write_text(RUN)
    scenario = load_scenario(str(path))
    return scenario, run_in_lock_step(scenario, folder)


def test_the_timeline_has_a_lane_for_each_command_that_was_sent(
    played: tuple[Scenario, Record],
) -> None:
    near, further, stop, unheard = timeline_of(*played).commands
    assert [lane.last for lane in (near, further, stop)] == [
        Stage.EXECUTED,
        Stage.CANCELLED,
        Stage.EXECUTED,
    ]
    assert further.text == "STOPPED"
    assert near.ended_s is not None
    assert further.received_s is not None
    assert further.started_s == pytest.approx(near.ended_s, abs=0.1)
    assert further.received_s == pytest.approx(0.6, abs=0.1)
    assert (unheard.text, unheard.last, unheard.ended_s) == ("lost", None, None)


def test_a_fault_lasts_until_it_is_cleared_and_only_if_it_was_injected(
    played: tuple[Scenario, Record],
) -> None:
    timeline = timeline_of(*played)
    _, further, stop, _ = timeline.commands
    stuck, lost = timeline.faults
    assert further.started_s is not None
    assert stop.ended_s is not None
    assert (stuck.name, lost.name) == ("low_friction", "executive lost")
    assert stuck.begin_s == pytest.approx(further.started_s + 1)
    assert stuck.end_s == pytest.approx(stop.ended_s)
    assert lost.end_s - lost.begin_s == pytest.approx(1.0)


def test_modes_follow_each_other_without_a_gap(played: tuple[Scenario, Record]) -> None:
    timeline = timeline_of(*played)
    assert [mode for mode, _, _ in timeline.modes] == [Mode.IDLE, Mode.MOVING, Mode.STOPPED]
    ends_s = [end_s for _, _, end_s in timeline.modes]
    assert ends_s == [*(begin_s for _, begin_s, _ in timeline.modes[1:]), timeline.end_s]
    assert 0.5 < max(timeline.panels[0].series[0].values) < 1.2


def test_the_map_shows_goals_tracks_stops_and_what_went_wrong_where(
    played: tuple[Scenario, Record],
) -> None:
    drive = drive_of(*played)
    assert [round(position.x_m, 1) for position in drive.planned] == [1.0, 3.0]
    assert len(drive.driven) > 3
    assert drive.true[0].x_m == pytest.approx(0.0, abs=0.01)
    (stop,) = drive.stops
    assert 1.1 < stop.x_m < 2.5
    assert [incident.text for incident in drive.incidents] == ["low_friction", "executive lost"]
    assert drive.incidents[0].pose.x_m < stop.x_m


def test_a_run_without_observations_is_drawn_at_its_start(
    played: tuple[Scenario, Record],
) -> None:
    scenario, _ = played
    drive = drive_of(scenario, Record(0.0, Path()))
    assert drive.true == (scenario.world.start_pose,)
    assert (drive.driven, drive.incidents) == ((), ())


def test_files_are_whole_and_reports_carry_names(
    played: tuple[Scenario, Record], tmp_path: Path
) -> None:
    written = write_run(tmp_path, *played)
    assert {path.name for path in written} == {path.name for path in tmp_path.iterdir()}
    for name in ("map.png", "timeline.png"):
        with Image.open(tmp_path / name) as picture:
            picture.load()
            assert picture.width > 500
    reports = [json.loads(line) for line in (tmp_path / "reports.jsonl").read_text().splitlines()]
    assert [each["sequence"] for each in reports] == list(range(1, len(reports) + 1))
    cancelled = next(each for each in reports if each["stage"] == "CANCELLED")
    assert (cancelled["label"], cancelled["reason"]) == ("further", "STOPPED")
    assert 0 < cancelled["time_s"] < 9


UNTRUE: Final = """
title: Not there
duration: 8
odometry: {gyro_bias: 2deg}
settings: {sensors: {imu: null, joints: null}}
timeline:
  - {at: 1, command: {moveTo: {x: 3, y: 0, heading: 0}}, label: there}
expect:
  - {command: there, ends: EXECUTED}
"""


def test_an_executed_but_untrue_motion_is_on_the_map(tmp_path: Path) -> None:
    path = tmp_path / "untrue.yaml"
    path.write_text(UNTRUE)
    scenario = load_scenario(str(path))
    drive = drive_of(scenario, run_in_lock_step(scenario, tmp_path))
    assert any(each.text.startswith("there EXECUTED, but") for each in drive.incidents)


def run_scenarios(*arguments: str) -> Result:
    return CliRunner().invoke(scenario_command, arguments, catch_exceptions=False)


def test_out_stores_a_folder_of_each_run(tmp_path: Path) -> None:
    out = tmp_path / "kept"
    result = run_scenarios("expired", "replaced", "expired", "--out", str(out))
    assert result.exit_code == 0, result.output
    assert str(out) in result.output.splitlines()[-1]
    assert {path.name for path in out.iterdir()} == {"expired", "replaced", "expired-2"}
    for folder in out.iterdir():
        left = {str(path.relative_to(folder)) for path in folder.rglob("*")}
        assert {"map.svg", "map.png", "timeline.svg", "timeline.png", "reports.jsonl"} <= left
        assert "data/ledger.sqlite" in left


def test_out_requires_an_empty_folder(tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("keep")
    for out in (tmp_path, tmp_path / "mine" / "below"):
        result = run_scenarios("expired", "--out", str(out))
        assert result.exit_code == 2
        assert f"--out {out}" in result.output
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]
