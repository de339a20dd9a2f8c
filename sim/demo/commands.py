"""`rover demo`: a mission-control session against a simulated rover."""

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

if TYPE_CHECKING:
    from rich.console import Console

    from sim.demo.participants import Participants
    from sim.processes import OperationsConsole

FAILED: Final = 1
DEFAULT: Final = "jackal"
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

    Simulation and executive are started as processes of their own. Mission control then commands
    the rover over its socket: waypoints with headings, a stop in the middle of a drive and a
    resume, the camera, a picture, a command out of range and one sent twice. In the end come every
    command's life, the true error, a map of the drive, the picture, and the tree at its busiest.

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
    from sim.demo.participants import Participants, start_rovers
    from sim.demo.script import SHOWS
    from sim.processes import (
        AddressError,
        ChildError,
        free_place,
        known_place,
        operations_console,
    )

    try:
        require("rclpy")
        with ExitStack() as running:
            stay = stay or no_play
            place = known_place() if stay else running.enter_context(free_place())
            folder = _make_folder(out)
            chosen = SHOWS[show]
            members = running.enter_context(
                start_rovers(chosen.scripts, place, folder, seed, speed)
            )
            # While they start: these imports take as long as theirs.
            from sim.demo.display import make_console
            from sim.demo.mission import await_executives, play

            console = make_console()
            console.print("simulation and executive are starting", style="dim")
            participants = Participants(members)
            if chosen.relayed:
                from sim.processes.relay import relayed

                eclipses = () if no_play else chosen.eclipses
                if eclipses:  # they are counted from the start of the relay
                    await_executives(participants)
                orbiter = relayed(folder, *participants.rovers, eclipses=eclipses, restart=True)
                participants = Participants(members, running.enter_context(orbiter))
            operations = None
            if not no_console:
                uris = asyncio.run(participants.uris())
                operations = running.enter_context(operations_console(folder, uris))
                if operations is None:
                    console.print(NO_CONSOLE, markup=False)
            played = play(participants, folder, console, operations, scripted=not no_play)
            as_planned = True
            if not no_play:
                from sim.demo.outcome import tell

                as_planned = tell(played, participants, folder, console)
            if stay:
                _stay(participants, console, operations)
            else:
                console.print(ENDS)
            if not as_planned:
                sys.exit(FAILED)
    except (ChildError, AddressError) as error:
        raise click.ClickException(str(error)) from error


def _show(**asked: bool) -> str:
    """Return the one demonstration that is asked for."""
    chosen = [name for name, wanted in asked.items() if wanted]
    if len(chosen) > 1:
        options = " and ".join(f"--{name}" for name in chosen)
        raise click.UsageError(f"{options} are demonstrations of their own: choose one of them")
    return chosen[0] if chosen else DEFAULT


def _stay(
    participants: "Participants", console: "Console", operations: "OperationsConsole | None"
) -> None:
    """Leave the rovers running until Ctrl-C."""
    import asyncio

    from sim.demo.mission import BROWSE
    from sim.demo.participants import proposals

    console.print(proposals(participants))
    if operations is not None:
        console.print(f"{BROWSE}{asyncio.run(operations.address())}\n")
    if participants.members[0].rover.place.domain != 0:
        console.print(ELSEWHERE)
    console.print("Ctrl-C ends it.")
    processes = [participants.processes, *([operations] if operations else [])]
    try:
        while True:
            for group in processes:
                group.check()
            time.sleep(0.2)
    except KeyboardInterrupt:
        console.print("ending")


def _make_folder(out: Path | None) -> Path:
    folder = out or Path("runs") / time.strftime("%Y-%m-%dT%H-%M-%S")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise click.UsageError(f"{folder} is not empty: each run takes a folder of its own")
    except OSError as error:
        raise click.UsageError(f"{folder} cannot be used: {error.strerror}") from error
    return folder
