"""`rover plan check` and `rover plan prove`: check a plan locally before its uplink."""

import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final, NoReturn

import click

from adapters.mrs.cli.options import json_option
from adapters.mrs.cli.terminal import FAILED, echo_json
from adapters.process import asset_option
from executive.commands import PlanArgument, PlanDefinition
from executive.plans import (
    FORMAT,
    ArgumentError,
    Finding,
    Level,
    PlanRoot,
    check_plan,
    find_faults,
    max_commands,
    steps,
    utc,
)
from executive.settings import SettingsError, load_settings
from executive.values.reasons import Refusal


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


def _time(_: click.Context, __: click.Parameter, text: str | None) -> float | None:
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
    callback=_time,
    help="Planned begin, as 2026-11-27T09:00:00Z: windows that it misses are found.",
)
@asset_option()
@json_option
def check(
    file: Path,
    plan_id: str | None,
    arguments: tuple[PlanArgument, ...],
    begin_utc_s: float | None,
    asset: str,
    as_json: bool,
) -> None:
    """Check FILE as an asset would, without a connection; find probable faults.

    Exits 1 if the plan would be refused, or has an error.

    \b
    Examples:
      rover plan check config/plans/look-around.xml
      rover plan check there-and-back.xml --arg far=3 --asset mocup
      rover plan check config/plans/missions/02-relay-passes.xml --at 2026-11-27T10:00:00Z
    """
    definition = definition_of(file, plan_id, arguments)
    plan = _checked(file, definition, asset, as_json)
    found = find_faults(plan, begin_utc_s)
    leaves, commands = len(steps(plan)), max_commands(plan)
    text = f"{definition.plan_id}: {leaves} leaves, {commands} commands at most"
    _print(definition, found, text, as_json, leaves=leaves, commands=commands)


@click.command()
@FILE
@ID
@ARGUMENTS
@asset_option()
@json_option
def prove(
    file: Path, plan_id: str | None, arguments: tuple[PlanArgument, ...], asset: str, as_json: bool
) -> None:
    """Explore all outcomes of FILE: results of steps, telemetry, answers, timers, stops.

    The plan is proved if no outcome has a fault and there is no limit. Exits 1 if the plan
    would be refused, or has an error.

    \b
    Example:
      rover plan prove config/plans/look-around.xml
    """
    from trees.plan import prove as explore  # imports py_trees, which takes long

    definition = definition_of(file, plan_id, arguments)
    proof = explore(_checked(file, definition, asset, as_json))
    text = f"{definition.plan_id}: {proof.verdict}, {proof.states} states, {proof.ticks} ticks"
    text = "\n  limit: ".join([text, *proof.limits])
    figures = {"verdict": proof.verdict, "states": proof.states, "ticks": proof.ticks}
    _print(definition, proof.findings, text, as_json, **figures, limits=list(proof.limits))


def definition_of(
    file: Path, plan_id: str | None, arguments: tuple[PlanArgument, ...]
) -> PlanDefinition:
    """Return the plan of a file; its id is the file's name by default."""
    name = plan_id or file.name.partition(".")[0]
    return PlanDefinition(name, file.name, FORMAT, file.read_bytes(), arguments)


def _checked(file: Path, definition: PlanDefinition, asset: str, as_json: bool) -> PlanRoot:
    try:
        settings = load_settings(asset)
    except SettingsError as error:
        raise click.UsageError(str(error)) from error
    checked = check_plan(definition, settings)
    if isinstance(checked, Refusal):
        refuse(file, checked, as_json)
    return checked


def refuse(file: Path, refusal: Refusal, as_json: bool = False) -> NoReturn:
    """Print why a plan is refused, and exit."""
    reason = refusal.reason
    if as_json:
        echo_json({"refusal": refusal.text, "code": reason.value, "reason": reason.name})
    else:
        click.echo(f"{file}: {reason.value} {reason.name}: {refusal.text}", err=True)
    sys.exit(FAILED)


def _print(
    definition: PlanDefinition,
    findings: Sequence[Finding],
    text: str,
    as_json: bool,
    **figures: Any,
) -> None:
    if as_json:
        rows = [{**asdict(each), "level": each.level.value} for each in findings]
        echo_json({"plan": definition.plan_id, **figures, "findings": rows})
    else:
        click.echo("\n".join([text, *(f"  {each}" for each in findings)]))
    if any(each.level is Level.ERROR for each in findings):
        sys.exit(FAILED)
