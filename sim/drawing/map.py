"""`draw_map`: the map of a drive, with planned path, odometry and true path."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import ceil, cos, degrees, dist, pi, sin
from random import Random
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, Polygon, Wedge
from matplotlib.path import Path as Shape
from matplotlib.ticker import MultipleLocator

from executive.commands import Waypoint
from executive.obstacles.zones import KeepIn, KeepOut, ScannedObstacle, Zones
from executive.values.geometry import Point, Pose
from sim.drawing.style import DONE, DPI, FAINT, INK, MOTION, POINT, WRONG, styled_figure
from sim.rover import CELL_M, FeatureKind, Outline, Rock, World, make_terrain

STEP_M: Final = 0.02
"""Distance of the points of a drawn track."""
PIXELS_PER_M: Final = 100
"""Scale for a rover of the Jackal's size, as all lengths below: maps scale with the rover."""
SMALL_ROVER: Final = 0.5
"""Size of a MOCUP relative to a Jackal, for drawing."""
HALF_LENGTH_M: Final = 0.254
HALF_WIDTH_M: Final = 0.215
VIEW_M: Final = 2.8
"""Drawn range of a camera view."""
ARROW_M: Final = 0.32
MARGIN_M: Final = 0.9
MIN_WINDOW_M: Final = 4.2
"""Minimum side of the window, with space for the legend beside it."""
CLEAR_M: Final = 0.2
STOP_MARK_OFFSET_M: Final = 0.35
"""Offset of a stop's mark if the stop is nearer than `CLEAR_M` to a waypoint."""

HALF_VIEW_DEG: Final = 34.8
"""Half of the camera's horizontal field of view: 55° vertically in a 4:3 picture."""
CONTOUR_M: Final = 0.01
TRUE, PLANNED, SOIL, SOIL_LINE = "#f5b04d", "#333333", "#f7f1e8", "#e3d4c0"
ROCK, ROCK_LINE = "#b8ab9d", "#80746a"
_DOTTED: Final = (0, (4, 4))
_FEATURES: Final[dict[FeatureKind, dict[str, Any]]] = {
    FeatureKind.SLOPE: {"facecolor": "#efe2cb", "edgecolor": "#c9b48f", "linestyle": _DOTTED},
    FeatureKind.PATCH: {"facecolor": "#d6e6ee", "edgecolor": "#9bb9c9"},
    FeatureKind.DITCH: {"facecolor": "#a08f7a", "edgecolor": "#5f5344", "hatch": "////"},
    FeatureKind.STEP: {"facecolor": "#d9d4cc", "edgecolor": "#6f6a62"},
    FeatureKind.WALL: {"facecolor": "#5c5750", "edgecolor": "#3a3732"},
}
"""Styles of terrain features, the lowest layer first."""
_KEEP_IN: Final[dict[str, Any]] = {
    "fill": False,
    "edgecolor": DONE,
    "linewidth": 2.0,
    "linestyle": (0, (8, 3)),
}
_KEEP_OUT: Final[dict[str, Any]] = {
    "facecolor": "none",
    "edgecolor": WRONG,
    "linewidth": 1.5,
    "hatch": "///",
}
_KNOWN_ROCK: Final[dict[str, Any]] = {
    "fill": False,
    "edgecolor": WRONG,
    "linewidth": 1.5,
    "linestyle": (0, (2, 2)),
}
_SEEN: Final[dict[str, Any]] = {"fill": False, "edgecolor": MOTION, "linewidth": 1.0}
_LEFT, _TOP, _RIGHT, _BOTTOM = 62, 52, 262, 56
_HULL: Final = ((1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0))
_FRONT: Final = ((0.95, 0.0), (0.5, 0.45), (0.5, -0.45))
"""Corners of a rover of half length and half width 1, and of the arrow that marks its front."""


@dataclass(frozen=True, slots=True)
class Incident:
    """A fault or failure, with the pose of the rover."""

    pose: Pose
    text: str


@dataclass(frozen=True, slots=True)
class DriveMap:
    """Data of a map.

    Attributes:
        planned: waypoints in their order, after the start.
        driven: poses of base_link by odometry; empty without odometry.
        true: true poses.
        stops: poses where the rover was stopped.
        views: poses where a picture was taken, with the heading of the camera.
        incidents: faults and failures.
        zones: zones and known rocks of the settings.
        scanned: obstacles scanned by the laser up to the end.
        figures: lines of text beside the map.
        scale: size of the rover relative to the Jackal.
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
    incidents: tuple[Incident, ...] = ()
    zones: Zones = field(default_factory=Zones)
    scanned: tuple[ScannedObstacle, ...] = ()


def draw_map(drive: DriveMap) -> Figure:
    """Return the map. The true track needs at least one pose."""
    scale = drive.scale
    start = drive.world.start_pose.point
    goals = [Point(waypoint.x_m, waypoint.y_m) for waypoint in drive.planned]
    tracks = [pose.point for pose in (*drive.driven, *drive.true)]
    seen = [pose.ahead(scale * VIEW_M) for pose in drive.views]
    points = [start, *goals, *tracks, *seen]
    west_m, east_m = _span([point.x_m for point in points], scale)
    south_m, north_m = _span([point.y_m for point in points], scale)
    pixels_per_m = PIXELS_PER_M / scale
    across, upright = pixels_per_m * (east_m - west_m), pixels_per_m * (north_m - south_m)
    width, height = _LEFT + across + _RIGHT, _TOP + upright + _BOTTOM
    with styled_figure(width, height, drive.title) as figure:
        box = (_LEFT / width, _BOTTOM / height, across / width, upright / height)
        axes = figure.add_axes(box, facecolor=SOIL, xlabel="x in m", ylabel="y in m")
        axes.set(xlim=(west_m, east_m), ylim=(south_m, north_m))
        axes.xaxis.set_major_locator(MultipleLocator(scale))
        axes.yaxis.set_major_locator(MultipleLocator(scale))
        _draw_ground(axes, drive.world)
        draw_zones(axes, drive.zones)
        for each in drive.scanned:
            axes.add_patch(Circle((each.x_m, each.y_m), each.radius_m, zorder=2.3, **_SEEN))
        for pose in drive.views:
            _draw_view(axes, pose, scale)
        driven, true = (
            thinned([pose.point for pose in track]) for track in (drive.driven, drive.true)
        )
        _draw_line(axes, true, color=TRUE, linewidth=6 * POINT)
        _draw_line(axes, [start, *goals], color=PLANNED, linewidth=POINT, linestyle=_DOTTED)
        _draw_line(axes, driven, color=MOTION, linewidth=2 * POINT)
        for pose, colour in ((drive.true[0], FAINT), (drive.true[-1], INK)):
            draw_rover(axes, pose, scale, colour)
        for number, waypoint in enumerate(drive.planned, 1):
            _draw_waypoint(axes, waypoint, scale, number)
        for pose in drive.stops:
            _draw_stop(axes, pose, scale, goals)
        draw_incidents(axes, drive.incidents)
        _add_legend(figure, axes, drive)
        _add_scale(figure, 1 - (_RIGHT - 20) / width, box[1], pixels_per_m / width)
    return figure


def thinned(points: Sequence[Point]) -> list[Point]:
    """Return points at least `STEP_M` apart, so that noise at rest adds no distance."""
    selected = list(points[:1])
    for point in points:
        if point.distance_m(selected[-1]) >= STEP_M:
            selected.append(point)
    return selected


def _span(positions_m: Sequence[float], scale: float) -> tuple[float, float]:
    """Return the bounds of a window that contains all positions, in m."""
    low_m, high_m = min(positions_m) - scale * MARGIN_M, max(positions_m) + scale * MARGIN_M
    more_m = max(0.0, scale * MIN_WINDOW_M - (high_m - low_m)) / 2
    return low_m - more_m, high_m + more_m


def _draw_ground(axes: Axes, world: World) -> None:
    """Draw contour lines, features and the rocks in the window."""
    (west_m, east_m), (south_m, north_m) = axes.get_xlim(), axes.get_ylim()
    if world.ground.amplitude_m > 0:
        terrain = make_terrain(world.ground)
        along_m = np.linspace(-0.5, 0.5, terrain.heights_m.shape[0]) * terrain.size_m
        columns = (along_m > west_m - CELL_M) & (along_m < east_m + CELL_M)
        rows = (along_m > south_m - CELL_M) & (along_m < north_m + CELL_M)
        levels = CONTOUR_M * np.arange(1, ceil(world.ground.amplitude_m / CONTOUR_M))
        heights_m = terrain.heights_m[np.ix_(rows, columns)]
        if min(heights_m.shape) > 1:
            style: Any = {"colors": SOIL_LINE, "linewidths": 0.9, "zorder": 0.5}
            axes.contour(along_m[columns], along_m[rows], heights_m, levels, **style)
    order = list(_FEATURES)
    for feature in sorted(_seen(axes, world), key=lambda each: order.index(each.kind)):
        corners = [(corner.x_m, corner.y_m) for corner in feature.corners]
        axes.add_patch(Polygon(corners, zorder=0.7, **_FEATURES[feature.kind]))
        if feature.kind is not FeatureKind.WALL:
            corner_m = (min(x_m for x_m, _ in corners), max(y_m for _, y_m in corners))
            layout: Any = {"textcoords": "offset points", "va": "top", "annotation_clip": True}
            small: Any = {"fontsize": 10 * POINT, "color": INK, "zorder": 0.8}
            axes.annotate(feature.text, corner_m, (3, -3), **layout, **small)
    for number, rock in enumerate(world.all_rocks):
        reach_m = rock.radius_m
        if west_m - reach_m < rock.x_m < east_m + reach_m and (
            south_m - reach_m < rock.y_m < north_m + reach_m
        ):
            outline = _outline(rock, Random(number))
            axes.add_patch(Polygon(outline, facecolor=ROCK, edgecolor=ROCK_LINE, linewidth=1.0))


def draw_zones(axes: Axes, zones: Zones) -> None:
    """Draw zones and known rocks with their names."""
    low_m, high_m = axes.get_ylim()[0], axes.get_xlim()[1]
    polygons: list[tuple[KeepIn | KeepOut, dict[str, Any]]] = [
        (zone, _KEEP_IN) for zone in zones.keep_in
    ]
    polygons += [(zone, _KEEP_OUT) for zone in zones.keep_out]
    small: Any = {"fontsize": 10 * POINT, "zorder": 2.5, "va": "bottom", "clip_on": True}
    small["bbox"] = {"facecolor": SOIL, "alpha": 0.8, "linewidth": 0, "pad": 0.5}
    for zone, style in polygons:
        axes.add_patch(Polygon(zone.corners_m, zorder=2.4, **style))
        corner = min(zone.corners_m, key=lambda each: each[1])
        left = min(max(corner[0], axes.get_xlim()[0]), high_m), max(corner[1], low_m)
        axes.text(left[0] + 0.05, left[1] + 0.05, zone.name, color=style["edgecolor"], **small)
    for rock in zones.rocks:
        axes.add_patch(Circle((rock.x_m, rock.y_m), rock.radius_m, zorder=2.4, **_KNOWN_ROCK))
        top_m = rock.y_m + rock.radius_m
        axes.text(rock.x_m, top_m + 0.03, rock.name, color=WRONG, ha="center", **small)


def _seen(axes: Axes, world: World) -> list[Outline]:
    """Return the features that lie at least partly in the window."""
    (west_m, east_m), (south_m, north_m) = axes.get_xlim(), axes.get_ylim()
    return [
        outline
        for outline in world.outlines
        if min(corner.x_m for corner in outline.corners) < east_m
        and max(corner.x_m for corner in outline.corners) > west_m
        and min(corner.y_m for corner in outline.corners) < north_m
        and max(corner.y_m for corner in outline.corners) > south_m
    ]


def _outline(rock: Rock, random: Random) -> list[tuple[float, float]]:
    """Return the corners of an irregular polygon for a rock."""
    corners = max(7, min(13, round(30 * rock.radius_m)))
    spots = []
    for corner in range(corners):
        angle_rad = 2 * pi * (corner + random.uniform(-0.25, 0.25)) / corners
        radius_m = rock.radius_m * random.uniform(0.86, 1.0)
        spots.append((rock.x_m + radius_m * cos(angle_rad), rock.y_m + radius_m * sin(angle_rad)))
    return spots


def _draw_line(axes: Axes, points: Sequence[Point], **style: Any) -> None:
    axes.plot([point.x_m for point in points], [point.y_m for point in points], **style)


def _draw_view(axes: Axes, pose: Pose, scale: float) -> None:
    """Draw the field of view of a camera as an open fan."""
    middle_deg = degrees(pose.heading_rad)
    rim = (middle_deg - HALF_VIEW_DEG, middle_deg + HALF_VIEW_DEG)
    style: Any = {"fill": False, "edgecolor": DONE, "linewidth": 1.3, "linestyle": _DOTTED}
    axes.add_patch(Wedge((pose.x_m, pose.y_m), scale * VIEW_M, *rim, **style))
    axes.plot(pose.x_m, pose.y_m, "o", color=DONE, markersize=7, markeredgecolor="white")


def draw_rover(axes: Axes, pose: Pose, scale: float, colour: str) -> None:
    """Draw the outline of the rover with a mark at its front."""
    half_m = (scale * HALF_LENGTH_M, scale * HALF_WIDTH_M)
    for corners, style in ((_HULL, {"fill": False, "linewidth": 1.5}), (_FRONT, {"linewidth": 0})):
        spots = [_from(pose, half_m[0] * ahead, half_m[1] * left) for ahead, left in corners]
        axes.add_patch(Polygon(spots, color=colour, **style))


def _draw_waypoint(axes: Axes, waypoint: Waypoint, scale: float, number: int) -> None:
    """Draw a numbered disc, with an arrow for a commanded heading."""
    if waypoint.heading_rad is not None:
        tip = Pose(waypoint.x_m, waypoint.y_m, heading_rad=waypoint.heading_rad).ahead(
            scale * ARROW_M
        )
        arrow = {
            "arrowstyle": "-|>",
            "color": PLANNED,
            "linewidth": 1.4,
            "shrinkA": 0,
            "shrinkB": 0,
        }
        axes.annotate(
            "", (tip.x_m, tip.y_m), (waypoint.x_m, waypoint.y_m), arrowprops=arrow, zorder=3
        )
    axes.plot(waypoint.x_m, waypoint.y_m, zorder=3, **_DISC)
    centred: Any = {"ha": "center", "va": "center_baseline", "fontweight": "bold"}
    axes.text(waypoint.x_m, waypoint.y_m, str(number), fontsize=11 * POINT, zorder=4, **centred)


def _draw_stop(axes: Axes, pose: Pose, scale: float, waypoints: Sequence[Point]) -> None:
    """Draw a stop sign at the pose of a stop, or with an offset if a waypoint is near."""
    near = [point for point in waypoints if pose.point.distance_m(point) < scale * CLEAR_M]
    here = (pose.x_m, pose.y_m)
    sign = _from(pose, 0.0, scale * STOP_MARK_OFFSET_M) if near else here
    if near:
        axes.plot(*zip(here, sign, strict=True), color=WRONG, linewidth=1.0)
        axes.plot(*here, "o", color=WRONG, markersize=4, zorder=5)
    axes.plot(*sign, label="stop", zorder=5, **_STOP)


def draw_incidents(axes: Axes, incidents: Sequence[Incident]) -> None:
    """Draw a mark for each incident; texts of incidents at one position are listed beside it."""
    (west_m, east_m), low_m = axes.get_xlim(), axes.get_ylim()[0]
    below: dict[tuple[float, float], int] = {}
    for incident in incidents:
        here = (incident.pose.x_m, incident.pose.y_m)
        near = next((spot for spot in below if dist(spot, here) < CLEAR_M), here)
        row = below[near] = below.get(near, -1) + 1
        left = near[0] > (west_m + east_m) / 2
        up = near[1] < low_m + MARGIN_M
        axes.plot(*here, zorder=5, **_INCIDENT)
        axes.annotate(
            incident.text,
            near,
            xytext=(-9 if left else 9, (9 + 9 * row) * (1 if up else -1)),
            textcoords="offset points",
            ha="right" if left else "left",
            va="center",
            color=WRONG,
            fontsize=11 * POINT,
            zorder=6,
            bbox={"facecolor": SOIL, "alpha": 0.7, "linewidth": 0, "pad": 0.5},
        )


def _from(pose: Pose, ahead_m: float, left_m: float) -> tuple[float, float]:
    """Return the position ahead and to the left of a pose, in m."""
    ahead = pose.ahead(ahead_m)
    left = Pose(ahead.x_m, ahead.y_m, heading_rad=pose.heading_rad + pi / 2).ahead(left_m)
    return left.x_m, left.y_m


_DISC: Final[dict[str, Any]] = {
    "marker": "o",
    "markersize": 13,
    "markerfacecolor": "white",
    "markeredgecolor": PLANNED,
    "linestyle": "none",
}
_STOP: Final[dict[str, Any]] = {
    "marker": (8, 0, 22.5),
    "markersize": 13,
    "color": WRONG,
    "markeredgecolor": "white",
    "linestyle": "none",
}


_INCIDENT: Final[dict[str, Any]] = {
    "marker": "X",
    "markersize": 9,
    "color": WRONG,
    "markeredgecolor": "white",
    "linestyle": "none",
}


def _add_legend(figure: Figure, axes: Axes, drive: DriveMap) -> None:
    def line(colour: str, width: float, **style: Any) -> Line2D:
        return Line2D([], [], color=colour, linewidth=width * POINT, **style)

    def mark(shape: Shape, colour: str, size: float) -> Line2D:
        return line(colour, 0, marker=shape, markersize=size, fillstyle="none", markeredgewidth=1.3)

    rim_rad = np.radians(np.linspace(-HALF_VIEW_DEG, HALF_VIEW_DEG, 7)).tolist()
    fan = Shape([(-0.5, 0), *((cos(turn) - 0.5, sin(turn)) for turn in rim_rad), (-0.5, 0)])
    arrow = Shape([(0, 0), (0.6, 0), (0.6, 0.2), (1, 0), (0.6, -0.2), (0.6, 0)])
    hull = Shape([*_HULL, _HULL[0], *_FRONT, _FRONT[0]], [1, 2, 2, 2, 79, 1, 2, 2, 79])
    stone = Shape([(-0.9, -0.5), (-0.6, 0.6), (0.3, 0.8), (0.9, 0.0), (0.2, -0.8), (-0.9, -0.5)])
    entries: list[tuple[str, Any]] = []
    if drive.planned:
        entries += [
            ("planned waypoint, heading", (mark(arrow, PLANNED, 29), Line2D([], [], **_DISC))),
            ("planned line", line(PLANNED, 1, linestyle=_DOTTED)),
        ]
    entries += [("driven, by odometry", line(MOTION, 2)), ("true", line(TRUE, 6))]
    if drive.stops:
        entries.append(("stopped here", Line2D([], [], **_STOP)))
    if drive.views:
        entries.append(("picture taken, view", mark(fan, DONE, 18)))
    if drive.incidents:
        entries.append(("fault or failure", Line2D([], [], **_INCIDENT)))
    entries += [
        ("rover at the end", mark(hull, INK, 14)),
        ("rover at the start", mark(hull, FAINT, 14)),
    ]
    if drive.world.all_rocks:
        rock = line(ROCK_LINE, 0, marker=stone, markersize=14, markerfacecolor=ROCK)
        entries.append(("rock", rock))
    entries += [
        (name, Patch(**style))
        for name, style, present in (
            ("keep-in zone", _KEEP_IN, drive.zones.keep_in),
            ("keep-out zone", _KEEP_OUT, drive.zones.keep_out),
            ("rock known to the rover", _KNOWN_ROCK, drive.zones.rocks),
            ("scanned, at the end", _SEEN, drive.scanned),
        )
        if present
    ]
    kinds = {outline.kind for outline in _seen(axes, drive.world)}
    entries += [(kind.value, Patch(**style)) for kind, style in _FEATURES.items() if kind in kinds]
    if drive.world.ground.amplitude_m > 0:
        entries.append(("1 cm of height", line(SOIL_LINE, 1.2)))
    left = 1 - (_RIGHT - 20) / (DPI * figure.get_figwidth())
    legend = figure.legend(
        [handle for _, handle in entries],
        [name for name, _ in entries],
        loc="upper left",
        bbox_to_anchor=(left, axes.get_position().y1),
        borderaxespad=0.0,
        borderpad=0.0,
        handlelength=4,
        labelspacing=1.2,
    )
    figure.draw_without_rendering()
    box = legend.get_window_extent().transformed(figure.transFigure.inverted())
    figure.text(left, box.y0 - 0.03, "\n".join(drive.figures), va="top", linespacing=1.5)


def _add_scale(figure: Figure, left: float, bottom: float, metre: float) -> None:
    """Draw a scale bar of one metre beside the map, where it covers no content."""
    ends = [left, left + metre]
    figure.add_artist(Line2D(ends, [bottom, bottom], color=INK, linewidth=1.5, marker="|"))
    figure.text(sum(ends) / 2, bottom, "1 m", ha="center", va="bottom")
