"""The map: each thing is where it should be, and written the same each time."""

from dataclasses import replace
from math import pi
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.patches import Circle, Polygon
from matplotlib.text import Annotation

from executive.commands import Waypoint
from executive.obstacles.zones import KeepIn, KeepOut, KnownRock, ScannedObstacle, Zones
from executive.values.geometry import Point, Pose
from sim.drawing import MOTION, DriveMap, Incident, draw_map, thinned
from sim.drawing.map import ROCK, TRUE
from sim.rover import Rock, SoilShape, World
from sim.rover.features import Ditch, FrictionPatch, GroundPoint, SlopeZone, StepBlock, Wall
from tests.drawing.pictures import labels, lines, written_alike

WORLD = World(
    name="two <rocks> & more",
    ground=SoilShape(amplitude_m=0.05, seed=1),
    rocks=(Rock(2.0, 1.0, 0.3, 0.3), Rock(90, 0, 1, 1)),
)


def straight(y_m: float) -> tuple[Pose, ...]:
    return tuple(Pose(x_m / 50, y_m) for x_m in range(151))


DRIVE = DriveMap(
    title="Drive in “two <rocks> & more”",
    world=WORLD,
    planned=(Waypoint(3.0, 0.0, pi / 2), Waypoint(3.0, 2.0)),
    driven=straight(0.0),
    true=straight(-0.3),
    stops=(Pose(1.5, 0.0),),
    views=(),
    figures=("driven 3.0 m",),
)


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


def test_the_map_states_its_measurements_and_names_its_elements() -> None:
    pose = Pose(1.0, 0.0)
    for stops, views in (((pose,), ()), ((), (pose,))):
        shown = labels(draw_map(replace(DRIVE, stops=stops, views=views)))
        assert {DRIVE.title, "driven 3.0 m", "1 m", "1", "2", "x in m"} <= shown
        assert ("stopped here" in shown) == bool(stops)
        assert ("picture taken, view" in shown) == bool(views)


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


def test_for_any_short_drive_every_waypoint_is_in_the_window() -> None:
    one = (Pose(-3.0, 4.0),)
    axes = draw_map(replace(DRIVE, planned=(), driven=one, true=one, stops=())).axes[0]
    assert axes.get_xlim()[0] < -3.0 < 0.0 < axes.get_xlim()[1]
    assert axes.get_ylim()[0] < 0.0 < 4.0 < axes.get_ylim()[1]


def test_noise_at_rest_is_no_distance() -> None:
    rest = [Point(0.005 * (i % 2), 0.0) for i in range(100)]
    assert thinned(rest) == [rest[0]]
    driven = [Point(0.025 * i, 0.0) for i in range(100)]
    assert thinned(driven) == driven


def test_it_is_written_the_same_each_time(tmp_path: Path) -> None:
    assert written_alike(draw_map(DRIVE), tmp_path, TRUE)


def test_what_went_wrong_is_named_where_it_did() -> None:
    near, far = Incident(Pose(1.0, 0.0), "slip"), Incident(Pose(2.5, 0.0), "FAILED")
    axes = draw_map(replace(DRIVE, incidents=(near, replace(near, text="late"), far))).axes[0]
    named = {text.get_text(): text for text in axes.texts if isinstance(text, Annotation)}
    assert {"slip", "late", "FAILED"} <= set(named)
    assert named["slip"].xy == named["late"].xy == (1.0, 0.0)
    assert named["slip"].get_position() != named["late"].get_position()


def test_the_legend_names_only_present_elements() -> None:
    bare = replace(DRIVE, world=World(), planned=(), driven=())
    assert {"rock", "1 cm of height", "planned line"} <= labels(draw_map(DRIVE))
    assert not {"rock", "1 cm of height", "planned line"} & labels(draw_map(bare))


YARD = World(
    walls=(Wall(x_m=-1.0, y_m=1.5, to=GroundPoint(3.0, 1.5)),),
    steps=(StepBlock(x_m=2.0, y_m=0.0, length_m=1.0, width_m=1.0, height_m=0.03),),
    ditches=(Ditch(x_m=1.5, y_m=-1.5, length_m=1.0, width_m=0.5, depth_m=0.2),),
    patches=(FrictionPatch(x_m=1.0, y_m=0.0, length_m=1.0, width_m=1.0, friction=0.2),),
    slopes=(
        SlopeZone(x_m=2.5, y_m=0.0, length_m=2.0, width_m=2.0, slope_rad=0.1),
        SlopeZone(x_m=90.0, y_m=0.0, length_m=2.0, width_m=2.0, slope_rad=0.2),
    ),
)


def test_features_in_the_window_are_drawn_where_they_are_and_named() -> None:
    figure = draw_map(replace(DRIVE, world=YARD, planned=(), stops=()))
    drawn = [patch for patch in figure.axes[0].patches if isinstance(patch, Polygon)]
    corners = [sorted((x, y) for x, y in patch.get_xy()[:-1].tolist()) for patch in drawn]
    assert sorted((corner.x_m, corner.y_m) for corner in YARD.steps[0].corners) in corners
    assert {"wall", "step", "ditch", "patch", "slope"} <= labels(figure)
    assert {"3 cm", "-20 cm", "friction 0.2", "6°"} <= labels(figure)
    assert "11°" not in labels(figure), "it is not in the window"


def test_elements_outside_the_window_are_not_in_the_legend() -> None:
    far = World(walls=(Wall(x_m=50.0, y_m=0.0, to=GroundPoint(51.0, 0.0)),))
    assert "wall" not in labels(draw_map(replace(DRIVE, world=far)))


def test_zones_are_drawn_with_their_names() -> None:
    zones = Zones(
        keep_in=(KeepIn("yard", ((-1.0, -2.0), (4.0, -2.0), (4.0, 2.0), (-1.0, 2.0))),),
        keep_out=(KeepOut("bed", ((1.0, 0.5), (2.0, 0.5), (2.0, 1.0))),),
        rocks=(KnownRock("boulder", 2.0, 1.0, 0.3),),
    )
    figure = draw_map(replace(DRIVE, zones=zones))
    (circle,) = [patch for patch in figure.axes[0].patches if isinstance(patch, Circle)]
    assert (circle.center, circle.radius) == ((2.0, 1.0), 0.3)
    titles = {"yard", "bed", "boulder", "keep-in zone", "keep-out zone", "rock known to the rover"}
    assert titles <= labels(figure)
    assert not titles & labels(draw_map(DRIVE))


def test_scanned_points_are_drawn() -> None:
    figure = draw_map(replace(DRIVE, scanned=(ScannedObstacle("seen", 2.0, 1.0, 0.2),)))
    (circle,) = [patch for patch in figure.axes[0].patches if isinstance(patch, Circle)]
    assert (circle.center, circle.radius) == ((2.0, 1.0), 0.2)
    assert "scanned, at the end" in labels(figure)
