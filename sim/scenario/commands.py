"""The command `rover scenario`: plays acceptance scenarios and says what came of them."""

import sys
from pathlib import Path
from typing import Final

import click
from click.shell_completion import CompletionItem

PIPE_WIDTH: Final = 240
BAD_FILE: Final = 2


def _complete(_: click.Context, __: click.Parameter, begun: str) -> list[CompletionItem]:
    """Complete the name of a scenario, or the path of a file."""
    from executive.settings import names_in
    from sim.scenario.reading import scenario_folder

    names = [name for name in names_in(scenario_folder()) if name.startswith(begun)]
    # In this order: bash forgets the names that stand before the word for files.
    return [CompletionItem(begun, type="file"), *map(CompletionItem, names)]


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise click.UsageError(f"--out {folder} is not empty: name a folder of its own")
    except OSError as error:
        raise click.UsageError(f"--out {folder} cannot be used: {error.strerror}") from error


@click.command()
@click.argument("files", nargs=-1, metavar="FILE...", shell_complete=_complete)
@click.option("--list", "listed", is_flag=True, help="List the scenarios that have a name.")
@click.option("--live", is_flag=True, help="Play in real time: real processes, ROS and socket.")
@click.option(
    "--link",
    type=click.Choice(["direct", "relay"]),
    default="direct",
    show_default=True,
    help="With --live: go to the rover, or through an orbiter.",
)
@click.option(
    "--speed",
    type=click.FloatRange(0.1, 20.0),
    default=1.0,
    show_default=True,
    help="With --live, by the direct link: simulated seconds per second.",
)
@click.option("--verbose", is_flag=True, help="Print every report of the rover, too.")
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="Keep a folder of each run there: map, timeline, reports, ledger.",
)
def scenario(
    files: tuple[str, ...],
    listed: bool,
    live: bool,
    link: str,
    speed: float,
    verbose: bool,
    out: Path | None,
) -> None:
    """Play scenarios in lock step and compare what happens with what they expect.

    FILE is YAML, or the name of a scenario in config/scenarios. It says in which world a rover
    stands, what is sent to it and goes wrong when, and what must come of it; docs/scenarios.md
    tells how to write one.

    \b
    Examples:
      rover scenario locomotion
      rover scenario my-test.yaml --verbose
      rover scenario side_stuck --out runs/stuck
      rover scenario camera --live --speed 2
      rover scenario relay --live --link relay
      rover scenario --list

    \b
    Exit status:
      0  everything holds that was expected
      1  something does not
      2  a file cannot be used; the others were played
    """
    from rich.console import Console

    from executive.settings import SettingsError, names_in
    from sim.scenario.model import PlayMode
    from sim.scenario.playing import PlayError, play, show, summary
    from sim.scenario.reading import load_scenario, scenario_folder
    from sim.scenario.record import Finding

    console = Console(width=None if sys.stdout.isatty() else PIPE_WIDTH, highlight=False)
    mode = PlayMode.LOCK_STEP
    if live:
        mode = PlayMode.RELAY if link == "relay" else PlayMode.DIRECT
    elif link != "direct":
        raise click.UsageError("--link relay works with --live only")
    if speed != 1.0 and mode is not PlayMode.DIRECT:
        raise click.UsageError(f"--speed does not work {mode.value}")
    if not (files or listed):
        raise click.UsageError("name a FILE; rover scenario --list shows those at hand")
    if out is not None:
        _make_folder(out)
    usable, bad_file = [], False
    findings: list[Finding] = []
    for name in names_in(scenario_folder()) if listed else files:
        try:
            usable.append((name, load_scenario(name, None if listed else mode)))
        except SettingsError as error:
            click.echo(f"Error: {error}", err=True)
            bad_file = True
    for name, loaded in usable:
        if listed:
            console.print(f"{name:<24}{loaded.title}", markup=False)
            continue
        try:
            outcome = play(name, loaded, mode, speed, out)
        except SettingsError as error:
            click.echo(f"Error: {error}", err=True)
            bad_file = True
        except PlayError as error:
            raise click.ClickException(str(error)) from error
        else:
            show(console, loaded, outcome, verbose)
            findings += outcome.findings
    if findings:
        click.echo(summary(findings))
        if out is not None:
            click.echo(f"maps, timelines, reports and ledgers are in {out}")
    sys.exit(BAD_FILE if bad_file else any(not finding.holds for finding in findings))
