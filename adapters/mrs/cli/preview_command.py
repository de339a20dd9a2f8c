"""The command `rover preview`: predicts a motion or a plan without commanding it."""

from collections.abc import Callable, Coroutine
from functools import partial
from math import degrees
from pathlib import Path
from typing import Any

import click

from adapters.mrs.cli.command_group import OperationCommand, help_of, parameters_of
from adapters.mrs.cli.options import RoverTarget, json_option, to_option
from adapters.mrs.cli.plan_check_command import ARGUMENTS, definition_of
from adapters.mrs.cli.terminal import connect, echo_json, echo_line, run
from adapters.mrs.spec import Preview
from executive.commands import (
    CommandDeclaration,
    Family,
    Motion,
    PlanArgument,
    PlanDefinition,
    all_declarations,
)


async def _show(to: RoverTarget, as_json: bool, request: Motion | PlanDefinition) -> None:
    async with await connect(to) as client:
        if isinstance(request, PlanDefinition):
            found = await client.preview_plan(request)
        else:
            found = await client.preview(request)
    if as_json:
        echo_json(found)
    else:
        for line in preview_lines(found):
            echo_line(line)


@click.group(invoke_without_command=True)
@to_option
@click.option(
    "--plan",
    "file",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="FILE",
    help="A plan, instead of an operation.",
)
@ARGUMENTS
@json_option
@click.pass_context
def preview(
    ctx: click.Context,
    to: RoverTarget,
    file: Path | None,
    arguments: tuple[PlanArgument, ...],
    as_json: bool,
) -> None:
    """Predict a motion or a plan without commanding it.

    The rover computes it from the end of its active and queued motions. It is refused like the
    command, except for mode, queue and authority. A motion of a navigation is predicted along the
    path of its planner; without one along straight lines, which the last line reports. Write
    options of `preview` itself before the operation; --json also prints the path.

    \b
    Examples:
      rover preview moveTo 3 2 --heading 90deg
      rover preview --json followPath 1,0 1,1,90deg
      rover preview --plan config/plans/look-around.xml

    \b
    Exit status: 0 predicted, 1 it would be refused or fail, 2 usage error, 3 rover not reachable.
    """
    ctx.obj = partial(_show, to, as_json)
    if ctx.invoked_subcommand is None and file is None:
        raise click.UsageError("give an operation, or --plan FILE", ctx)
    if ctx.invoked_subcommand is not None and (file is not None or arguments):
        raise click.UsageError("either an operation, or --plan FILE with --arg", ctx)
    if file is not None:
        run(ctx.obj(definition_of(file, None, arguments)))


def preview_lines(found: Preview) -> list[str]:
    """Return a preview as text lines."""
    end = found.path[-1]
    energy = "" if found.energy is None else f", {found.energy:.0f} J"
    lines = [
        f"duration {found.duration:.1f} s, {found.length:.2f} m{energy}",
        f"ends at x {end.x:.2f} m, y {end.y:.2f} m, heading {degrees(end.heading):.1f}°,"
        f" within {found.endUncertainty:.2f} m"
        f" and {degrees(found.headingUncertainty):.1f}° (2 sigma)",
    ]
    if found.clearance is not None:
        lines.append(f"clearance {found.clearance:.2f} m to {found.nearest}")
    if found.note is not None:
        lines.append(found.note)
    return lines


def _operation(declaration: CommandDeclaration) -> click.Command:
    """Return the sub-command for the preview of a motion."""
    parameters = parameters_of(declaration)

    @click.pass_obj
    def request(show: Callable[[Motion], Coroutine[Any, Any, None]], /, **given: Any) -> None:
        run(
            show(
                declaration.build_request(
                    *(given[each.field] for each in declaration.user_arguments)
                )
            )
        )

    typed = [each for each in declaration.examples if "--replace" not in each]
    return OperationCommand(
        declaration.name,
        params=parameters,
        callback=request,
        help=help_of(declaration, parameters, "rover preview", typed),
    )


for _each in all_declarations():
    if _each.family is Family.MOTION:
        preview.add_command(_operation(_each))
