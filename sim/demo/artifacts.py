"""The files that a demonstration leaves in its folder, and the figures of its drive."""

import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise
from math import degrees
from pathlib import Path

from cattrs.preconf.json import make_converter

from adapters.mal import Typed
from executive.commands import Stop, TakePicture, Waypoint
from executive.geometry import Point, Pose, wrap_rad
from sim.demo.drawing import write_drawing
from sim.demo.life import Life, Told
from sim.demo.map import Drive, draw_map, thinned
from sim.demo.script import Ending, Link, Script
from sim.processes.recorder import Recorder, Sighting
from sim.rover import World
from trees import Snapshot
from trees import as_svg as tree_as_svg


@dataclass(frozen=True, slots=True)
class Figures:
    """How the drive went.

    Attributes:
        error_m, error_rad: from the last waypoint to where the rover really stands.
        drift_m: from where odometry believes that it stands to where it does.
    """

    driven_m: float
    took_s: float
    error_m: float
    error_rad: float
    drift_m: float


def measure(heard: Recorder, lives: Sequence[Life], last: Waypoint, speed: float = 1.0) -> Figures:
    """Return the figures of a drive that ended at a waypoint."""
    true, believed = heard.true[-1].pose, heard.driven[-1].pose
    corners = thinned([sighting.pose.point for sighting in heard.driven])
    ends = [life.ended.aboard_utc_s for life in lives if life.ended is not None]
    heading_rad = true.heading_rad if last.heading_rad is None else last.heading_rad
    return Figures(
        driven_m=sum(start.distance_m(end) for start, end in pairwise(corners)),
        took_s=speed * (max(ends) - lives[0].sent_utc_s),
        error_m=true.point.distance_m(Point(last.x_m, last.y_m)),
        error_rad=abs(wrap_rad(true.heading_rad - heading_rad)),
        drift_m=true.point.distance_m(believed.point),
    )


def write_map(
    folder: Path,
    world: World,
    heard: Recorder,
    lives: Sequence[Life],
    script: Script,
    figures: Figures,
) -> tuple[Path, Path]:
    """Write the map of the drive as SVG and as PNG."""
    views = [_at(heard.driven, life) for life in _executed(lives, TakePicture)]
    figure = draw_map(
        Drive(
            title=f"Drive of {script.title}, world “{world.name}”",
            world=world,
            planned=script.route,
            scale=script.scale,
            driven=tuple(sighting.pose for sighting in heard.driven),
            true=tuple(sighting.pose for sighting in heard.true),
            stops=tuple(_at(heard.driven, life).pose for life in _executed(lives, Stop)),
            views=tuple(_camera(sighting) for sighting in views),
            figures=(
                f"driven {figures.driven_m:.1f} m in {figures.took_s:.0f} s",
                f"true error at waypoint {len(script.route)}:",
                f"{100 * figures.error_m:.1f} cm, {degrees(figures.error_rad):.1f}°",
            ),
        )
    )
    return write_drawing(folder, "map", figure)


def write_picture(folder: Path, aboard: Path) -> Path | None:
    """Copy the picture that the executive took; return where, or None where there is none."""
    pictures = sorted((aboard / "files/pictures").glob("*.jpg"))
    return Path(shutil.copyfile(pictures[0], folder / "picture.jpg")) if pictures else None


def write_tree(folder: Path, snapshot: Snapshot) -> Path:
    """Draw a snapshot of the tree."""
    path = folder / "tree.svg"
    title = f"{snapshot.mode}: {snapshot.why}"
    path.write_text(tree_as_svg(snapshot.nodes, title), encoding="utf-8")
    return path


def write_reports(folder: Path, reports: Mapping[Link, Sequence[Told]]) -> Path:
    """Write what was told by each link as JSON, one a line, names instead of numbers."""
    converter = make_converter()
    converter.register_unstructure_hook_func(
        lambda kind: isinstance(kind, type) and issubclass(kind, Enum), lambda value: value.name
    )
    converter.register_unstructure_hook(Typed, lambda typed: typed.value)
    path = folder / "reports.jsonl"
    lines = [
        json.dumps(
            {
                "link": link.value,
                "told_utc_s": round(report.utc_s, 3),
                **converter.unstructure(report.notification),
            }
        )
        for link, told in reports.items()
        for report in told
    ]
    path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
    return path


def _executed(lives: Sequence[Life], kind: type) -> list[Life]:
    return [
        life
        for life in lives
        if isinstance(life.command.request, kind) and life.ending is Ending.EXECUTED
    ]


def _at(sightings: Sequence[Sighting], life: Life) -> Sighting:
    """Return where the rover was when a command ended."""
    ended_s = life.ended.aboard_utc_s if life.ended else 0.0
    return min(sightings, key=lambda sighting: abs(sighting.utc_s - ended_s))


def _camera(sighting: Sighting) -> Pose:
    pose = sighting.pose
    return Pose(pose.x_m, pose.y_m, heading_rad=pose.heading_rad + sighting.pan_rad)
