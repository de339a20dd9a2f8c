"""Tells how the demonstration went, and writes its files."""

from collections.abc import Iterator, Sequence
from itertools import chain
from math import degrees
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.table import Table

from adapters.mrs.spec import Stage
from executive.reasons import Reason
from executive.settings import config_folder
from sim.demo import artifacts
from sim.demo.artifacts import Figures
from sim.demo.drawing import write_drawing
from sim.demo.life import Told
from sim.demo.mission import LOG, Played
from sim.demo.participants import Participants
from sim.demo.script import Link
from sim.demo.session import Session
from sim.demo.timeline import draw_timeline, timeline_of, waited
from sim.processes.recorder import told
from sim.rover import load_world

LATE: Final = (Reason.ODOMETRY_STALE.value, Reason.ODOMETRY_JUMPED.value)
TOO_SLOW: Final = (
    "Odometry was late: the machine may be too slow, or busy. End what else runs, and try again."
)

Files = Iterator[tuple[tuple[Path, ...], str]]


def tell(
    played: Sequence[Played], participants: Participants, folder: Path, console: Console
) -> bool:
    """Write the files, print the figures, and return whether all went as the scripts say."""
    files = Table(box=None, show_header=False, pad_edge=False)
    for each in played:
        lives, script = each.session.lives, each.participant.script
        figures = artifacts.measure(
            each.heard, lives, script.route[-1], each.participant.rover.speed
        )
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
    strays = [life for each in played for life in each.session.lives if not life.as_expected]
    for life in strays:
        console.print(f"{life.spelled} should have ended {life.step.expected.name}", style="red")
    if strays and any(late(each.session) for each in played):
        console.print(TOO_SLOW, style="red")
    return not strays


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
    drawn = artifacts.write_map(folder, world, heard, session.lives, script, figures)
    yield drawn, "the drive: planned, driven by odometry, true"
    picture = artifacts.write_picture(folder, participant.rover.aboard)
    if picture is not None:
        yield (picture,), "what the camera saw"
    if heard.busiest is not None:
        tree = artifacts.write_tree(folder, heard.busiest)
        yield (tree,), "the behaviour tree at its busiest"
    reports = artifacts.write_reports(folder, session.reports)
    yield (reports,), "every report that came down, as JSON"
    yield (participant.rover.aboard,), "the executive's own folder: ledger and files"


def _write_all(played: Sequence[Played], participants: Participants, folder: Path) -> Files:
    """Write each file of all rovers together, and yield it with what it is."""
    if participants.orbiter is not None:
        timeline = draw_timeline(timeline_of(played, participants.orbiter))
        drawn = write_drawing(folder, "timeline", timeline)
        yield drawn, "each command between ground, orbiter and rover"
        yield (participants.orbiter.data,), "the orbiter's own folder: bundles and records"
    yield (*participants.processes.logs, folder / LOG), "what the processes logged"
