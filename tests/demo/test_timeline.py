"""The timeline: each mark where its time is, eclipses behind all, on paper both ways alike."""

from xml.etree import ElementTree

import pytest

from sim.demo.drawing import Anchor, Drawing, Label, Polyline
from sim.demo.raster import as_image
from sim.demo.script import Ending, Link
from sim.demo.svg import as_svg
from sim.demo.timeline import (
    DARK,
    LEFT,
    QUEUE,
    RIGHT,
    WIDTH,
    Lane,
    Level,
    Passage,
    Rover,
    Timeline,
    draw_timeline,
)
from sim.demo.timeline_marks import BUSY, GIVEN_UP, READY, UP

END_S = 28.0
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
    ended=Passage(28.0, 28.0),
    again=True,
)


def x(at_s: float) -> float:
    """Return where a time is on the axis, which begins and ends a second further out."""
    return LEFT + (WIDTH - LEFT - RIGHT) * (at_s + 1.0) / (END_S + 2.0)


def drawn(*lanes: Lane, eclipse: bool = True) -> Drawing:
    return draw_timeline(
        Timeline(
            "Commands through an <eclipse>",
            (Rover("", lanes),),
            eclipses=((4.0, 20.0),) if eclipse else (),
            commands=(Level(5.0, 1), Level(6.0, 2), Level(13.0, 1), Level(20.0, 0)),
            reports=(Level(26.0, 1), Level(28.0, 0)),
            end_s=END_S,
        )
    )


def spans(
    drawing: Drawing, *, stroke: str | None = None, fill: str | None = None
) -> list[list[float]]:
    """Return from where to where shapes of a colour reach, those of the legend left out."""
    return [
        [min(spot[0] for spot in shape.spots), max(spot[0] for spot in shape.spots)]
        for shape in drawing.shapes
        if isinstance(shape, Polyline)
        and (stroke is None or shape.stroke == stroke)
        and (fill is None or shape.fill == fill)
        and min(spot[1] for spot in shape.spots) > 100
    ]


def words(drawing: Drawing) -> list[str]:
    return [shape.text for shape in drawing.shapes if isinstance(shape, Label)]


def test_a_command_waits_at_the_orbiter_and_is_carried_out_after_the_eclipse() -> None:
    drawing = drawn(WAITED)
    assert spans(drawing, fill=DARK) == [pytest.approx([x(4.0), x(20.0)])]
    assert pytest.approx([x(5.0), x(20.0)]) in spans(drawing, stroke=UP)
    assert pytest.approx([x(20.0), x(21.0)]) in spans(drawing, stroke=BUSY), "waits for its turn"
    assert pytest.approx([x(21.0), x(26.0)]) in spans(drawing, fill=BUSY)
    assert pytest.approx([x(26.0), x(28.0)]) in spans(drawing, stroke=READY), "its report waits"
    assert "eclipse: no contact for 16 s" in words(drawing)


def test_what_the_orbiter_gives_up_ends_with_a_cross_there() -> None:
    drawing = drawn(EXPIRED)
    assert pytest.approx([x(6.0), x(13.0)]) in spans(drawing, stroke=UP)
    crosses = spans(drawing, stroke=GIVEN_UP)
    assert [(west + east) / 2 for west, east in crosses] == [pytest.approx(x(13.0))] * 2
    assert spans(drawing, fill=BUSY) == []


def test_a_repeat_shows_no_work() -> None:
    drawing = drawn(AGAIN)
    assert spans(drawing, fill=BUSY) == []
    assert "again: moveTo 0.2,0.9,0°" in words(drawing)
    assert "orbiter" not in words(drawing)


def test_queues_stand_below_where_there_is_an_eclipse() -> None:
    assert "bundles at the orbiter" in words(drawn(WAITED))
    light = drawn(WAITED, eclipse=False)
    assert "bundles at the orbiter" not in words(light)
    assert spans(light, fill=DARK) == []
    assert light.height < drawn(WAITED).height - QUEUE, "the shorter legend leaves no gap"


@pytest.mark.parametrize(
    ("most", "ticks"),
    [(3, [0, 1, 2, 3]), (5, [0, 1, 2, 3, 4, 5]), (7, [0, 2, 4, 7]), (60, [0, 12, 24, 36, 48, 60])],
)
def test_each_of_few_that_wait_has_its_number(most: int, ticks: list[int]) -> None:
    waiting = (Level(5.0, 1), Level(6.0, most))
    drawing = draw_timeline(Timeline("", (), eclipses=((4.0, 20.0),), commands=waiting, end_s=9.0))
    axis = [s for s in drawing.shapes if isinstance(s, Label) and s.anchor is Anchor.END]
    assert sorted(int(label.text) for label in axis) == ticks


def test_both_papers_show_it() -> None:
    drawing = drawn(WAITED, EXPIRED, AGAIN)
    root = ElementTree.fromstring(as_svg(drawing))
    assert "Commands through an <eclipse>" in [element.text for element in root.iter()]
    image = as_image(drawing).convert("RGB")
    assert image.size == (drawing.width, drawing.height)
    shown = [colour for _, colour in image.getcolors(1 << 20) or []]
    for colour in (UP, BUSY, READY, GIVEN_UP, DARK):
        assert any(distance(colour, one) < 24 for one in shown), colour


def distance(colour: str, shown: object) -> int:
    assert isinstance(shown, tuple)
    wanted = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return sum(abs(one - other) for one, other in zip(wanted, shown, strict=True))
