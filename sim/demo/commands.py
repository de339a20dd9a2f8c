"""`rover demo`: a mission-control session against a simulated rover."""

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

if TYPE_CHECKING:
    from rich.console import Console

    from sim.processes.deployment import Deployment

FAILED: Final = 1
DEFAULT: Final = "jackal"
STAYING: Final = """
The rover stays. From a second terminal, in this folder:

  ./rover command moveTo 3 2 --heading 90deg
  ./rover command stop
  ./rover command resume
  ./rover status
  ./rover watch{asset}
"""
ELSEWHERE: Final = "rover watch needs the same ROS_DOMAIN_ID there as here.\n"


@click.command()
@click.option("--stay", is_flag=True, help="Leave simulation and executive running afterwards.")
@click.option("--no-play", is_flag=True, help="Play nothing: only start them, and stay.")
@click.option("--mocup", is_flag=True, help="With the small rover, whose brick moves by itself.")
@click.option("--seed", default=0, show_default=True, help="Of the simulation's sensor noise.")
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder of what is written, new or empty.  [default: runs/TIME]",
)
def demo(stay: bool, no_play: bool, mocup: bool, seed: int, out: Path | None) -> None:
    """Play a mission-control session against a simulated rover.

    Simulation and executive are started as processes of their own. Mission control then commands
    the rover over its socket: waypoints with headings, a stop in the middle of a drive and a
    resume, the camera, a picture, a command out of range and one sent twice. In the end come every
    command's life, the true error, a map of the drive, the picture, and the tree at its busiest.

    Played without --stay it keeps to itself: a free port, and a free ROS domain on this machine.
    With --stay the rover is where `rover command`, `rover status` and `rover watch` look for it.

    \b
    Examples:
      rover demo
      rover demo --stay
      rover demo --no-play
      rover demo --mocup
      rover demo --seed 7 --out drive

    \b
    Exit status: 0 all went as planned, 1 it did not, or a process died.
    """
    from contextlib import ExitStack

    from adapters.ros.presence import NoRosError, require_ros
    from sim.demo.script import JACKAL, MOCUP
    from sim.processes.children import ChildError
    from sim.processes.deployment import deployed
    from sim.processes.place import PlaceError, free_place, known_place

    try:
        require_ros()
        with ExitStack() as running:
            stay = stay or no_play
            place = known_place() if stay else running.enter_context(free_place())
            folder = _make_folder(out)
            script = MOCUP if mocup else JACKAL
            rover = running.enter_context(deployed(place, folder, script.asset, script.world, seed))
            # While they start: these imports take as long as theirs.
            from sim.demo.display import make_console
            from sim.demo.mission import await_rover, play

            console = make_console()
            console.print("simulation and executive are starting", style="dim")
            if no_play:
                await_rover(rover, script.asset, console)
                as_planned = True
            else:
                played = play(rover, script, folder, console)
                from sim.demo.outcome import tell

                as_planned = tell(played, rover, folder, console)
            if stay:
                _stay(rover, script.asset, console)
            if not as_planned:
                sys.exit(FAILED)
    except (ChildError, NoRosError, PlaceError) as error:
        raise click.ClickException(str(error)) from error


def _stay(rover: "Deployment", asset: str, console: "Console") -> None:
    """Leave the rover running until Ctrl-C."""
    console.print(STAYING.format(asset="" if asset == DEFAULT else f" --asset {asset}"))
    if rover.place.domain != 0:
        console.print(ELSEWHERE)
    console.print("Ctrl-C ends it.")
    try:
        while True:
            rover.check()
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
