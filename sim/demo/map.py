"""The map of a drive: what was planned, what odometry believed, and what was true."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from executive.commands import Waypoint
from executive.geometry import Point, Pose
from sim.demo import marks
from sim.demo.drawing import Drawing, Label, Polyline, Shape, polygon
from sim.demo.sheet import FAINT, INK, LEFT, PIXELS_PER_M, ROCK, ROCK_LINE, TOP, Sheet
from sim.rover import World

STEP_M: Final = 0.02
"""A track has a corner each so much."""
VIEW_M: Final = 2.8
"""As far as a view is drawn."""
DRIVEN, TRUE = "#0067a5", "#f5b04d"
_ROW = 30


@dataclass(frozen=True, slots=True)
class Drive:
    """What a map shows.

    Attributes:
        planned: the waypoints in their order, after the start.
        driven: where odometry said that base_link was.
        true: where it really was.
        stops: where it was stopped on the way.
        views: where a picture was taken; the heading is the camera's.
        figures: lines of text beside the map.
        scale: the rover's size beside the Jackal's.
    """

    title: str
    world: World
    planned: tuple[Waypoint, ...]
    driven: tuple[Pose, ...]
    true: tuple[Pose, ...]
    stops: tuple[Pose, ...]
    views: tuple[Pose, ...]
    figures: tuple[str, ...]
    scale: float = 1.0


def draw_map(drive: Drive) -> Drawing:
    """Return the map. Both tracks need at least one pose."""
    start = drive.world.start_pose.point
    goals = [Point(place.x_m, place.y_m) for place in drive.planned]
    tracks = [pose.point for pose in (*drive.driven, *drive.true)]
    seen = [pose.ahead(VIEW_M) for pose in drive.views]
    sheet = Sheet(drive.world, [start, *goals, *tracks, *seen])
    drawing = sheet.drawing
    for pose in drive.views:
        drawing.add(*marks.view(sheet.spot(pose.point), pose.heading_rad, VIEW_M * PIXELS_PER_M))
    drawing.add(_line(sheet, drive.true, TRUE, 6))
    drawing.add(Polyline(tuple(map(sheet.spot, (start, *goals))), marks.PLANNED, 1.2, dash=(5, 5)))
    drawing.add(_line(sheet, drive.driven, DRIVEN, 2))
    for pose, colour in ((drive.true[0], FAINT), (drive.true[-1], INK)):
        size = PIXELS_PER_M * drive.scale
        drawing.add(*marks.rover(sheet.spot(pose.point), pose.heading_rad, size, colour))
    for number, place in enumerate(drive.planned, 1):
        spot = sheet.spot(Point(place.x_m, place.y_m))
        drawing.add(*marks.waypoint(spot, str(number), place.heading_rad))
    for pose in drive.stops:
        drawing.add(*marks.stop(sheet.spot(pose.point)))
    sheet.frame()
    drawing.add(Label(drive.title, (LEFT, TOP - 20), 18, bold=True))
    _add_legend(drawing, sheet.right + 24, drive)
    return drawing


def _line(sheet: Sheet, track: Sequence[Pose], colour: str, width: float) -> Polyline:
    places = thinned([pose.point for pose in track])
    return Polyline(tuple(map(sheet.spot, (*places, track[-1].point))), colour, width)


def thinned(places: Sequence[Point]) -> list[Point]:
    """Return places at least `STEP_M` apart, so that noise at rest is no way driven."""
    kept = [places[0]]
    for place in places:
        if place.distance_m(kept[-1]) >= STEP_M:
            kept.append(place)
    return kept


def _add_legend(drawing: Drawing, x: float, drive: Drive) -> None:
    middle, text = x + 20, x + 54
    y = TOP + 14.0

    def row(words: str, *shapes: Shape) -> None:
        nonlocal y
        drawing.add(*shapes, Label(words, (text, y + 4)))
        y += _ROW

    row("planned waypoint, heading", *marks.waypoint((x + 9, y), "1", 0.0))
    row("planned line", Polyline(((x, y), (x + 40, y)), marks.PLANNED, 1.2, dash=(5, 5)))
    row("driven, by odometry", Polyline(((x, y), (x + 40, y)), DRIVEN, 2))
    row("true", Polyline(((x, y), (x + 40, y)), TRUE, 6))
    if drive.stops:
        row("stopped here", *marks.stop((middle, y)))
    if drive.views:
        row("picture taken, view", *marks.view((x + 6, y), 0.0, 32))
    y += 6
    row("rover at the end", *marks.rover((middle, y), 0.0, 50, INK))
    row("rover at the start", *marks.rover((middle, y), 0.0, 50, FAINT))
    rock = ((x + 8, y + 6), (x + 12, y - 7), (x + 26, y - 9), (x + 33, y + 2), (x + 22, y + 9))
    row("rock", polygon(*rock, fill=ROCK, stroke=ROCK_LINE, width=1.5))
    row("1 cm of height", Polyline(((x, y), (x + 40, y)), "#d9c6ac", 1.2))
    y += 12
    for words in drive.figures:
        drawing.add(Label(words, (x, y)))
        y += 20
