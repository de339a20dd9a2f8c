"""`rover plan check` and `rover plan prove`: check a plan before its uplink, here or aboard."""

import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final, NoReturn

import click

from adapters.mrs.cli.options import RoverTarget, json_option, to_option
from adapters.mrs.cli.terminal import FAILED, connect, echo_json, echo_line, run
from adapters.mrs.plan_checks import CheckRequest, checked, received_finding
from adapters.mrs.spec import PlanCheck, PlanCheckLevel, reason_of
from adapters.process import asset_option
from executive.commands import PlanArgument, PlanDefinition
from executive.plans import FORMAT, ArgumentError, Level, utc
from executive.settings import SettingsError, load_settings
from executive.values.reasons import Reason, Refusal, UnknownReason


def _arguments(_: click.Context, __: click.Parameter, texts: tuple[str, ...]) -> Any:
    pairs = [text.partition("=") for text in texts]
    for name, equals, _value in pairs:
        if not name or not equals:
            raise click.BadParameter(f"{name!r}: write NAME=VALUE")
    return tuple(PlanArgument(name, value) for name, _equals, value in pairs)


FILE: Final = click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
ARGUMENTS: Final = click.option(
    "--arg",
    "arguments",
    multiple=True,
    metavar="NAME=VALUE",
    callback=_arguments,
    help="A value that the plan reads as {NAME}; may be repeated.",
)
ID: Final = click.option(
    "--id", "plan_id", metavar="PLAN", help="The plan's id; the file's name by default."
)


ABOARD: Final = click.option(
    "--aboard", is_flag=True, help="Let the rover check it, by its own settings and bounds."
)


def read_time(_: click.Context, __: click.Parameter, text: str | None) -> float | None:
    """Read a UTC of the command line."""
    try:
        return None if text is None else utc("UTC", text)
    except ArgumentError as error:
        raise click.BadParameter(str(error)) from error


@click.command()
@FILE
@ID
@ARGUMENTS
@click.option(
    "--at",
    "begin_utc_s",
    metavar="UTC",
    callback=read_time,
    help="Planned begin, as 2026-11-27T09:00:00Z: windows that it misses are found.",
)
@asset_option()
@ABOARD
@to_option
@json_option
def check(
    file: Path,
    plan_id: str | None,
    arguments: tuple[PlanArgument, ...],
    begin_utc_s: float | None,
    asset: str,
    aboard: bool,
    to: RoverTarget,
    as_json: bool,
) -> None:
    """Check FILE as an asset would, without a connection; find probable faults.

    With --aboard the rover checks it. Exits 1 if the plan would be refused, or has an error.

    \b
    Examples:
      rover plan check config/plans/look-around.xml
      rover plan check there-and-back.xml --arg far=3 --asset mocup
      rover plan check config/plans/missions/02-relay-passes.xml --at 2026-11-27T10:00:00Z
      rover plan check config/plans/look-around.xml --aboard
    """
    definition, level = definition_of(file, plan_id, arguments), PlanCheckLevel.CHECK
    found = _result(definition, level, asset, to if aboard else None, begin_utc_s)
    text = f"{definition.plan_id}: {found.leaves} leaves, {found.commands} commands at most"
    _print(file, definition, found, text, as_json)


@click.command()
@FILE
@ID
@ARGUMENTS
@asset_option()
@ABOARD
@to_option
@json_option
def prove(
    file: Path,
    plan_id: str | None,
    arguments: tuple[PlanArgument, ...],
    asset: str,
    aboard: bool,
    to: RoverTarget,
    as_json: bool,
) -> None:
    """Explore all outcomes of FILE: results of steps, telemetry, answers, timers, stops.

    The plan is proved if no outcome has a fault and there is no limit. With --aboard the rover
    explores it. Exits 1 if the plan would be refused, or has an error.

    \b
    Examples:
      rover plan prove config/plans/look-around.xml
      rover plan prove config/plans/look-around.xml --aboard
    """
    definition, level = definition_of(file, plan_id, arguments), PlanCheckLevel.PROVE
    found = _result(definition, level, asset, to if aboard else None)
    counts = f"{found.states} states, {found.ticks} ticks"
    text = f"{definition.plan_id}: {_verdict(found)}, {counts}"
    _print(file, definition, found, "\n  limit: ".join([text, *found.limits]), as_json)


def _verdict(found: PlanCheck) -> str:
    return found.verdict.name.lower().replace("_", " ")


def _result(
    definition: PlanDefinition,
    level: PlanCheckLevel,
    asset: str,
    to: RoverTarget | None,
    begin_utc_s: float | None = None,
) -> PlanCheck:
    """Return the result of a check, by a rover if one is given."""
    if to is None:
        try:
            settings = load_settings(asset)
        except SettingsError as error:
            raise click.UsageError(str(error)) from error
        return checked(CheckRequest(level, definition, settings, begin_utc_s=begin_utc_s))
    return run(check_aboard(to, definition, level, begin_utc_s=begin_utc_s))


async def check_aboard(
    to: RoverTarget,
    definition: PlanDefinition,
    level: PlanCheckLevel,
    draws: int | None = None,
    begin_utc_s: float | None = None,
) -> PlanCheck:
    """Return the result of a check by a rover."""
    async with await connect(to) as client:
        return await client.check_plan(definition, level, draws, begin_utc_s)


def try_aboard(
    file: Path,
    definition: PlanDefinition,
    to: RoverTarget,
    draws: int,
    begin_utc_s: float | None,
    as_json: bool,
) -> None:
    """Print the summary of simulated runs by a rover; exit 1 if one did not complete the plan."""
    found = run(check_aboard(to, definition, PlanCheckLevel.TRY, draws, begin_utc_s))
    if found.refusal is not None:
        _refuse(file, reason_of(found.code or 0), found.refusal, as_json)
    trial = found.trial
    assert trial is not None
    if as_json:
        echo_json({"plan": definition.plan_id, "trial": trial})
    else:
        share = f"share {trial.successLow:.3f} .. {trial.successHigh:.3f} with confidence 0.95"
        echo_line(
            f"{definition.plan_id}: {trial.successes} of {trial.draws} draws completed; {share}"
        )
        for each in trial.figures:
            spread = f"(5 .. 95 %: {each.low:.4g} .. {each.high:.4g})"
            echo_line(f"  {each.name:<9} {each.median:.4g} {each.unit} {spread}")
        for branch in trial.branches:
            choice = f"{branch.choice} in {branch.draws} draws"
            echo_line(f"  line {branch.line}: {branch.node}: {choice}")
        if trial.worst is not None:
            echo_line(f"  worst: {trial.worst}")
    if trial.successes < trial.draws:
        sys.exit(FAILED)


def definition_of(
    file: Path, plan_id: str | None, arguments: tuple[PlanArgument, ...]
) -> PlanDefinition:
    """Return the plan of a file; its id is the file's name by default."""
    name = plan_id or file.name.partition(".")[0]
    return PlanDefinition(name, file.name, FORMAT, file.read_bytes(), arguments)


def refuse(file: Path, refusal: Refusal) -> NoReturn:
    """Print why a plan is refused, and exit."""
    _refuse(file, refusal.reason, refusal.text, as_json=False)


def _refuse(file: Path, reason: Reason | UnknownReason, text: str, as_json: bool) -> NoReturn:
    if as_json:
        echo_json({"refusal": text, "code": reason.value, "reason": reason.name})
    else:
        echo_line(f"{file}: {reason.value} {reason.name}: {text}", err=True)
    sys.exit(FAILED)


def _print(
    file: Path, definition: PlanDefinition, found: PlanCheck, text: str, as_json: bool
) -> None:
    """Print a result; exit if it has a refusal or an error."""
    if found.refusal is not None:
        _refuse(file, reason_of(found.code or 0), found.refusal, as_json)
    findings = [received_finding(each) for each in found.findings]
    if as_json:
        counts = {name: getattr(found, name) for name in ("leaves", "commands", "states", "ticks")}
        rows = [{**asdict(each), "level": each.level.value} for each in findings]
        shown = {"plan": definition.plan_id, "verdict": _verdict(found), **counts}
        echo_json({**shown, "limits": found.limits, "findings": rows})
    else:
        for line in (*text.splitlines(), *(f"  {each}" for each in findings)):
            echo_line(line)
    if any(each.level is Level.ERROR for each in findings):
        sys.exit(FAILED)
