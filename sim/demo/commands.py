"""`rover demo`: a mission-control session against a simulated rover."""

import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

if TYPE_CHECKING:
    from rich.console import Console

    from sim.processes import OperationsConsole, RoverAddress
    from sim.scenario.model import RunMode, Scenario
    from sim.scenario.scene import Fleet

FAILED: Final = 1
LONGEST_S: Final = 180.0
"""What a demonstration takes at most."""
DEFAULT: Final = "jackal"
SHOWS: Final = {
    "jackal": ("jackal",),
    "mocup": ("mocup",),
    "relay": ("relay",),
    "assets": ("both_jackal", "both_mocup"),
}
"""The scenarios in config/demo that are played at once."""
NO_CONSOLE: Final = "a console in a browser needs the extra console: rover-executive[console]"
ENDS: Final = "\nWith --stay all goes on running afterwards."
ELSEWHERE: Final = "rover watch needs the same ROS_DOMAIN_ID there as here.\n"


@click.command()
@click.option("--stay", is_flag=True, help="Leave the processes running afterwards.")
@click.option("--no-play", is_flag=True, help="Play nothing: only start them, and stay.")
@click.option("--no-console", is_flag=True, help="Without the operations console.")
@click.option("--mocup", is_flag=True, help="With the small rover, whose brick moves by itself.")
@click.option(
    "--relay",
    is_flag=True,
    help="With the Jackal, through an orbiter that is in eclipse for a while.",
)
@click.option(
    "--assets",
    is_flag=True,
    help="With both rovers at once, each by the direct link and by the orbiter.",
)
@click.option("--seed", default=0, show_default=True, help="Of the simulation's sensor noise.")
@click.option(
    "--speed",
    type=click.FloatRange(0.1, 20.0),
    default=1.0,
    show_default=True,
    help="Simulated seconds per second; more than 3 take a fast machine.",
)
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder of what is written, new or empty.  [default: runs/TIME]",
)
def demo(
    stay: bool,
    no_play: bool,
    no_console: bool,
    mocup: bool,
    relay: bool,
    assets: bool,
    seed: int,
    speed: float,
    out: Path | None,
) -> None:
    """Play a mission-control session against simulated rovers.

    Simulation and executive are started as processes of their own. Mission control then plays a
    scenario of config/demo over the rover's socket: waypoints with headings, a stop in the middle
    of a drive and a resume, the camera, a picture, a command out of range and one sent twice. In
    the end come every command's life, the true error, a map of the drive, the picture, and the tree
    at its busiest.

    With --relay the commands go by an orbiter, rover-mops, which has no contact with the rover for
    a while; with --assets two rovers are commanded at once, by both links. A timeline shows when
    each command was where.

    Beside it rover-console serves browsers at the address that is printed. Played without --stay it
    keeps to itself: a free port, and a free ROS domain on this machine. With --stay the rover is
    where `rover command`, `rover status` and `rover watch` look for it.

    \b
    Examples:
      rover demo
      rover demo --stay
      rover demo --no-play
      rover demo --mocup
      rover demo --relay
      rover demo --assets
      rover demo --seed 7 --speed 2 --out drive

    \b
    Exit status: 0 all went as planned, 1 it did not, or a process died.
    """
    show = _show(mocup=mocup, relay=relay, assets=assets)
    if relay and speed != 1.0:
        raise click.UsageError("--speed does not work with --relay: contacts are planned in UTC")
    import asyncio
    from contextlib import ExitStack

    from adapters.process import require
    from sim.processes import (
        AddressError,
        ChildError,
        free_place,
        known_place,
        operations_console,
    )
    from sim.scenario.model import RunMode
    from sim.scenario.scene import fleet_of

    mode = RunMode.RELAY if relay else RunMode.DIRECT
    try:
        require("rclpy")
        with ExitStack() as running:
            place = known_place() if stay or no_play else running.enter_context(free_place())
            folder = _make_folder(out)
            scenarios = _scenarios(show, mode, seed, played=not no_play)
            several = len(scenarios) > 1
            folders = [folder / each.settings.asset if several else folder for each in scenarios]
            relayed = folder if relay or assets else None
            fleet = running.enter_context(
                fleet_of(scenarios, folders, place, relayed, speed, restart=True)
            )
            # While they start: these imports take as long as theirs.
            from sim.demo.display import make_console
            from sim.demo.outcome import show_outcome
            from sim.demo.session import play

            console = make_console()
            console.print("simulation and executive are starting", style="dim")
            operations = None
            if not no_console:
                uris = asyncio.run(_uris(fleet))
                operations = running.enter_context(operations_console(folder, uris))
                if operations is None:
                    console.print(NO_CONSOLE, markup=False)
            played = play(fleet, scenarios, folders, mode, console, operations, not no_play)
            as_planned = show_outcome(played, folder, console) if played else True
            if stay or no_play:
                _stay(fleet, place, console, operations)
            else:
                console.print(ENDS)
            if not as_planned:
                sys.exit(FAILED)
    except (ChildError, AddressError) as error:
        raise click.ClickException(str(error)) from error


def _scenarios(show: str, mode: "RunMode", seed: int, *, played: bool) -> "Sequence[Scenario]":
    """Return the scenarios of a demonstration, without their timeline if they are not played."""
    from executive.settings import config_folder
    from sim.scenario.reading import load_scenario

    paths = [config_folder() / "demo" / f"{name}.yaml" for name in SHOWS[show]]
    loaded = [replace(load_scenario(str(path), mode), seed=seed) for path in paths]
    return [
        replace(each, lasts_s=LONGEST_S) if played else replace(each, timeline=())
        for each in loaded
    ]


async def _uris(fleet: "Fleet") -> list[str]:
    """Wait until all rovers are served, and return where, by all links."""
    from sim.scenario.model import RunMode

    modes = [RunMode.DIRECT] if fleet.orbiter is None else [RunMode.DIRECT, RunMode.RELAY]
    return [await fleet.uri(rover, mode) for rover in fleet.rovers for mode in modes]


def _show(**asked: bool) -> str:
    """Return the one demonstration that is asked for."""
    chosen = [name for name, wanted in asked.items() if wanted]
    if len(chosen) > 1:
        options = " and ".join(f"--{name}" for name in chosen)
        raise click.UsageError(f"{options} are demonstrations of their own: choose one of them")
    return chosen[0] if chosen else DEFAULT


def _stay(
    fleet: "Fleet",
    place: "RoverAddress",
    console: "Console",
    operations: "OperationsConsole | None",
) -> None:
    """Leave the rovers running until Ctrl-C."""
    import asyncio

    from sim.demo.session import BROWSE

    console.print(_proposals(fleet, asyncio.run(_uris(fleet))))
    if operations is not None:
        console.print(f"{BROWSE}{asyncio.run(operations.address())}\n")
    if place.domain != 0:
        console.print(ELSEWHERE)
    console.print("Ctrl-C ends it.")
    processes = [fleet.processes, *([operations] if operations else [])]
    try:
        while True:
            for group in processes:
                group.check()
            time.sleep(0.2)
    except KeyboardInterrupt:
        console.print("ending")


def _proposals(fleet: "Fleet", uris: Sequence[str]) -> str:
    """Return commands to try, with a heading."""
    lines = ["", "The rovers stay." if len(fleet.rovers) > 1 else "The rover stays."]
    lines[-1] += " From a second terminal, in this folder:"
    of_rover = len(uris) // len(fleet.rovers)
    for number, rover in enumerate(fleet.rovers):
        asset = rover.settings.asset
        there = f" --to 127.0.0.1:{rover.place.port}" if number else ""
        proposed = [f"command{there} moveTo 3 2 --heading 90deg", f"command{there} stop"]
        proposed += [f"command{there} resume", f"status{there}"]
        proposed.append("watch" if asset == DEFAULT else f"watch --asset {asset}")
        for uri in uris[of_rover * number + 1 : of_rover * (number + 1)]:
            relay = uri.removeprefix("maltcp://").removesuffix("/MRS")
            proposed += [f"command --to {relay} moveForward -0.5", f"status --to {relay}"]
        lines += ["", *(f"  ./rover {words}" for words in proposed)]
    return "\n".join([*lines, ""])


def _make_folder(out: Path | None) -> Path:
    folder = out or Path("runs") / time.strftime("%Y-%m-%dT%H-%M-%S")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise click.UsageError(f"{folder} is not empty: each run takes a folder of its own")
    except OSError as error:
        raise click.UsageError(f"{folder} cannot be used: {error.strerror}") from error
    return folder
