"""The command `rover plan try`: executes a plan many times in lock step."""

import shlex
import sys
from pathlib import Path
from typing import Any, Final

import click
from click.core import ParameterSource

from adapters.mrs.cli import RoverTarget, echo_json, echo_line, json_option, to_option
from adapters.mrs.cli.plan_check_command import (
    ABOARD,
    ARGUMENTS,
    FILE,
    ID,
    definition_of,
    read_time,
    try_aboard,
)
from adapters.process import require
from executive.commands import PlanArgument
from executive.settings import SettingsError

NOT_COMPLETED: Final = 1
NOT_USABLE: Final = 2
_LINK: Final = {"aboard", "to", "encoding", "certificate", "key", "authorities"}
_SELECTING: Final = {"file", "draws", "draw", "jobs", "out", "as_json", *_LINK}
_HERE: Final = {
    **{each: each for each in ("draw", "seed", "asset", "scenario", "campaign", "jobs", "out")},
    "changes": "set",
    "limit_h": "limit",
}
"""Parameters of runs here, each with its option."""
_TYPED: Final = {ParameterSource.COMMANDLINE, ParameterSource.ENVIRONMENT}


@click.command("try")
@FILE
@ID
@ARGUMENTS
@click.option(
    "--draws", type=click.IntRange(1), default=30, show_default=True, help="Number of runs."
)
@click.option("--draw", type=click.IntRange(0), help="Execute only the run with this number.")
@click.option(
    "--seed", type=click.IntRange(0), default=0, show_default=True, help="Seed of all draws."
)
@click.option(
    "--at",
    "begin_utc_s",
    metavar="UTC",
    callback=read_time,
    help="Begin, as 2026-11-27T09:00:00Z.  [default: a minute before the first time in the plan]",
)
@click.option("--asset", help="Asset name, or its YAML file.  [default: that of the scenario]")
@click.option("--scenario", help="Scenario as the environment: its world, asset and timeline.")
@click.option("--campaign", help="Campaign; its varied keys replace the usual ones.")
@click.option(
    "--set",
    "changes",
    multiple=True,
    metavar="KEY=VALUE",
    help="Set a key of the scenario in all runs, as rover scenario --set.",
)
@click.option(
    "--limit",
    "limit_h",
    type=click.FloatRange(0.01, 240.0),
    default=48.0,
    show_default=True,
    help="Maximum simulated duration of a run in hours.",
)
@click.option(
    "--jobs",
    type=click.IntRange(1),
    help="Number of parallel runs.  [default: one on each core, one for few draws]",
)
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder of the worst run's map and reports.  [default: runs/try-PLAN]",
)
@ABOARD
@to_option
@json_option
@click.pass_context
def try_plan(
    context: click.Context,
    /,
    file: Path,
    plan_id: str | None,
    arguments: tuple[PlanArgument, ...],
    changes: tuple[str, ...],
    campaign: str | None,
    draws: int,
    draw: int | None,
    jobs: int | None,
    limit_h: float,
    out: Path | None,
    aboard: bool,
    to: RoverTarget,
    as_json: bool,
    **conditions: Any,
) -> None:
    """Execute FILE many times in simulated time, each time under drawn conditions.

    Each run draws friction, hills, noise, delays of odometry, and the answers to questions. Time of
    standing passes at once. The report has the share of completed runs, time, energy, clearance,
    the branches and the failures, and the command that repeats the worst run bit for bit.

    \b
    Examples:
      rover plan try config/plans/look-around.xml
      rover plan try config/plans/look-around.xml --draws 4 --set world=yard
      rover plan try look-around.xml --set "inject={battery_low, at: 30}"
      rover plan try look-around.xml --campaign faults
      rover plan try look-around.xml --aboard --draws 10

    \b
    Exit status:
      0    all runs completed the plan
      1    a run did not
      2    the plan is refused, or a file or a value cannot be used
    """
    if aboard:
        typed = [each for each in _HERE if context.get_parameter_source(each) in _TYPED]
        if typed:
            names = ", ".join(f"--{_HERE[each]}" for each in typed)
            raise click.UsageError(f"{names}: not with --aboard, where the rover draws")
        definition = definition_of(file, plan_id, arguments)
        try_aboard(file, definition, to, draws, conditions["begin_utc_s"], as_json)
        return
    for package in ("mujoco", "scipy", "matplotlib", "distributed"):
        require(package)
    from sim.campaign.cluster import ClusterError
    from sim.scenario.changes import Override
    from sim.trial.run import PlanRefusedError, Trial
    from sim.trial.session import campaign_vary, execute, usual_vary

    try:
        given = tuple(map(Override.parse, changes))
        scenario = conditions["scenario"]
        vary = usual_vary(scenario, given) if campaign is None else campaign_vary(campaign)
        plan = definition_of(file, plan_id, arguments)
        trial = Trial(plan=plan, changes=given, vary=vary, limit_s=3600 * limit_h, **conditions)
        numbers = range(draws) if draw is None else [draw]
        folder = out or Path("runs") / f"try-{plan.plan_id}"
        report = execute(trial, numbers, jobs, folder, _repeat_command(context))
    except (SettingsError, PlanRefusedError, ClusterError, ValueError) as error:
        click.echo(f"Error: {error}", err=True)
        sys.exit(NOT_USABLE)
    if as_json:
        echo_json(report.document())
    else:
        for line in report.lines():
            echo_line(line)
    if report.completed < report.draws:
        sys.exit(NOT_COMPLETED)


def _repeat_command(context: click.Context) -> str:
    """Return the command line without the options that select and present runs."""
    arguments_given = ["rover", "plan", "try", str(context.params["file"])]
    for option in context.command.params:
        name, selects = option.name or "", option.name in _SELECTING
        source = context.get_parameter_source(name)
        if selects or source is not ParameterSource.COMMANDLINE:
            continue
        value = context.params[name]
        for each in value if isinstance(value, tuple) else (value,):
            arguments_given += [option.opts[0], _text(each)]
    return shlex.join(arguments_given)


def _text(value: object) -> str:
    if isinstance(value, PlanArgument):
        return f"{value.name}={value.text}"
    return str(value)
