"""The command `rover command`: a sub-command for each operator request, from its declaration."""

from collections.abc import Iterable
from enum import Enum
from math import isfinite, pi, radians
from typing import TYPE_CHECKING, Any, Final

import click

from adapters.mrs.cli.options import RoverTarget, json_option, source_option, to_option
from adapters.mrs.cli.terminal import connect, echo_line, run
from executive.commands import (
    Argument,
    CommandDeclaration,
    ExecuteAction,
    Family,
    PreemptionPolicy,
    Waypoint,
    all_declarations,
    arguments_of,
)

if TYPE_CHECKING:
    from adapters.mrs.cli.sending import CommandSender

_OTHER_GROUP_FAMILIES: Final = {Family.PLAN, Family.PLAN_START}
"""Families with a separate command, `rover plan`."""
_UNITS: Final = {"rad": "rad or 90deg", "rad/s": "rad/s or 30deg"}
MAX_ID: Final = (1 << 63) - 1


def angle(text: str) -> float:
    """Return radians from `90deg`, `90°`, `1.57rad` or `1.57`.

    Raises:
        click.BadParameter: not an angle, or a number without unit above one turn: likely degrees.
    """
    angle_rad = angular_speed(text)
    if text[-1:].isdigit() and isfinite(angle_rad) and abs(angle_rad) > 2 * pi:
        raise click.BadParameter(f"{text} rad is more than a turn: write {text}deg for degrees")
    return angle_rad


def angular_speed(text: str) -> float:
    """Return rad/s from an angle text; raises BadParameter."""
    try:
        for unit in ("deg", "°"):
            if text.endswith(unit):
                return radians(float(text.removesuffix(unit)))
        return float(text.removesuffix("rad"))
    except ValueError as error:
        raise click.BadParameter(f"{text!r} is no angle: write 90deg, 1.57rad or 1.57") from error


def waypoint(text: str) -> Waypoint:
    """Return a waypoint from `X,Y`, `X,Y,HEADING` or `X,Y,HEADING,TOLERANCE`.

    HEADING may be empty before a tolerance.
    """
    try:
        match text.split(","):
            case [x, y]:
                return Waypoint(float(x), float(y))
            case [x, y, heading]:
                return Waypoint(float(x), float(y), angle(heading))
            case [x, y, heading, tolerance]:
                heading_rad = angle(heading) if heading else None
                return Waypoint(float(x), float(y), heading_rad, float(tolerance))
            case _:
                raise ValueError(text)
    except ValueError as error:
        raise click.BadParameter(
            f"{text!r} is no waypoint: write X,Y or X,Y,HEADING or X,Y,HEADING,TOLERANCE, e.g."
            " 1,0 or 1,0,90deg or 1,0,,0.1"
        ) from error


_TYPES: Final = {"rad": angle, "rad/s": angular_speed}


class OperationCommand(click.Command):
    """A sub-command that accepts negative numbers as arguments, and explains unknown options."""

    ignore_unknown_options = True

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the command line.

        Raises:
            click.UsageError: an option is unknown, or belongs to the group.
        """
        own = _names(self.get_params(ctx))
        above = set() if ctx.parent is None else _names(ctx.parent.command.params)
        for word in args:
            name = word.partition("=")[0]
            if word == "--":
                break
            if not word.startswith("--") or name in own:
                continue
            if name in above:
                group = f"rover {ctx.parent.command.name}" if ctx.parent else ""
                raise click.UsageError(
                    f"{name} is an option of `{group}`: write it before the operation,"
                    f" `{group} {word} {self.name} ...`",
                    ctx,
                )
            raise click.NoSuchOption(name, possibilities=own, ctx=ctx)
        return super().parse_args(ctx, args)


def _names(parameters: list[click.Parameter]) -> set[str]:
    return {name for each in parameters if isinstance(each, click.Option) for name in each.opts}


def _positive(_: click.Context, __: click.Parameter, seconds: float | None) -> float | None:
    if seconds is not None and not seconds > 0.0:
        raise click.BadParameter(f"{seconds:g} is not a lifetime: give seconds above 0")
    return seconds


@click.group()
@to_option
@source_option
@click.option(
    "--id",
    "command_id",
    type=click.IntRange(1, MAX_ID),
    help="Command number, for a repeat; a new one by default.",
)
@click.option(
    "--lifetime",
    "lifetime_s",
    type=float,
    callback=_positive,
    metavar="SECONDS",
    help="Lifetime from now, after which it must not start.",
)
@click.option(
    "--authority",
    type=click.IntRange(1, MAX_ID),
    metavar="EPOCH",
    help="Authority to claim, e.g. of an orbiter; by default that of the source is requested.",
)
@click.option(
    "--no-wait",
    is_flag=True,
    help="Return at the acknowledgement: of the rover, or of an orbiter that stores the command.",
)
@json_option
@click.pass_context
def command(
    ctx: click.Context,
    to: RoverTarget,
    source: str | None,
    command_id: int | None,
    lifetime_s: float | None,
    authority: int | None,
    no_wait: bool,
    as_json: bool,
) -> None:
    """Command a rover and print each stage.

    Lengths are in metres; angles in radians, or as 90deg. Write options of `command` itself before
    the operation.

    \b
    Examples:
      rover command moveTo 3 2 --heading 90deg
      rover command moveForward -1
      rover command --no-wait followPath 1,0 1,1,90deg
      rover command stop
      rover command resume
      rover command setCameraAngles --pan -45deg
      rover command --to rover.local:21000 takePicture
      rover command action VIDEO ON

    \b
    Exit status: 0 EXECUTED, 1 refused or another result, 2 usage error, 3 rover not reachable.
    """
    from adapters.mrs.cli.sending import CommandSender

    ctx.obj = CommandSender(to, source, command_id, lifetime_s, authority, not no_wait, as_json)


def _operation(declaration: CommandDeclaration) -> click.Command:
    """Return the sub-command of a request."""
    written = declaration.user_arguments
    parameters = parameters_of(declaration)
    if declaration.family is Family.MOTION:
        parameters.append(_replace())

    @click.pass_obj
    def send(
        sending: "CommandSender",
        /,
        preemption: PreemptionPolicy = PreemptionPolicy.APPEND,
        **given: Any,
    ) -> None:
        if declaration.at_least_one and all(value is None for value in given.values()):
            names = ", ".join(f"--{argument.name}" for argument in written)
            raise click.UsageError(f"give at least one of {names}")
        values = (given[argument.field] for argument in written)
        sending.send(declaration.build_request(*values), preemption)

    return OperationCommand(
        declaration.name,
        params=parameters,
        callback=send,
        help=help_of(declaration, parameters, "rover command", declaration.examples),
    )


def parameters_of(declaration: CommandDeclaration) -> list[click.Parameter]:
    """Return the command-line parameters of a request, in the order of its written arguments."""
    return [
        _parameter(argument, declaration.at_least_one) for argument in declaration.user_arguments
    ]


def _parameter(argument: Argument, as_option: bool) -> click.Parameter:
    kind = _type(argument)
    if argument.optional or as_option:
        return click.Option(
            [f"--{argument.name}", argument.field], type=kind, help=_meaning(argument) or None
        )
    if argument.repeated:
        return click.Argument(
            [argument.field],
            metavar=f"{_composite_usage(argument)}...",
            type=kind,
            nargs=-1,
            required=True,
        )
    return click.Argument([argument.field], metavar=argument.name.upper(), type=kind)


class _ChoiceOfValues(click.Choice[Enum]):
    """One of an Enum, typed by its value."""

    def normalize_choice(self, choice: object, ctx: click.Context | None) -> str:
        """Return the text that is compared, of a choice or of the input."""
        return str(choice.value if isinstance(choice, Enum) else choice)


def _type(argument: Argument) -> Any:
    if argument.repeated:
        return waypoint
    if issubclass(argument.kind, Enum):
        return _ChoiceOfValues(argument.kind)
    match argument.choices:
        case range() as numbers:
            return click.IntRange(numbers[0], numbers[-1])
        case tuple() as tokens:
            return click.Choice(tokens, case_sensitive=False)
        case None:
            return _TYPES.get(argument.unit, argument.kind)


def _replace() -> click.Option:
    return click.Option(
        ["--replace", "preemption"],
        flag_value=PreemptionPolicy.REPLACE,
        default=PreemptionPolicy.APPEND,
        type=PreemptionPolicy,
        help="Cancel active and queued motions, instead of appending to the queue.",
    )


def _composite_usage(argument: Argument) -> str:
    """Return the syntax of one composite: X,Y[,HEADING[,TOLERANCE]]."""
    parts = arguments_of(argument.kind)
    needed = ",".join(part.name.upper() for part in parts if not part.optional)
    others = [part.name.upper() for part in parts if part.optional]
    return needed + "".join(f"[,{name}" for name in others) + "]" * len(others)


def _meaning(argument: Argument) -> str:
    unit = _UNITS.get(argument.unit, argument.unit)
    return ", ".join(filter(None, (unit, argument.help)))


def help_of(
    declaration: CommandDeclaration,
    parameters: list[click.Parameter],
    group: str,
    typed: Iterable[str],
) -> str:
    """Return the help of a request's sub-command, with examples from `typed`."""
    shown = [
        part
        for argument, parameter in zip(declaration.user_arguments, parameters, strict=False)
        if isinstance(parameter, click.Argument)
        for part in (arguments_of(argument.kind) if argument.repeated else (argument,))
    ]
    width = max((len(argument.name) for argument in shown), default=0)
    meanings = [f"{each.name.upper():{width}}  {_meaning(each)}".rstrip() for each in shown]
    examples = [f"  {group} {declaration.name} {each}".rstrip() for each in typed]
    paragraphs = [declaration.summary]
    if meanings:
        paragraphs.append("\n".join(("\b", *meanings)))
    if examples:
        title = "Examples:" if len(examples) > 1 else "Example:"
        paragraphs.append("\n".join(("\b", title, *examples)))
    return "\n\n".join(paragraphs)


for _each in all_declarations():
    if _each.family not in _OTHER_GROUP_FAMILIES and _each.kind is not ExecuteAction:
        command.add_command(_operation(_each))


def _action_hints(ctx: click.Context, _: click.Parameter, begun: str) -> list[str]:
    """Return the completions of the typed text among the known actions."""
    from executive.commands.actions import Action

    typed = [*(ctx.params.get("text") or ()), begun]
    known = (each.value.split() for each in Action)
    last = len(typed) - 1
    return sorted(
        {
            tokens[last]
            for tokens in known
            if last < len(tokens)
            and tokens[:last] == [word.upper() for word in typed[:last]]
            and tokens[last].startswith(begun.upper())
        }
    )


@command.command(cls=OperationCommand)
@click.argument("text", metavar="[TEXT]...", nargs=-1, shell_complete=_action_hints)
@click.pass_obj
def action(sending: "CommandSender", text: tuple[str, ...]) -> None:
    """Execute a text command; without one, list the supported ones.

    \b
    Examples:
      rover command action
      rover command action VIDEO ON
      rover command action VIDEO OFF
    """
    if text:
        sending.send(ExecuteAction(" ".join(text)))
    else:
        run(_list(sending))


async def _list(sending: "CommandSender") -> None:
    async with await connect(sending.to, sending.source) as client:
        for offered in await client.list_actions():
            about = "" if offered.value is None else offered.value.value
            echo_line(f"{offered.name:<12} {about}")
