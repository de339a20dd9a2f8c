"""Lanes between ground, orbiter and rover: each thing is where it should be."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from sim.drawing import (
    COMMAND,
    DONE,
    MOTION,
    WRONG,
    CommandLane,
    Passage,
    ReportTimes,
    RunTimeline,
    draw_timeline,
)
from sim.drawing.timeline import DARK
from tests.drawing.pictures import labels, lines, spans, written_alike

WAITED = Passage(
    True,
    "EXECUTED",
    sent_s=5.0,
    stored_s=5.01,
    received=ReportTimes(20.0, 20.1),
    started=ReportTimes(21.0, 21.1),
    ended=ReportTimes(26.0, 28.0),
)
EXPIRED = Passage(True, "EXPIRED", sent_s=6.0, stored_s=6.0, lost_s=13.0)
AGAIN = Passage(
    False,
    "DUPLICATE",
    sent_s=28.0,
    ended=ReportTimes(28.0, 28.5),
    again=True,
)


def timeline(*passages: Passage, eclipse: bool = True) -> Figure:
    queued, aboard = ((5.0, 1), (6.0, 2), (13.0, 1), (20.0, 0)), ((26.0, 1), (28.0, 0))
    return draw_timeline(
        RunTimeline(
            "Commands through an <eclipse>",
            end_s=29.0,
            commands=tuple(
                CommandLane("moveTo", (each.sent_s,), passage=each) for each in passages
            ),
            outages=((4.0, 20.0),) if eclipse else (),
            waiting=(queued, aboard) if eclipse else None,
        )
    )


def test_a_command_waits_at_the_orbiter_and_is_carried_out_after_the_eclipse() -> None:
    figure = timeline(WAITED)
    assert (5.0, 20.0) in spans(figure, COMMAND)
    assert {(20.0, 21.0), (21.0, 26.0)} <= set(spans(figure, MOTION)), "its turn, its work"
    assert (26.0, 28.0) in spans(figure, DONE), "its report waits"
    assert "outage: no contact for 16 s" in labels(figure)
    (dark,) = [p for p in figure.axes[0].patches if to_hex(p.get_facecolor()) == DARK]
    assert dark.get_extents().width > 100


def test_a_command_lost_by_the_orbiter_ends_with_a_cross_there() -> None:
    figure = timeline(EXPIRED)
    assert (6.0, 13.0) in spans(figure, COMMAND)
    assert list(spans(figure, WRONG)) == [(13.0, 13.0)]
    assert lines(figure, MOTION) == []


def test_a_repeat_shows_no_work() -> None:
    figure = timeline(AGAIN)
    assert lines(figure, MOTION) == []
    assert "DUPLICATE" in labels(figure)
    assert "orbiter" not in labels(figure)


def test_an_instant_command_is_one_mark_with_its_time() -> None:
    passage = ReportTimes(6.0, 6.1)
    short = replace(
        WAITED, sent_s=5.9, stored_s=5.9, received=passage, started=passage, ended=passage
    )
    figure = timeline(short)
    assert "received after 0.20 s" in labels(figure)
    assert len(lines(figure, COMMAND)) == 3, "the way up, sent, received"
    assert lines(figure, MOTION) == lines(figure, DONE) == []


def test_queues_are_drawn_below_if_there_is_an_outage() -> None:
    dark, light = timeline(WAITED), timeline(WAITED, eclipse=False)
    assert "bundles at the orbiter" in labels(dark)
    assert "bundles at the orbiter" not in labels(light)
    assert light.get_figheight() < dark.get_figheight() - 1.0, "without a gap"
    assert len(dark.axes) == 2
    assert np.diff(dark.axes[1].get_yticks()).min() >= 1.0


def test_it_is_written_the_same_each_time(tmp_path: Path) -> None:
    assert written_alike(timeline(WAITED, EXPIRED, AGAIN), tmp_path, COMMAND)
