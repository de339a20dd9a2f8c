"""Map and timeline: each thing is where it should be, and written the same each time."""

from collections.abc import Iterator
from dataclasses import replace
from math import pi
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from matplotlib.text import Text
from PIL import Image

from executive.commands import Waypoint
from executive.geometry import Point, Pose
from sim.demo.drawing import COMMAND, DONE, MOTION, WRONG, write_drawing
from sim.demo.map import ROCK, TRUE, Drive, draw_map, thinned
from sim.demo.script import Ending, Link
from sim.demo.timeline import DARK, Lane, Passage, Timeline, draw_timeline
from sim.rover import Ground, Rock, World

WORLD = World(
    name="two <rocks> & more",
    ground=Ground(amplitude_m=0.05, seed=1),
    rocks=(Rock(2.0, 1.0, 0.3, 0.3), Rock(90, 0, 1, 1)),
)


def straight(y_m: float) -> tuple[Pose, ...]:
    return tuple(Pose(x_m / 50, y_m) for x_m in range(151))


DRIVE = Drive(
    title="Drive in “two <rocks> & more”",
    world=WORLD,
    planned=(Waypoint(3.0, 0.0, pi / 2), Waypoint(3.0, 2.0)),
    driven=straight(0.0),
    true=straight(-0.3),
    stops=(Pose(1.5, 0.0),),
    views=(),
    figures=("driven 3.0 m",),
)
WAITED = Lane(
    "moveTo 0.2,0.9,0°",
    Link.RELAY,
    Ending.EXECUTED,
    sent_s=5.0,
    stored_s=5.01,
    received=Passage(20.0, 20.1),
    started=Passage(21.0, 21.1),
    ended=Passage(26.0, 28.0),
)
EXPIRED = Lane("moveForward 5", Link.RELAY, Ending.EXPIRED, sent_s=6.0, stored_s=6.0, lost_s=13.0)
AGAIN = Lane(
    "moveTo 0.2,0.9,0°",
    Link.DIRECT,
    Ending.DUPLICATE,
    sent_s=28.0,
    ended=Passage(28.0, 28.5),
    again=True,
)


def timeline(*lanes: Lane, eclipse: bool = True) -> Figure:
    return draw_timeline(
        Timeline(
            "Commands through an <eclipse>",
            (("", lanes),),
            eclipses=((4.0, 20.0),) if eclipse else (),
            commands=((5.0, 1), (6.0, 2), (13.0, 1), (20.0, 0)),
            reports=((26.0, 1), (28.0, 0)),
            end_s=28.0,
        )
    )


def words(figure: Figure) -> set[str]:
    texts: list[Any] = figure.findobj(Text)
    return {text.get_text() for text in texts}


def lines(figure: Figure, colour: str) -> list[Line2D]:
    """Return what was drawn in a colour on the first axes."""
    return [line for line in figure.axes[0].lines if to_hex(line.get_color()) == colour]


def spans(figure: Figure, colour: str) -> Iterator[tuple[float, float]]:
    """Yield from where to where each line of a colour reaches."""
    for line in lines(figure, colour):
        across = np.asarray(line.get_xdata(), float)
        yield round(float(across.min()), 3), round(float(across.max()), 3)


def test_tracks_are_where_they_were_driven() -> None:
    figure = draw_map(DRIVE)
    (driven,), (true,) = lines(figure, MOTION), lines(figure, TRUE)
    assert np.asarray(driven.get_xdata())[[0, -1]] == pytest.approx([0.0, 3.0])
    assert np.asarray(true.get_ydata()) == pytest.approx(-0.3)
    axes = figure.axes[0]
    metre = axes.transData.transform((1, 0))[0] - axes.transData.transform((0, 0))[0]
    upright = axes.transData.transform((0, 1))[1] - axes.transData.transform((0, 0))[1]
    assert metre == pytest.approx(upright)


def test_a_small_rover_is_drawn_as_large() -> None:
    assert draw_map(replace(DRIVE, scale=0.5)).get_figwidth() > draw_map(DRIVE).get_figwidth()


def test_the_map_says_what_was_measured_and_names_what_is_on_it() -> None:
    pose = Pose(1.0, 0.0)
    for stops, views in (((pose,), ()), ((), (pose,))):
        said = words(draw_map(replace(DRIVE, stops=stops, views=views)))
        assert {DRIVE.title, "driven 3.0 m", "1 m", "1", "2", "x in m"} <= said
        assert ("stopped here" in said) == bool(stops)
        assert ("picture taken, view" in said) == bool(views)


def test_only_rocks_in_the_window_are_drawn() -> None:
    (rock,) = [
        patch
        for patch in draw_map(DRIVE).axes[0].patches
        if isinstance(patch, Polygon) and to_hex(patch.get_facecolor()) == ROCK
    ]
    assert 0.8 * 0.6 < np.ptp(rock.get_xy()[:, 0]) <= 0.6


@pytest.mark.parametrize(("at_m", "beside"), [(1.5, False), (2.9, True)])
def test_a_stop_at_a_waypoint_is_marked_beside_it(at_m: float, beside: bool) -> None:
    figure = draw_map(replace(DRIVE, stops=(Pose(at_m, 0.0),)))
    (sign,) = [line for line in figure.axes[0].lines if line.get_label() == "stop"]
    away_m = np.linalg.norm(np.asarray(sign.get_data(), float).ravel() - (at_m, 0.0))
    assert (away_m > 0.3) == beside


def test_however_short_the_drive_every_place_is_in_the_window() -> None:
    one = (Pose(-3.0, 4.0),)
    axes = draw_map(replace(DRIVE, planned=(), driven=one, true=one, stops=())).axes[0]
    assert axes.get_xlim()[0] < -3.0 < 0.0 < axes.get_xlim()[1]
    assert axes.get_ylim()[0] < 0.0 < 4.0 < axes.get_ylim()[1]


def test_noise_at_rest_is_no_way() -> None:
    rest = [Point(0.005 * (i % 2), 0.0) for i in range(100)]
    assert thinned(rest) == [rest[0]]
    driven = [Point(0.025 * i, 0.0) for i in range(100)]
    assert thinned(driven) == driven


def test_a_command_waits_at_the_orbiter_and_is_carried_out_after_the_eclipse() -> None:
    figure = timeline(WAITED)
    assert (5.0, 20.0) in spans(figure, COMMAND)
    assert {(20.0, 21.0), (21.0, 26.0)} <= set(spans(figure, MOTION)), "its turn, its work"
    assert (26.0, 28.0) in spans(figure, DONE), "its report waits"
    assert "eclipse: no contact for 16 s" in words(figure)
    (dark,) = [p for p in figure.axes[0].patches if to_hex(p.get_facecolor()) == DARK]
    assert dark.get_extents().width > 100


def test_what_the_orbiter_gives_up_ends_with_a_cross_there() -> None:
    figure = timeline(EXPIRED)
    assert (6.0, 13.0) in spans(figure, COMMAND)
    assert list(spans(figure, WRONG)) == [(13.0, 13.0)]
    assert lines(figure, MOTION) == []


def test_a_repeat_shows_no_work() -> None:
    figure = timeline(AGAIN)
    assert lines(figure, MOTION) == []
    assert "again: moveTo 0.2,0.9,0°" in words(figure)
    assert "orbiter" not in words(figure)


def test_what_is_done_at_once_is_one_mark_with_its_time() -> None:
    passage = Passage(6.0, 6.1)
    short = replace(
        WAITED, sent_s=5.9, stored_s=5.9, received=passage, started=passage, ended=passage
    )
    figure = timeline(short)
    assert "told after 0.20 s" in words(figure)
    assert len(lines(figure, COMMAND)) == 3, "the way up, sent, received"
    assert lines(figure, MOTION) == lines(figure, DONE) == []


def test_queues_stand_below_where_there_is_an_eclipse() -> None:
    dark, light = timeline(WAITED), timeline(WAITED, eclipse=False)
    assert "bundles at the orbiter" in words(dark)
    assert "bundles at the orbiter" not in words(light)
    assert light.get_figheight() < dark.get_figheight() - 1.0, "the shorter legend leaves no gap"
    assert len(dark.axes) == 2
    assert np.diff(dark.axes[1].get_yticks()).min() >= 1.0


@pytest.mark.parametrize("figure", [draw_map(DRIVE), timeline(WAITED, EXPIRED, AGAIN)])
def test_it_is_written_the_same_each_time(figure: Figure, tmp_path: Path) -> None:
    svg, png = write_drawing(tmp_path, "first", figure)
    again = write_drawing(tmp_path, "second", figure)
    assert [path.read_bytes() for path in again] == [svg.read_bytes(), png.read_bytes()]
    said = {element.text for element in ElementTree.fromstring(svg.read_text()).iter()}
    assert any("<" in (text or "") for text in said), "it is escaped"
    with Image.open(png) as picture:
        shown = np.unique(np.asarray(picture.convert("RGB")).reshape(-1, 3), axis=0).astype(int)
    for colour in (MOTION, COMMAND if len(figure.axes) == 2 else TRUE):
        wanted = [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
        assert np.abs(shown - wanted).sum(axis=1).min() < 24, colour
