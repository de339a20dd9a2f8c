"""The command `rover whatif`: simulates a recorded run again under a change."""

import sys
from pathlib import Path
from typing import Any, Final

import click

from adapters.mrs.cli import echo_json, echo_line, json_option
from adapters.process import require
from executive.settings import Controller

DIFFERS: Final = 1
NOT_USABLE: Final = 2
CONFIRMING: Final = 8
"""Number of seeds of `--save`; chosen."""
FORK: Final = "fork.mcap"
PLOT: Final = "plot.png"


@click.command()
@click.argument("recording", metavar="RUN.mcap", type=click.Path(path_type=Path))
@click.option(
    "--at",
    "at_s",
    type=click.FloatRange(0.0),
    metavar="SECONDS",
    help="Time of --command, and of the draws of --seeds, since the start of the recording.",
)
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="KEY=VALUE",
    help="Set a key of the rover's settings, as drive.travel_speed=0.6; can be repeated.",
)
@click.option(
    "--command",
    "commands",
    multiple=True,
    metavar="TEXT",
    help="Send a command at that time, typed as for rover command: 'moveTo 3 2 --replace'.",
)
@click.option(
    "--drop", "dropped", multiple=True, metavar="ID", help="Do not send a command, as MOE:2."
)
@click.option("--without", multiple=True, metavar="FAULT", help="Do not inject a simulated fault.")
@click.option(
    "--controller",
    type=click.Choice([each.value for each in Controller]),
    help="Drive all motions to targets with this controller.",
)
@click.option(
    "--world",
    metavar="NAME",
    help="Run in this world: a name, a YAML file, or `scans` for the obstacles that were measured.",
)
@click.option(
    "--seeds",
    type=click.IntRange(1),
    help="Number of forks; all except the first have other noise.  [default: 1; 8 with --save]",
)
@click.option(
    "--save",
    is_flag=True,
    help="Find the minimal change of limits, speeds, controller or arguments that saves the run.",
)
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for the recording of the first fork, and the plots of both side by side.",
)
@json_option
def whatif(
    recording: Path,
    at_s: float | None,
    seeds: int | None,
    save: bool,
    out: Path | None,
    as_json: bool,
    **texts: Any,
) -> None:
    """Simulate a recorded run with other settings, commands, faults or another world.

    The first run is without a change: if that does not reproduce the recording, there is no other
    answer. The second is with the change. The answer has the first decision that differs, with its
    reason, and the outcome of each command.

    \b
    Examples:
      rover whatif runs/motion_forward/run.mcap --set drive.travel_speed=0.6
      rover whatif run.mcap --set faults.odometry_off_gyro.above=1.5 --seeds 8
      rover whatif run.mcap --at 3.2 --command "moveTo 3 2 --replace" --drop MOE:2
      rover whatif run.mcap --without left_wheels_stuck --out runs/whatif
      rover whatif run.mcap --controller mpc --json
      rover whatif run.mcap --save

    \b
    Exit status:
      0  answered
      1  without a change the fork does not reproduce the recording, nor with a known fault
      2  no such recording, key, command or fault
    """
    for package in ("mujoco", "matplotlib"):
        require(package)
    from adapters.recording import RecordingError
    from executive.settings import SettingsError
    from executive.values.reports import printable
    from sim.fork.answer import answer_lines, write_plots
    from sim.fork.changed import read_change
    from sim.fork.forkable import whatif as answer_of
    from sim.fork.model import Change, Fidelity

    if save:
        if any(each not in (None, ()) for each in (at_s, out, *texts.values())):
            raise click.UsageError("--save finds the change: of the others only --seeds and --json")
        _save(recording, seeds or CONFIRMING, as_json)
        return
    try:
        change = read_change(**texts)
        if change == Change() and (seeds or 1) > 1:
            raise click.UsageError(
                "--seeds draws other noise for a change: give one; a --set of the recorded value"
                " changes the noise alone"
            )
        forked = None if out is None else _new_file(out)
        answer = answer_of(recording, change, at_s, seeds or 1, forked)
        if out is not None and answer.forks:
            write_plots(recording, out / FORK, change, out / PLOT)
    except (RecordingError, SettingsError) as error:
        click.echo(f"Error: {error}", err=True)
        sys.exit(NOT_USABLE)
    if as_json:
        echo_json(answer.document())
    else:
        for line in answer_lines(answer, change):
            echo_line(printable(line))
    if answer.fidelity is Fidelity.DIFFERENT:
        sys.exit(DIFFERS)


def _save(recording: Path, seeds: int, as_json: bool) -> None:
    """Print the answer of `--save`."""
    from adapters.recording import RecordingError
    from sim.fork.save import save

    try:
        answer = save(recording, range(1, seeds + 1))
    except (RecordingError, ValueError) as error:
        click.echo(f"Error: {error}", err=True)
        sys.exit(NOT_USABLE)
    if as_json:
        echo_json(answer.document())
    else:
        for line in answer.lines():
            echo_line(line)
    if answer.saving is None:
        sys.exit(DIFFERS)


def _new_file(folder: Path) -> Path:
    """Return the file of the fork's recording in a folder, which is created."""
    file = folder / FORK
    if file.exists():
        raise click.UsageError(f"{file} exists: name another folder with --out")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise click.UsageError(f"--out {folder} cannot be created: {error.strerror}") from error
    return file
