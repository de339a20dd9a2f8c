"""`rover command`: a sub-command for each request that people send, as its declaration says."""

from typing import Any, Final

import click

from adapters.mrs.cli.arguments import Operation, angle, angular_speed, place
from adapters.mrs.cli.options import Target, json_option, to_option
from adapters.mrs.cli.sending import Sending
from adapters.mrs.cli.terminal import SOURCE, connect, run
from executive.commands import (
    Argument,
    Arrival,
    Declaration,
    ExecuteAction,
    Family,
    arguments_of,
    declared,
)

_ELSEWHERE: Final = {Family.PLAN, Family.PLAN_START}
"""Families with a command of their own, `rover plan`."""
_UNITS: Final = {"rad": "rad or 90deg", "rad/s": "rad/s or 30deg"}
_TYPES: Final = {"rad": angle, "rad/s": angular_speed}

LARGEST_ID: Final = (1 << 63) - 1


def _named(_: click.Context, __: click.Parameter, name: str) -> str:
    if not name:
        raise click.BadParameter("a command needs a source: give a name")
    return name


def _positive(_: click.Context, __: click.Parameter, seconds: float | None) -> float | None:
    if seconds is not None and not seconds > 0.0:
        raise click.BadParameter(f"{seconds:g} is no time to live: give seconds above 0")
    return seconds


@click.group()
@to_option
@click.option(
    "--source", default=SOURCE, show_default=True, callback=_named, help="Name to command under."
)
@click.option(
    "--id",
    "command_id",
    type=click.IntRange(1, LARGEST_ID),
    help="Command number, for a repeat; a new one by default.",
)
@click.option(
    "--lifetime",
    "lifetime_s",
    type=float,
    callback=_positive,
    metavar="SECONDS",
    help="Seconds from now after which it must not start.",
)
@click.option(
    "--no-wait",
    is_flag=True,
    help="Return once the command is taken: by the rover, or by an orbiter that stores it.",
)
@json_option
@click.pass_context
def command(
    ctx: click.Context,
    to: Target,
    source: str,
    command_id: int | None,
    lifetime_s: float | None,
    no_wait: bool,
    as_json: bool,
) -> None:
    """Command a rover and watch how it goes, stage by stage.

    Lengths are in metres; angles in radians, or written as 90deg. Options of `command` itself
    stand before the operation.

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
    Exit status: 0 EXECUTED, 1 refused or ended otherwise, 2 makes no sense, 3 cannot be reached.
    """
    ctx.obj = Sending(to, source, command_id, lifetime_s, not no_wait, as_json)


def _operation(declaration: Declaration) -> click.Command:
    """Return the sub-command that a request is sent by."""
    written = declaration.written
    parameters = [_parameter(argument, declaration.at_least_one) for argument in written]
    if declaration.family is Family.MOTION:
        parameters.append(_replace())

    @click.pass_obj
    def send(sending: Sending, /, arrival: Arrival = Arrival.APPEND, **given: Any) -> None:
        if declaration.at_least_one and all(value is None for value in given.values()):
            names = ", ".join(f"--{argument.name}" for argument in written)
            raise click.UsageError(f"give at least one of {names}")
        values = [given[argument.field] for argument in written]
        if declaration.at_least_one:
            values = [
                0.0 if value is None and not argument.optional else value
                for argument, value in zip(written, values, strict=True)
            ]
        sending.send(declaration.make(*values), arrival)

    return Operation(
        declaration.name, params=parameters, callback=send, help=_help(declaration, parameters)
    )


def _parameter(argument: Argument, as_option: bool) -> click.Parameter:
    kind = _type(argument)
    if argument.optional or as_option:
        return click.Option(
            [f"--{argument.name}", argument.field], type=kind, help=_meaning(argument) or None
        )
    if argument.many:
        return click.Argument(
            [argument.field], metavar=f"{_places(argument)}...", type=kind, nargs=-1, required=True
        )
    return click.Argument([argument.field], metavar=argument.name.upper(), type=kind)


def _type(argument: Argument) -> Any:
    if argument.many:
        return place
    match argument.choices:
        case range() as numbers:
            return click.IntRange(numbers[0], numbers[-1])
        case tuple() as words:
            return click.Choice(words, case_sensitive=False)
        case None:
            return _TYPES.get(argument.unit, argument.kind)


def _replace() -> click.Option:
    return click.Option(
        ["--replace", "arrival"],
        flag_value=Arrival.REPLACE,
        default=Arrival.APPEND,
        type=Arrival,
        help="Cancel the motion under way and what waits, instead of queueing behind it.",
    )


def _places(argument: Argument) -> str:
    """Return how one composite is typed: X,Y[,HEADING[,TOLERANCE]]."""
    parts = arguments_of(argument.kind)
    needed = ",".join(part.name.upper() for part in parts if not part.optional)
    others = [part.name.upper() for part in parts if part.optional]
    return needed + "".join(f"[,{name}" for name in others) + "]" * len(others)


def _meaning(argument: Argument) -> str:
    unit = _UNITS.get(argument.unit, argument.unit)
    return ", ".join(filter(None, (unit, argument.help)))


def _help(declaration: Declaration, parameters: list[click.Parameter]) -> str:
    shown = [
        part
        for argument, parameter in zip(declaration.written, parameters, strict=False)
        if isinstance(parameter, click.Argument)
        for part in (arguments_of(argument.kind) if argument.many else (argument,))
    ]
    width = max((len(argument.name) for argument in shown), default=0)
    meanings = [f"{each.name.upper():{width}}  {_meaning(each)}".rstrip() for each in shown]
    examples = [
        f"  rover command {declaration.name} {typed}".rstrip() for typed in declaration.examples
    ]
    paragraphs = [declaration.summary]
    if meanings:
        paragraphs.append("\n".join(("\b", *meanings)))
    if examples:
        title = "Examples:" if len(examples) > 1 else "Example:"
        paragraphs.append("\n".join(("\b", title, *examples)))
    return "\n\n".join(paragraphs)


for _each in declared():
    if _each.family not in _ELSEWHERE and _each.kind is not ExecuteAction:
        command.add_command(_operation(_each))


def _next_words(ctx: click.Context, _: click.Parameter, begun: str) -> list[str]:
    """Return how the actions that are known here go on after what is typed."""
    from executive.commands.actions import Action

    typed = [*(ctx.params.get("words") or ()), begun]
    known = (each.value.split() for each in Action)
    last = len(typed) - 1
    return sorted(
        {
            words[last]
            for words in known
            if last < len(words)
            and words[:last] == [word.upper() for word in typed[:last]]
            and words[last].startswith(begun.upper())
        }
    )


@command.command(cls=Operation)
@click.argument("words", metavar="[TEXT]...", nargs=-1, shell_complete=_next_words)
@click.pass_obj
def action(sending: Sending, words: tuple[str, ...]) -> None:
    """Have a text command done; without one, list what there is.

    \b
    Examples:
      rover command action
      rover command action VIDEO ON
      rover command action VIDEO OFF
    """
    if words:
        sending.send(ExecuteAction(" ".join(words)))
    else:
        run(_list(sending))


async def _list(sending: Sending) -> None:
    async with await connect(sending.to, sending.source) as client:
        for offered in await client.list_actions():
            about = "" if offered.value is None else offered.value.value
            click.echo(f"{offered.name:<12} {about}")
