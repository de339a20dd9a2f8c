"""How the demonstration went: its figures, and the files that it leaves in its folder."""

import json
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import chain, pairwise
from math import degrees
from pathlib import Path
from typing import Final

from cattrs.preconf.json import make_converter
from rich.console import Console
from rich.table import Table

from adapters.mal import TypedAttribute
from adapters.mrs.spec import Stage
from executive.commands import Stop, TakePicture, Waypoint
from executive.settings import config_folder
from executive.values.geometry import Point, Pose, wrap_rad
from executive.values.reasons import Reason
from sim.demo.mission import LOG, Played
from sim.demo.participants import Participants
from sim.demo.script import Ending, Link, Script
from sim.demo.session import Life, Session, Told
from sim.demo.timeline import draw_timeline, timeline_of, waited
from sim.drawing import DriveMap, draw_map, thinned, write_drawing
from sim.processes.recorder import PoseSample, RoverRecorder, told
from sim.rover import World, load_world
from trees import as_svg as tree_as_svg

LATE: Final = (Reason.ODOMETRY_STALE.value, Reason.ODOMETRY_JUMPED.value)
TOO_SLOW: Final = (
    "Odometry was late: the machine may be too slow, or busy. End what else runs, and try again."
)

Files = Iterator[tuple[tuple[Path, ...], str]]


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


def measure(
    heard: RoverRecorder, lives: Sequence[Life], last: Waypoint, speed: float = 1.0
) -> Figures:
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
    heard: RoverRecorder,
    lives: Sequence[Life],
    script: Script,
    figures: Figures,
) -> tuple[Path, Path]:
    """Write the map of the drive as SVG and as PNG."""
    views = [_at(heard.driven, life) for life in _executed(lives, TakePicture)]
    figure = draw_map(
        DriveMap(
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


def write_reports(folder: Path, reports: Mapping[Link, Sequence[Told]]) -> Path:
    """Write what was told by each link as JSON, one a line, names instead of numbers."""
    converter = make_converter()
    converter.register_unstructure_hook_func(
        lambda kind: isinstance(kind, type) and issubclass(kind, Enum), lambda value: value.name
    )
    converter.register_unstructure_hook(TypedAttribute, lambda typed: typed.value)
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


def _at(sightings: Sequence[PoseSample], life: Life) -> PoseSample:
    """Return where the rover was when a command ended."""
    ended_s = life.ended.aboard_utc_s if life.ended else 0.0
    return min(sightings, key=lambda sighting: abs(sighting.utc_s - ended_s))


def _camera(sighting: PoseSample) -> Pose:
    pose = sighting.pose
    return Pose(pose.x_m, pose.y_m, heading_rad=pose.heading_rad + sighting.pan_rad)


def tell(
    played: Sequence[Played], participants: Participants, folder: Path, console: Console
) -> bool:
    """Write the files, print the figures, and return whether all went as the scripts say."""
    files = Table(box=None, show_header=False, pad_edge=False)
    for each in played:
        lives, script = each.session.lives, each.participant.script
        figures = measure(each.heard, lives, script.route[-1], each.participant.rover.speed)
        console.print("")
        if len(played) > 1:
            console.print(script.asset, style="bold")
        console.print(_summary(each, figures))
        for paths, meaning in _write(each, figures):
            _add(files, folder, paths, meaning)
    for paths, meaning in _write_all(played, participants, folder):
        _add(files, folder, paths, meaning)
    console.print("")
    console.print(f"Files in {folder}", style="bold")
    console.print(files)
    unexpected = [life for each in played for life in each.session.lives if not life.as_expected]
    for life in unexpected:
        console.print(f"{life.spelled} should have ended {life.step.expected.name}", style="red")
    if unexpected and any(late(each.session) for each in played):
        console.print(TOO_SLOW, style="red")
    return not unexpected


def late(session: Session) -> bool:
    """Return whether the rover stood because its odometry did not come in time."""
    reports = chain.from_iterable(session.reports.values())
    return any(told.notification.code in LATE for told in reports)


def _add(files: Table, folder: Path, paths: Sequence[Path], meaning: str) -> None:
    files.add_row(", ".join(str(path.relative_to(folder)) for path in paths), meaning)


def _summary(played: Played, figures: Figures) -> Table:
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(style="bold")
    table.add_column()
    table.add_row(
        "true error at the last waypoint",
        f"{100 * figures.error_m:.1f} cm, {degrees(figures.error_rad):.1f}°"
        f"   (odometry is {100 * figures.drift_m:.1f} cm off)",
    )
    table.add_row("driven", f"{figures.driven_m:.1f} m in {figures.took_s:.1f} s")
    if played.heard.moved_after_s is not None:
        table.add_row("first motion", f"{told(played.heard.moved_after_s)} after the start")
    if Link.RELAY in played.participant.script.links:
        for name, figure in waited(played.session):
            table.add_row(name, figure)
    for row in by_both(played.session):
        table.add_row(*row)
    return table


def by_both(session: Session) -> Iterator[tuple[str, str]]:
    """Yield, for each command that went by both links, how often the rover began with it."""
    lives, reports = session.lives, session.reports.values()
    for life in lives:
        identity = life.command.identity
        links = {each.step.link for each in lives if each.command.identity == identity}
        if life.step.repeats and len(links) > 1:
            begun = max(_begun(by_link, identity.command_id) for by_link in reports)
            times = "once" if begun == 1 else f"{begun} times"
            yield "sent by both links", f"{life.spelled}, carried out {times}"


def _begun(reports: Sequence[Told], command_id: int) -> int:
    """Return how often a rover began with a command; a report may have come twice."""
    told = (each.notification for each in reports)
    started = (each for each in told if each.stage is Stage.STARTED)
    return len({each.sequence for each in started if each.commandId == command_id})


def _write(played: Played, figures: Figures) -> Files:
    """Write each file of a rover, and yield it with what it is."""
    participant, session, heard = played.participant, played.session, played.heard
    script, folder = participant.script, participant.folder
    world = load_world(config_folder() / "worlds" / f"{script.world}.yaml")
    drawn = write_map(folder, world, heard, session.lives, script, figures)
    yield drawn, "the drive: planned, driven by odometry, true"
    pictures = sorted((participant.rover.aboard / "files/pictures").glob("*.jpg"))
    if pictures:
        picture = Path(shutil.copyfile(pictures[0], folder / "picture.jpg"))
        yield (picture,), "what the camera saw"
    if heard.busiest is not None:
        tree = folder / "tree.svg"
        title = f"{heard.busiest.mode}: {heard.busiest.why}"
        tree.write_text(tree_as_svg(heard.busiest.nodes, title), encoding="utf-8")
        yield (tree,), "the behaviour tree at its busiest"
    reports = write_reports(folder, session.reports)
    yield (reports,), "every report that came down, as JSON"
    yield (participant.rover.aboard,), "the executive's own folder: ledger and files"


def _write_all(played: Sequence[Played], participants: Participants, folder: Path) -> Files:
    """Write each file of all rovers together, and yield it with what it is."""
    if participants.orbiter is not None:
        timeline = draw_timeline(timeline_of(played, participants.orbiter))
        drawn = write_drawing(folder, "timeline", timeline)
        yield drawn, "each command between ground, orbiter and rover"
        yield (participants.orbiter.data,), "the orbiter's own folder: bundles and records"
    console = folder / "console"
    if console.exists():
        yield (console, folder / "console.log"), "what the operations console kept, and its log"
    yield (*participants.processes.logs, folder / LOG), "what the processes logged"
