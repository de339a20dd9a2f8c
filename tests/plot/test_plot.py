"""The plot of a recording shows what happened, when and where, and bad input is told."""

from contextlib import closing
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from PIL import Image

from adapters.recording import RunFile
from executive.commands import Mode
from executive.history.motion_tracks import TrackSource
from executive.values.reports import Stage
from sim.drawing import draw_run, plot_of
from sim.plot.commands import plot
from sim.scenario.changes import Override
from sim.scenario.lockstep_run import run_in_lock_step
from sim.scenario.model import RunMode
from sim.scenario.reading import load_scenario
from tests.drawing.pictures import labels


def recorded(name: str, folder: Path, lasts_s: int) -> Path:
    path = folder / "run.mcap"
    scenario = load_scenario(name, RunMode.LOCK_STEP, (Override.parse(f"duration={lasts_s}"),))
    with closing(RunFile(path)) as tape:
        run_in_lock_step(scenario, folder / "data", tape)
    return path


@pytest.fixture(scope="module")
def stuck(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded("side_stuck", tmp_path_factory.mktemp("stuck"), 8)


def typed(*arguments: object) -> Result:
    return CliRunner().invoke(plot, list(map(str, arguments)), catch_exceptions=False)


def test_a_failed_drive_is_drawn_with_its_figures_and_its_position(stuck: Path) -> None:
    shown = plot_of(stuck)
    first, *others = shown.timeline.commands
    assert (first.title, first.last) == ("moveForward MOE:1", Stage.FAILED)
    assert first.text == "WHEELS_OFF_COMMAND"
    assert first.figures.startswith("commanded 1 m/s, wheels 0.3")
    assert ", bound 0.3" in first.figures
    assert {each.last for each in others} == {Stage.EXECUTED}
    incident = shown.incidents[0]
    assert (incident.text, round(incident.pose.x_m, 1)) == ("WHEELS_OFF_COMMAND", 0.7)
    assert [name for name, _ in shown.timeline.events] == ["WHEELS_OFF_COMMAND", "POSE_UNCERTAIN"]
    assert Mode.STOPPED in {mode for mode, _, _ in shown.timeline.modes}
    speed, turn = shown.timeline.panels
    assert {each.source for each in speed.series} == set(TrackSource) - {TrackSource.SECOND}
    for each in speed.series:
        assert 0.9 < max(each.values) < 1.1, each.source
    assert {"speed, m/s", "turn rate, rad/s", first.figures} <= labels(draw_run(shown))
    assert turn.unit == "rad/s"


def test_no_line_leads_over_the_time_without_an_executive(tmp_path: Path) -> None:
    shown = plot_of(recorded("killed", tmp_path, 18))
    ((absent_s, again_s),) = shown.timeline.absences
    assert (round(absent_s), round(again_s)) == (3, 5)
    assert "2 starts of the executive" in shown.figures
    assert not [mode for mode, begin_s, end_s in shown.timeline.modes if begin_s < 4 < end_s]
    first = shown.timeline.commands[0]
    assert first.ended_s is not None
    assert first.ended_s < 6, "when it was reported first, not when that was repeated"
    assert len(shown.incidents) == 1
    assert "no executive" in labels(draw_run(shown))


def test_the_picture_is_written_to_its_stated_path(stuck: Path, tmp_path: Path) -> None:
    assert typed(stuck).exit_code == 0
    with Image.open(stuck.with_name("plot.png")) as picture:
        assert picture.width == 1240
    assert typed(stuck, "--out", tmp_path / "drive.svg").exit_code == 0
    assert (tmp_path / "drive.svg").read_text().startswith("<svg")


def test_bad_input_is_reported(stuck: Path, tmp_path: Path) -> None:
    none = tmp_path / "none.mcap"
    none.write_bytes(b"no recording")
    for arguments, reported in (
        ((none,), "is no MCAP file"),
        ((tmp_path / "absent.mcap",), "cannot be read"),
        ((stuck, "--out", tmp_path / "drive.gif"), "name a file that ends in .png or .svg"),
        ((stuck, "--out", tmp_path / "no" / "drive.png"), "cannot be written"),
    ):
        result = typed(*arguments)
        assert result.exit_code == 2
        assert reported in result.output


def test_figures_that_cannot_be_drawn_are_an_error_of_the_recording(
    stuck: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def draw(_: object) -> None:
        raise ValueError("Axis limits cannot be NaN or Inf")

    monkeypatch.setattr("sim.drawing.run_plot.draw_run", draw)
    result = typed(stuck)
    assert result.exit_code == 2
    assert "holds figures that cannot be drawn: Axis limits" in result.output
