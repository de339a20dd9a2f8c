"""The command `rover scenario`: plays acceptance scenarios and says what came of them."""

import sys
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from rich.console import Console

    from sim.scenario.finding import Finding
    from sim.scenario.model import Scenario
    from sim.scenario.record import Record

PIPE_WIDTH = 240


class _BadFile(click.ClickException):
    exit_code = 2


@click.command()
@click.argument("files", nargs=-1, metavar="FILE...")
@click.option("--list", "listed", is_flag=True, help="List the scenarios that have a name.")
@click.option("--verbose", is_flag=True, help="Print every report of the rover, too.")
def scenario(files: tuple[str, ...], listed: bool, verbose: bool) -> None:
    """Play scenarios in lock step and compare what happens with what they expect.

    FILE is YAML, or the name of a scenario in config/scenarios. It says in which world a rover
    stands, what is sent to it and goes wrong when, and what must come of it; docs/scenarios.md
    tells how to write one.

    \b
    Examples:
      rover scenario locomotion
      rover scenario my-test.yaml --verbose
      rover scenario --list

    \b
    Exit status:
      0  everything holds that was expected
      1  something does not
      2  a file cannot be used
    """
    from rich.console import Console

    from sim.scenario.reading import ScenarioError, load_scenario
    from sim.scenario.report import show, summary

    console = Console(width=None if sys.stdout.isatty() else PIPE_WIDTH, highlight=False)
    if listed:
        _list(console)
        return
    if not files:
        raise click.UsageError("name a FILE; rover scenario --list shows those at hand")
    findings = []
    try:
        scenarios = [load_scenario(name) for name in files]
        for loaded in scenarios:
            record, found = _play(loaded)
            show(console, loaded, record, found, verbose)
            findings += found
    except ScenarioError as error:
        raise _BadFile(str(error)) from error
    click.echo(summary(findings))
    sys.exit(any(not finding.holds for finding in findings))


def _play(scenario: "Scenario") -> "tuple[Record, list[Finding]]":
    import tempfile
    from pathlib import Path

    from sim.scenario.running import run_in_lock_step
    from sim.scenario.verdict import judge

    with tempfile.TemporaryDirectory(prefix="rover-scenario-") as folder:
        record = run_in_lock_step(scenario, Path(folder))
        return record, judge(scenario, record)


def _list(console: "Console") -> None:
    from sim.scenario.reading import load_scenario, scenario_folder

    for path in sorted(scenario_folder().glob("*.yaml")):
        console.print(f"{path.stem:<24}{load_scenario(str(path)).title}", markup=False)
