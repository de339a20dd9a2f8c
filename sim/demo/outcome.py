"""Tells how the demonstration went, and writes its files."""

from collections.abc import Iterator
from math import degrees
from pathlib import Path

from rich.console import Console
from rich.table import Table

from executive.settings import config_folder
from sim.demo import souvenirs
from sim.demo.mission import LOG, Played
from sim.demo.souvenirs import Figures
from sim.processes.deployment import Deployment
from sim.processes.uptime import told
from sim.world import load_world


def tell(played: Played, rover: Deployment, folder: Path, console: Console) -> bool:
    """Write the files, print the figures, and return whether all went as the script says."""
    figures = souvenirs.measure(played.heard, played.session.lives, played.script.route[-1])
    console.print("")
    console.print(_summary(figures, played.heard.moved_after_s))
    files = Table(box=None, show_header=False, pad_edge=False)
    for paths, meaning in _write(played, rover, folder, figures):
        files.add_row(", ".join(str(path.relative_to(folder)) for path in paths), meaning)
    console.print("")
    console.print(f"Files in {folder}", style="bold")
    console.print(files)
    strays = [life for life in played.session.lives if not life.as_expected]
    for life in strays:
        console.print(f"{life.spelled} should have ended {life.step.expected.name}", style="red")
    return not strays


def _summary(figures: Figures, moved_after_s: float | None) -> Table:
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(style="bold")
    table.add_column()
    table.add_row(
        "true error at the last waypoint",
        f"{100 * figures.error_m:.1f} cm, {degrees(figures.error_rad):.1f}°"
        f"   (odometry is {100 * figures.drift_m:.1f} cm off)",
    )
    table.add_row("driven", f"{figures.driven_m:.1f} m in {figures.took_s:.1f} s")
    if moved_after_s is not None:
        table.add_row("first motion", f"{told(moved_after_s)} after the start")
    return table


def _write(
    played: Played, rover: Deployment, folder: Path, figures: Figures
) -> Iterator[tuple[tuple[Path, ...], str]]:
    """Write each file, and yield it with what it is."""
    script, session, heard = played.script, played.session, played.heard
    world = load_world(config_folder() / "worlds" / f"{script.world}.yaml")
    drawn = souvenirs.write_map(folder, world, heard, session.lives, script, figures)
    yield drawn, "the drive: planned, driven by odometry, true"
    picture = souvenirs.write_picture(folder, rover.aboard)
    if picture is not None:
        yield (picture,), "what the camera saw"
    if heard.busiest is not None:
        tree = souvenirs.write_tree(folder, heard.busiest)
        yield (tree,), "the behaviour tree at its busiest"
    reports = souvenirs.write_reports(folder, session.reports)
    yield (reports,), "every report that came down, as JSON"
    yield (*rover.logs, folder / LOG), "what the processes logged"
    yield (rover.aboard,), "the executive's own folder: ledger and files"
