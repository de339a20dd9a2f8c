"""The timeline of a run: each thing is where it should be, and written the same each time."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex

from executive.commands import Mode
from executive.history.motion_tracks import TrackSource
from executive.values.reports import Stage
from sim.drawing import (
    COMMAND,
    DONE,
    MOTION,
    WRONG,
    CommandLane,
    Panel,
    RunTimeline,
    Series,
    TimeSpan,
    draw_timeline,
)
from tests.drawing.pictures import labels, lines, spans, written_alike


def speed(times_s: tuple[float, ...], speeds_mps: tuple[float, ...]) -> Panel:
    return Panel("true speed", "m/s", (Series(TrackSource.TRUTH, times_s, speeds_mps),))


DRIVEN = CommandLane("ahead", (1.0, 7.0), 1.0, 1.1, 5.0, Stage.FAILED, "DRIVE_DEADLINE")
WAITED = CommandLane("home", (2.0,), 2.0, 5.0, 9.0, Stage.EXECUTED)
RUN = RunTimeline(
    title="A run of <two> commands",
    end_s=12.0,
    commands=(DRIVEN, WAITED),
    faults=(TimeSpan("left_wheels_stuck", 2.0, 5.0), TimeSpan("left_wheels_stuck", 8.0, 9.0)),
    events=(("ODOMETRY_STALE", (3.0, 8.5)),),
    modes=((Mode.IDLE, 0.0, 1.1), (Mode.MOVING, 1.1, 9.0), (Mode.IDLE, 9.0, 12.0)),
    panels=(speed((0.0, 3.0, 12.0), (0.0, 0.5, 0.0)),),
    outages=((3.0, 4.0),),
)


def test_a_command_is_drawn_from_its_start_to_its_end_after_it_waited() -> None:
    figure = draw_timeline(RUN)
    assert {(1.1, 5.0), (2.0, 5.0), (5.0, 9.0)} <= set(spans(figure, MOTION))
    assert (1.0, 7.0) in spans(figure, COMMAND), "sent, and sent again"
    assert list(spans(figure, DONE)) == [(9.0, 9.0)]
    assert {"ahead", "FAILED: DRIVE_DEADLINE", "home", "EXECUTED"} <= labels(figure)


def test_faults_are_drawn_while_they_last_one_row_for_each_kind() -> None:
    figure = draw_timeline(RUN)
    faults = [line for line in lines(figure, WRONG) if line.get_linewidth() > 2]
    assert [tuple(map(float, np.asarray(line.get_xdata()))) for line in faults] == [
        (2.0, 5.0),
        (8.0, 9.0),
    ]
    assert len({tuple(np.asarray(line.get_ydata())) for line in faults}) == 1
    assert "outage: no contact for 1 s" in labels(figure)


def test_modes_are_named_if_they_fit() -> None:
    assert {"IDLE", "MOVING"} <= labels(draw_timeline(RUN))
    blink = replace(RUN, modes=((Mode.STOPPED, 0.0, 0.1),))
    assert "STOPPED" not in labels(draw_timeline(blink))


def test_the_scale_of_the_speed_holds_the_fastest() -> None:
    for fastest_mps in (0.0, 0.5, 2.0):
        figure = draw_timeline(replace(RUN, panels=(speed((0.0, 1.0), (0.0, fastest_mps)),)))
        assert figure.axes[1].get_ylim()[1] > fastest_mps


@pytest.mark.parametrize("end_s", [0.0, 12.0])
def test_an_empty_run_is_reported(end_s: float) -> None:
    assert "no command was sent" in labels(draw_timeline(RunTimeline("Nothing", end_s)))


def test_a_command_that_has_not_ended_is_drawn_to_the_end() -> None:
    going = CommandLane("ahead", (1.0,), 1.0, 1.1, None, Stage.STARTED)
    silent = CommandLane("unheard", (4.0,), text="lost")
    figure = draw_timeline(replace(RUN, commands=(going, silent)))
    assert (1.1, 12.0) in spans(figure, MOTION)
    assert "no report: lost" in labels(figure)


def test_it_is_written_the_same_each_time(tmp_path: Path) -> None:
    figure = draw_timeline(RUN)
    assert written_alike(figure, tmp_path, MOTION)
    assert to_hex(figure.get_facecolor()) == "#ffffff"
