"""The command `rover demo`: a mission-control session against simulated rovers."""

import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from adapters.mrs.cli import QuantityType

if TYPE_CHECKING:
    from rich.console import Console

    from sim.processes import OperationsConsole, RoverAddress
    from sim.scenario.model import RunMode, Scenario
    from sim.scenario.scene import Fleet

FAILED: Final = 1
MAX_DURATION_S: Final = 180.0
"""Maximum duration of a demonstration."""
DEFAULT: Final = "jackal"
SHOWS: Final = {
    "jackal": ("jackal",),
    "mocup": ("mocup",),
    "relay": ("relay",),
    "assets": ("both_jackal", "both_mocup"),
    "delay": ("delayed",),
}
"""Scenarios in config/demo that run at the same time, by demonstration."""
NO_CONSOLE: Final = "a console in a browser needs the extra ground: rover-executive[ground]"
ENDS: Final = "\nThe rover and its console have ended; --stay leaves them running."
MAX_DELAY_S: Final = 20.0
"""Maximum round-trip time, s: a later stop of config/demo/delayed.yaml misses the drive."""
CONSOLE_AFTER: Final = 80
"""Offset of the console's port from the rover's, as for the default ports 21000 and 21080."""


@click.command()
@click.option("--stay", is_flag=True, help="Leave the processes running at the end.")
@click.option("--no-session", is_flag=True, help="As --stay, but without a session.")
@click.option("--no-console", is_flag=True, help="Do not start the operations console.")
@click.option("--mocup", is_flag=True, help="Use MOCUP: its brick executes whole motions.")
@click.option(
    "--relay",
    is_flag=True,
    help="Command the Jackal over an orbiter, with a contact outage.",
)
@click.option(
    "--assets",
    is_flag=True,
    help="Use both rovers at once, each over the direct link and over the orbiter.",
)
@click.option(
    "--delay",
    type=QuantityType("s"),
    metavar="TIME",
    help="Round-trip time of a simulated link to the Jackal, such as 10s: at most 20s with the"
    " session.",
)
@click.option("--seed", default=0, show_default=True, help="Seed of the sensor noise.")
@click.option(
    "--speed",
    type=click.FloatRange(0.1, 20.0),
    help="Simulated seconds per second; more than 3 need a fast machine.  [default: 1; with the"
    " Jackal alone less while this computer is too busy]",
)
@click.option(
    "--port",
    type=click.IntRange(1024, 65535),
    metavar="PORT",
    help="TCP port of the rover, for a second demonstration beside another one. The console is at"
    " PORT + 80, other rovers are at the ports after PORT.",
)
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="Output folder, new or empty.  [default: runs/TIME]",
)
def demo(
    stay: bool,
    no_session: bool,
    no_console: bool,
    mocup: bool,
    relay: bool,
    assets: bool,
    delay: float | None,
    seed: int,
    speed: float | None,
    port: int | None,
    out: Path | None,
) -> None:
    """Run a mission-control session against simulated rovers.

    Simulation and executive are started as processes of their own. Mission control then runs a
    scenario of config/demo over the rover's socket: waypoints with headings, a stop in the middle
    of a drive and a resume, the camera, a picture, a command out of range and one sent twice. At
    the end it shows the life cycle of every command, the true error, a map of the drive, the
    picture, and the busiest state of the tree.

    With --relay the commands go over an orbiter, rover-mops, whose contact with the rover is
    interrupted. With --assets two rovers are commanded at once, over both links. A timeline shows
    the location of each command over time.

    With --delay, commands and reports pass through a simulated link with light time (rover link).
    The stop is then sent once the start of the drive is reported, and arrives about one round trip
    after it; the rover drives slowly until then. The lines of the session have the time on the
    ground and the last status received with its age, the table at the end has the times aboard.

    rover-console serves browsers at the address that is printed first. Without --stay the
    demonstration uses a free port and a free ROS domain on this machine. With --stay the rover uses
    the default address of `rover command`, `rover status` and `rover watch`. With --port the rover
    has that port, and a free ROS domain.

    \b
    Examples:
      rover demo
      rover demo --stay
      rover demo --no-session
      rover demo --mocup
      rover demo --relay
      rover demo --assets
      rover demo --delay 10s
      rover demo --seed 7 --speed 2 --out drive
      rover demo --stay --port 22000

    \b
    Exit status: 0 all expectations are met, 1 some are not, or a process ended.
    """
    show = _show(mocup=mocup, relay=relay, assets=assets, delay=bool(delay))
    round_trip_s = delay or 0.0
    if round_trip_s < 0.0 or (not no_session and round_trip_s > MAX_DELAY_S):
        raise click.UsageError(f"--delay is 0 to {MAX_DELAY_S:g} s, or any with --no-session")
    if relay and speed is not None:
        raise click.UsageError("--speed does not work with --relay: contacts are planned in UTC")
    import asyncio
    from contextlib import ExitStack

    from adapters.process import require
    from sim.processes import (
        ANY_PORT,
        AddressError,
        ChildError,
        allocate_address,
        default_address,
        operations_console,
    )
    from sim.scenario.model import RunMode
    from sim.scenario.scene import fleet_of

    mode = RunMode.RELAY if relay else RunMode.DIRECT
    if speed is None and show != DEFAULT:
        speed = 1.0  # a brick, a contact plan and a delayed link have clocks of their own
    try:
        require("rclpy")
        with ExitStack() as running:
            address = (
                default_address()
                if port is None and (stay or no_session)
                else running.enter_context(allocate_address(port or ANY_PORT))
            )
            folder = _make_folder(out)
            scenarios = _scenarios(show, mode, seed, round_trip_s, played=not no_session)
            several = len(scenarios) > 1
            folders = [folder / each.settings.asset if several else folder for each in scenarios]
            relayed = folder if relay or assets else None
            fleet = running.enter_context(
                fleet_of(
                    *(scenarios, folders, address, relayed, speed),
                    restart=True,
                    round_trip_s=round_trip_s,
                )
            )
            # Imported while the processes start: these imports take as long as theirs.
            from sim.demo.display import make_console
            from sim.demo.session import play, show_outcome

            console = make_console()
            console.print("simulation and executive are starting", style="dim")
            operations = None
            if not no_console:
                uris = asyncio.run(_uris(fleet))
                console_port = None if port is None else port + CONSOLE_AFTER
                operations = running.enter_context(
                    operations_console(folder, uris, console_port, round_trip_s)
                )
                if operations is None:
                    console.print(NO_CONSOLE, markup=False)
            played = play(fleet, scenarios, folders, mode, console, operations, not no_session)
            as_planned = show_outcome(played, folder, console) if played else True
            if stay or no_session:
                _run_until_interrupted(fleet, address, console, operations, known=port is None)
            else:
                console.print(ENDS)
            if not as_planned:
                sys.exit(FAILED)
    except (ChildError, AddressError) as error:
        raise click.ClickException(str(error)) from error


def _scenarios(
    show: str, mode: "RunMode", seed: int, round_trip_s: float, *, played: bool
) -> "Sequence[Scenario]":
    """Return the scenarios of a demonstration; without `played` their timelines are empty."""
    from executive.settings import config_folder
    from sim.scenario.reading import load_scenario

    paths = [config_folder() / "demo" / f"{name}.yaml" for name in SHOWS[show]]
    loaded = [replace(load_scenario(str(path), mode), seed=seed) for path in paths]
    return [
        replace(each, duration_s=MAX_DURATION_S + 2 * len(each.timeline) * round_trip_s)
        if played
        else replace(each, timeline=())
        for each in loaded
    ]


async def _uris(fleet: "Fleet") -> list[str]:
    """Wait until the MRS of all rovers is served; return its URIs on all links."""
    from sim.scenario.model import RunMode

    modes = [RunMode.DIRECT] if fleet.orbiter is None else [RunMode.DIRECT, RunMode.RELAY]
    return [await fleet.uri(rover, mode) for rover in fleet.rovers for mode in modes]


def _show(**requested: bool) -> str:
    """Return the requested demonstration. Raise click.UsageError if there are several."""
    chosen = [name for name, wanted in requested.items() if wanted]
    if len(chosen) > 1:
        options = " and ".join(f"--{name}" for name in chosen)
        raise click.UsageError(f"{options} are demonstrations of their own: choose one of them")
    return chosen[0] if chosen else DEFAULT


def _run_until_interrupted(
    fleet: "Fleet",
    address: "RoverAddress",
    console: "Console",
    operations: "OperationsConsole | None",
    *,
    known: bool,
) -> None:
    """Leave the rovers running until Ctrl-C; `known` if commands reach the first by default."""
    import asyncio

    from sim.demo.session import SlowdownReport, print_address

    console.print(_proposals(fleet, asyncio.run(_uris(fleet)), address.domain, known=known))
    asyncio.run(print_address(operations, console))
    console.print("\nCtrl-C ends it.")
    processes = [fleet.processes, *([operations] if operations else [])]
    slowdown = SlowdownReport(fleet, console)
    try:
        while True:
            for group in processes:
                group.check()
            slowdown.update()
            time.sleep(0.2)
    except KeyboardInterrupt:
        console.print("ending")


def _proposals(fleet: "Fleet", uris: Sequence[str], domain: int, *, known: bool) -> str:
    """Return example commands, with a heading."""
    from adapters.process import program

    lines = ["", "The rovers run." if len(fleet.rovers) > 1 else "The rover runs."]
    lines[-1] += " From a second terminal, in this folder:"
    in_domain = f"ROS_DOMAIN_ID={domain} " if domain else ""
    of_rover = len(uris) // len(fleet.rovers)
    for number, rover in enumerate(fleet.rovers):
        asset = rover.settings.asset
        there = "" if known and not number else f" --to 127.0.0.1:{rover.address.port}"
        if rover.round_trip_s:
            there += f" --delay {rover.round_trip_s:g}s"
        proposed = [f"command{there} moveTo 3 2 --heading 90deg", f"command{there} stop"]
        proposed += [f"command{there} resume", f"status{there}"]
        watch = "watch" if asset == DEFAULT else f"watch --asset {asset}"
        for uri in uris[of_rover * number + 1 : of_rover * (number + 1)]:
            relay = uri.removeprefix("maltcp://").removesuffix("/MRS")
            proposed += [f"command --to {relay} moveForward -0.5", f"status --to {relay}"]
        typed = program()
        lines += ["", *(f"  {typed} {each}" for each in proposed), f"  {in_domain}{typed} {watch}"]
    return "\n".join([*lines, ""])


def _make_folder(out: Path | None) -> Path:
    folder = out or Path("runs") / time.strftime("%Y-%m-%dT%H-%M-%S")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise click.UsageError(f"{folder} is not empty: name an empty folder for each run")
    except OSError as error:
        raise click.UsageError(f"{folder} cannot be used: {error.strerror}") from error
    return folder
