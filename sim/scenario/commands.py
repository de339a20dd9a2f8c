"""The command `rover scenario`: runs acceptance scenarios and prints their results."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Final

import click
from click.shell_completion import CompletionItem

if TYPE_CHECKING:
    from sim.scenario.changes import Override

PIPE_WIDTH: Final = 240


def _complete(_: click.Context, __: click.Parameter, begun: str) -> list[CompletionItem]:
    """Complete the name of a scenario, or the path of a file."""
    from executive.settings import config_folder, names_in

    names = [name for name in names_in(config_folder() / "scenarios") if name.startswith(begun)]
    # In this order: bash drops names that precede the request for files.
    return [CompletionItem(begun, type="file"), *map(CompletionItem, names)]


class ChangeType(click.ParamType[Any]):
    """`KEY=VALUE`, an override of a scenario file."""

    name = "KEY=VALUE"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the override."""
        from sim.scenario.changes import Override

        try:
            return Override.parse(value)
        except ValueError as error:
            self.fail(str(error), param, ctx)

    def shell_complete(
        self, ctx: click.Context, _: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        """Complete a key, or a value from a list of names."""
        from sim.scenario.changes import completions

        return [CompletionItem(key) for key in completions(incomplete)]


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise click.UsageError(f"--out {folder} is not empty: name a folder of its own")
    except OSError as error:
        raise click.UsageError(f"--out {folder} cannot be used: {error.strerror}") from error


@click.command()
@click.argument("files", nargs=-1, metavar="FILE...", shell_complete=_complete)
@click.option("--list", "listed", is_flag=True, help="List the scenarios of config/scenarios.")
@click.option("--seed", type=click.IntRange(0), help="Seed of the sensor noise, not the file's.")
@click.option(
    "--set",
    "changes",
    type=ChangeType(),
    multiple=True,
    help="Override a key of the file, as world.friction=0.4; can be repeated.",
)
@click.option(
    "--repeat",
    type=click.IntRange(1),
    default=1,
    help="Number of runs, each with the next seed; counts the runs that pass.",
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document, nothing else.")
@click.option("--junit", type=click.File("wb", lazy=False), help="Write JUnit XML to this file.")
@click.option("--live", is_flag=True, help="Run in real time: real processes, ROS and socket.")
@click.option(
    "--link",
    type=click.Choice(["direct", "relay"]),
    default="direct",
    show_default=True,
    help="With --live: link to the rover, direct or over an orbiter.",
)
@click.option(
    "--speed",
    type=click.FloatRange(0.1, 20.0),
    default=1.0,
    show_default=True,
    help="With --live, over the direct link: simulated seconds per second.",
)
@click.option("--verbose", is_flag=True, help="Also print every report of the rover.")
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="Write a folder of each run there: map, timeline, reports, ledger, recording.",
)
def scenario(
    files: tuple[str, ...],
    listed: bool,
    seed: int | None,
    changes: "tuple[Override, ...]",
    repeat: int,
    as_json: bool,
    junit: BinaryIO | None,
    live: bool,
    link: str,
    speed: float,
    verbose: bool,
    out: Path | None,
) -> None:
    """Run scenarios in lock step and compare the results with the expected ones.

    FILE is YAML, or the name of a scenario in config/scenarios. It defines the rover's world, its
    commands and faults with their times, and the expected results. docs/scenarios.md describes
    the format and the keys of --set.

    \b
    Examples:
      rover scenario locomotion
      rover scenario my-test.yaml --verbose
      rover scenario side_stuck --out runs/stuck
      rover scenario locomotion --seed 7 --set world.friction=0.4
      rover scenario locomotion --set "inject={left_wheels_stuck, at: 3}"
      rover scenario locomotion --repeat 20
      rover scenario locomotion expired --json --junit results.xml
      rover scenario camera --live --speed 2
      rover scenario relay --live --link relay
      rover scenario --list

    \b
    Exit status:
      0  all expectations are met
      1  some are not
      2  a file or an override cannot be used; the others were run
      3  a rover of a live run could not be reached; the others were run
    """
    from rich.console import Console

    from sim.scenario.model import RunMode
    from sim.scenario.session import ScenarioBatch, list_scenarios

    mode = RunMode.LOCK_STEP
    if live:
        mode = RunMode.RELAY if link == "relay" else RunMode.DIRECT
    elif link != "direct":
        raise click.UsageError("--link relay works with --live only")
    if speed != 1.0 and mode is not RunMode.DIRECT:
        raise click.UsageError(f"--speed does not work {mode.value}")
    if as_json and (verbose or listed):
        raise click.UsageError("--json goes with neither --verbose nor --list")
    if not (files or listed):
        raise click.UsageError("name a FILE; rover scenario --list prints the names")
    if out is not None:
        _make_folder(out)
    width = None if sys.stdout.isatty() else PIPE_WIDTH
    console = Console(width=width, highlight=False, quiet=as_json)
    if listed:
        sys.exit(list_scenarios(console))
    session = ScenarioBatch(console, mode, speed, seed, changes, repeat, verbose, out)
    for name in files:
        session.read(name)
    session.play()
    if as_json:
        click.echo(session.document())
    if junit is not None:
        session.write_junit(junit)
    sys.exit(session.status)
