"""The map of a drive: each thing is where it should be, in the SVG and in the PNG alike."""

from collections.abc import Iterable
from dataclasses import replace
from math import pi
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

from executive.commands.catalogue import Waypoint
from executive.geometry import Point, Pose
from sim.demo.contours import contour
from sim.demo.drawing import Drawing, Label, Polyline, Spot
from sim.demo.map import DRIVEN, TRUE, Drive, draw_map, thinned
from sim.demo.marks import STOPPED
from sim.demo.raster import as_image
from sim.demo.sheet import LEFT, PIXELS_PER_M, ROCK, Sheet
from sim.demo.svg import as_svg
from sim.rover.world import Rock, Terrain, World

SVG = "{http://www.w3.org/2000/svg}"
WORLD = World(name="two <rocks> & more", rocks=(Rock(2.0, 1.0, 0.3, 0.3), Rock(90, 0, 1, 1)))


def straight(y_m: float) -> tuple[Pose, ...]:
    return tuple(Pose(x_m / 50, y_m) for x_m in range(151))


def drive() -> Drive:
    return Drive(
        title="Drive in “two <rocks> & more”",
        world=WORLD,
        planned=(Waypoint(3.0, 0.0, pi / 2), Waypoint(3.0, 2.0)),
        driven=straight(0.0),
        true=straight(-0.3),
        stops=(Pose(1.5, 0.0),),
        views=(),
        figures=("driven 3.0 m",),
    )


def lines(drawing: Drawing, stroke: str) -> list[Polyline]:
    return [s for s in drawing.shapes if isinstance(s, Polyline) and s.stroke == stroke]


def spots_of(document: str, stroke: str) -> list[list[Spot]]:
    """Return the corners of an SVG's paths of a colour."""
    paths = ElementTree.fromstring(document).iter(f"{SVG}path")
    return [
        [
            (float(x), float(y))
            for x, y in (spot.split() for spot in path.attrib["d"][1:].split("L"))
        ]
        for path in paths
        if path.get("stroke") == stroke and not path.attrib["d"].endswith("Z")
    ]


def colours_near(picture: Image.Image, spot: Spot, reach: int) -> set[str]:
    x, y = (round(value) for value in spot)
    box = (x - reach, y - reach, x + reach + 1, y + reach + 1)
    pixels = np.asarray(picture.convert("RGB").crop(box)).reshape(-1, 3)
    return {f"#{r:02x}{g:02x}{b:02x}" for r, g, b in pixels.tolist()}


def near(colour: str, others: Iterable[str], by: int = 12) -> bool:
    """Tell whether a colour is among others, but for what reducing to few colours changes."""
    wanted = [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
    return any(
        all(abs(int(other[1 + 2 * i : 3 + 2 * i], 16) - wanted[i]) <= by for i in range(3))
        for other in others
    )


def test_tracks_are_to_scale_in_the_svg() -> None:
    document = as_svg(draw_map(drive()))
    driven, legend = spots_of(document, DRIVEN)
    true, _ = spots_of(document, TRUE)
    assert driven[-1][0] - driven[0][0] == pytest.approx(3 * PIXELS_PER_M, abs=0.2)
    assert true[0][1] - driven[0][1] == pytest.approx(0.3 * PIXELS_PER_M, abs=0.2)
    assert min(x for x, _ in legend) > max(x for x, _ in driven)


def test_svg_says_what_was_measured_and_escapes_it() -> None:
    texts = [
        text.text for text in ElementTree.fromstring(as_svg(draw_map(drive()))).iter(f"{SVG}text")
    ]
    assert "Drive in “two <rocks> & more”" in texts
    assert {"driven 3.0 m", "1 m", "1", "2", "x in m"} <= set(texts)


def test_the_legend_names_what_is_on_the_map() -> None:
    pose = Pose(1.0, 0.0)
    for stops, views in (((pose,), ()), ((), (pose,))):
        drawing = draw_map(replace(drive(), stops=stops, views=views))
        texts = {shape.text for shape in drawing.shapes if isinstance(shape, Label)}
        assert ("stopped here" in texts) == bool(stops)
        assert ("picture taken, view" in texts) == bool(views)


def test_png_shows_the_same_at_the_same_places() -> None:
    drawing = draw_map(drive())
    picture = as_image(drawing)
    assert picture.size == (drawing.width, drawing.height)
    driven, true = lines(drawing, DRIVEN)[0], lines(drawing, TRUE)[0]
    assert near(DRIVEN, colours_near(picture, driven.spots[40], 2))
    assert near(TRUE, colours_near(picture, true.spots[40], 2))
    assert not near(TRUE, colours_near(picture, driven.spots[40], 2))
    (stop, _) = [s for s in drawing.shapes if isinstance(s, Polyline) and s.fill == STOPPED]
    middle = tuple(np.mean(stop.spots, axis=0).tolist())
    assert near(STOPPED, colours_near(picture, middle, 1))


def test_only_rocks_in_the_window_are_drawn() -> None:
    rocks = [s for s in draw_map(drive()).shapes if isinstance(s, Polyline) and s.fill == ROCK]
    assert len(rocks) == 2  # one in the window, one in the legend
    widths = [max(x for x, _ in rock.spots) - min(x for x, _ in rock.spots) for rock in rocks]
    assert 0.8 * 60 < widths[0] <= 60


def test_every_place_is_in_the_window() -> None:
    places = [Point(-3.0, 4.0), Point(5.0, -6.0)]
    sheet = Sheet(World(), places)
    for place in places:
        x, y = sheet.spot(place)
        assert LEFT < x < sheet.right
        assert 0 < y < sheet.bottom


def test_a_waypoint_without_heading_has_no_arrow() -> None:
    bare = tuple(replace(place, heading_rad=None) for place in drive().planned)
    without = draw_map(replace(drive(), planned=bare))
    assert len(draw_map(drive()).shapes) - len(without.shapes) == 2


def test_all_is_on_the_paper_however_short_the_drive() -> None:
    one = (Pose(0.0, 0.0),)
    drawing = draw_map(replace(drive(), planned=(), driven=one, true=one, stops=()))
    for shape in drawing.shapes:
        for x, y in shape.spots if isinstance(shape, Polyline) else (shape.spot,):
            if not (isinstance(shape, Polyline) and shape.fill == ROCK):
                assert 0 <= x <= drawing.width
                assert 0 <= y <= drawing.height


def test_noise_at_rest_is_no_way() -> None:
    rest = [Point(0.005 * (i % 2), 0.0) for i in range(100)]
    assert thinned(rest) == [rest[0]]
    driven = [Point(0.025 * i, 0.0) for i in range(100)]
    assert thinned(driven) == driven


def test_contours_of_a_cone_are_circles() -> None:
    axis = np.linspace(-5, 5, 81)
    cone = Terrain(5 - np.hypot(axis[:, None], axis[None, :]), 10.0)
    pieces = list(contour(cone, 2.0))
    assert len(pieces) > 50
    for piece in pieces:
        for place in piece:
            assert place.distance_m(Point(0, 0)) == pytest.approx(3.0, abs=0.01)


def test_a_dash_leaves_gaps_in_both() -> None:
    drawing = Drawing(60, 20)
    drawing.add(Polyline(((5, 10), (55, 10)), "#000000", 2, dash=(5, 5)), Label("a < b", (5, 8)))
    row = np.asarray(as_image(drawing).convert("L"))[10]
    dark = row < 128
    assert np.count_nonzero(dark[1:] & ~dark[:-1]) == 5
    assert 'stroke-dasharray="5 5"' in as_svg(drawing)
