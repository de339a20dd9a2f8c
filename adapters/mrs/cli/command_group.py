"""The command `rover command`: a sub-command for each operator request, from its declaration."""

from collections.abc import Callable, Iterable, Iterator
from copy import copy
from difflib import get_close_matches
from enum import Enum
from functools import wraps
from typing import TYPE_CHECKING, Any, Final

import click
from click.core import ParameterSource

from adapters.mrs.cli.options import (
    QuantityType,
    RoverTarget,
    json_option,
    source_option,
    to_option,
)
from adapters.mrs.cli.terminal import connect, echo_line, run
from executive.commands import (
    Argument,
    CommandDeclaration,
    ExecuteAction,
    Family,
    Mode,
    OnlyAt,
    Precondition,
    PreemptionPolicy,
    Request,
    Waypoint,
    all_declarations,
    arguments_of,
)
from executive.values.quantities import UNITS, QuantityError, read_quantity

if TYPE_CHECKING:
    from adapters.mrs.cli.sending import CommandSender

_OTHER_GROUP_FAMILIES: Final = {Family.PLAN, Family.PLAN_START}
"""Families with a separate command, `rover plan`."""
_UNITS: Final = {"m": "m or 50cm", "rad": "90deg or 1.57rad", "rad/s": "30deg/s or 0.5rad/s"}
MAX_ID: Final = (1 << 63) - 1


class WaypointType(click.ParamType[Waypoint]):
    """`X,Y`, `X,Y,HEADING` or `X,Y,HEADING,TOLERANCE`; HEADING may be empty before a tolerance."""

    name = "waypoint"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return a `Waypoint`."""
        parts = str(value).split(",")
        if not 2 <= len(parts) <= len(_WAYPOINT_UNITS):
            self.fail(f"{value!r} is no waypoint: {_WAYPOINT}", param, ctx)
        try:
            read = [
                read_quantity(text, unit, bare=unit != "rad") if text or unit != "rad" else None
                for text, unit in zip(parts, _WAYPOINT_UNITS, strict=False)
            ]
        except QuantityError as error:
            self.fail(f"{value!r} is no waypoint: {error}; {_WAYPOINT}", param, ctx)
        return Waypoint(*read)  # type: ignore[arg-type]


_WAYPOINT_UNITS: Final = ("m", "m", "rad", "m")
_WAYPOINT: Final = (
    "write X,Y or X,Y,HEADING or X,Y,HEADING,TOLERANCE, e.g. 1,0 or 1,0,90deg or 1,0,,0.1"
)


class OperationCommand(click.Command):
    """A sub-command that accepts negative numbers as arguments, and explains unknown options.

    A unit may follow its number as a separate word: `moveForward 1 m`.
    """

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
            near = get_close_matches(name, own, 1)
            raise click.NoSuchOption(name, possibilities=near, ctx=ctx)
        written = [each for each in self.params if isinstance(each, click.Argument)]
        is_textual = any(each.type is click.STRING for each in written)
        return super().parse_args(ctx, args if is_textual else list(_joined(args)))


def _joined(texts: Iterable[str]) -> Iterator[str]:
    """Yield the arguments, each number together with its unit."""
    number = ""
    for text in texts:
        if number and text not in _UNIT_NAMES:
            yield number
            number = ""
        number += text
        if not number[-1:].isdigit() or number.startswith("--"):
            yield number
            number = ""
    if number:
        yield number


_UNIT_NAMES: Final = {unit for units in UNITS.values() for unit in units}


def _names(parameters: list[click.Parameter]) -> set[str]:
    return {name for each in parameters if isinstance(each, click.Option) for name in each.opts}


def _only_at(_: click.Context, __: click.Parameter, text: str | None) -> OnlyAt | None:
    try:
        return None if text is None else OnlyAt.read(text)
    except ValueError as error:
        raise click.BadParameter(str(error)) from error


def _positive(_: click.Context, __: click.Parameter, seconds: float | None) -> float | None:
    if seconds is not None and not seconds > 0.0:
        raise click.BadParameter(f"{seconds:g} is not a lifetime: give seconds above 0")
    return seconds


class OperationGroup(click.Group):
    """Commands by operation; an unknown name gets the similar ones, or the one that does it."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the named sub-command.

        Raises:
            click.UsageError: there is none.
        """
        if not ctx.resilient_parsing and self.get_command(ctx, args[0]) is None:
            raise self.unknown(ctx, args[0])
        return super().resolve_command(ctx, args)

    def unknown(
        self, ctx: click.Context, name: str, others: Iterable[str] = ()
    ) -> click.UsageError:
        """Return the error for an unknown name, which may also be meant for one of `others`."""
        meant = _SYNONYMS.get(name.lower())
        if meant is not None:
            return click.UsageError(f"No such command {name!r}. Use {meant}", ctx)
        return click.exceptions.NoSuchCommand(
            name, possibilities=[*self.list_commands(ctx), *others], ctx=ctx
        )


_SYNONYMS: Final = {
    **dict.fromkeys(
        ("abort", "halt", "cancel", "estop", "freeze"),
        "`rover stop`; for a plan `rover plan abort`.",
    ),
    **dict.fromkeys(("pause", "suspend", "wait"), "`rover plan suspend`, or `rover stop`."),
    **dict.fromkeys(("home", "goto", "go", "return"), "`rover moveTo X Y`, e.g. moveTo 0 0."),
    **dict.fromkeys(("forward", "move", "backward"), "`rover moveForward DISTANCE`."),
    **dict.fromkeys(("turn", "rotate"), "`rover rotateBy 90deg`, or rotateTo."),
    **dict.fromkeys(("photo", "picture", "snapshot"), "`rover takePicture`."),
    **dict.fromkeys(("continue", "release", "unstop"), "`rover resume`."),
}
"""What operators of other systems type, and what does it here."""


def _refuse_asset(ctx: click.Context, _: click.Parameter, name: str | None) -> None:
    if name is not None:
        raise click.UsageError(
            f"a command goes to one rover: name it by --to HOST:PORT, not by --asset {name};"
            " `rover status --assets` lists those that a rover knows",
            ctx,
        )


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
    type=QuantityType("s"),
    callback=_positive,
    metavar="TIME",
    help="Lifetime from now, after which it must not start: 30, 30s or 10min.",
)
@click.option(
    "--only-at",
    callback=_only_at,
    metavar="X,Y,WITHIN[,HEADING,WITHIN]",
    help="Refuse it unless the rover is there at its start: 3,2,0.5 or 3,2,0.5,90deg,10deg.",
)
@click.option(
    "--only-after",
    type=click.IntRange(1, MAX_ID),
    metavar="NUMBER",
    help="Refuse it unless this command of the same source has been EXECUTED.",
)
@click.option(
    "--only-mode",
    type=click.Choice(tuple(Mode.__members__), case_sensitive=False),
    help="Refuse it unless the rover is in this mode.",
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
@click.option("--asset", callback=_refuse_asset, expose_value=False, hidden=True)
def _sender(
    to: RoverTarget,
    source: str | None,
    command_id: int | None,
    lifetime_s: float | None,
    only_at: OnlyAt | None,
    only_after: int | None,
    only_mode: str | None,
    authority: int | None,
    no_wait: bool,
    as_json: bool,
) -> "CommandSender":
    """Return the sender of a command, from the options of `rover command`."""
    from adapters.mrs.cli.sending import CommandSender

    mode = None if only_mode is None else Mode[only_mode]
    only = Precondition(only_at, only_after, mode)
    return CommandSender(
        to, source, command_id, lifetime_s, authority, not no_wait, as_json, only or None
    )


SENDING_OPTIONS: Final = tuple(click.command()(_sender).params)
"""The options of `_sender`, in the order of their help."""
_SENDING_NAMES: Final = [each.name or "" for each in SENDING_OPTIONS if each.expose_value]


def sending(callback: Callable[..., None]) -> Callable[..., None]:
    """Pass a `CommandSender` to a command, made from its own options and those of its group."""

    @click.pass_context
    @wraps(callback)
    def with_sender(ctx: click.Context, /, **given: Any) -> None:
        own = {name: given.pop(name) for name in _SENDING_NAMES}
        above = ctx.parent.params if ctx.parent is not None else {}
        for name in own:
            if ctx.get_parameter_source(name) is not ParameterSource.COMMANDLINE:
                own[name] = above.get(name, own[name])
        callback(_sender(**own), **given)

    return with_sender


class SendingCommand(OperationCommand):
    """An operation, with the options of `rover command`, which its help does not repeat."""

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        shown = (each.opts[0] for each in SENDING_OPTIONS if each.expose_value)
        self.epilog = f"The options of `rover command` work here, too: {', '.join(shown)}."
        for option in map(copy, SENDING_OPTIONS):
            option.hidden = True  # type: ignore[attr-defined]
            self.params.append(option)


@click.group(cls=OperationGroup, params=list(SENDING_OPTIONS))
def command(**_: Any) -> None:
    """Command a rover and print each stage.

    Lengths are in metres, or as 50cm; angles need a unit: 90deg or 1.57rad. Each operation is also
    a command of `rover` itself.

    \b
    Examples:
      rover command moveTo 3 2 --heading 90deg
      rover moveTo 3 2 --heading 90deg
      rover command moveForward -50cm
      rover command followPath 1,0 1,1,90deg --no-wait
      rover command stop
      rover command resume
      rover command setCameraAngles --pan -45deg
      rover command takePicture --to rover.local:21000
      rover command action VIDEO ON

    \b
    Exit status: 0 EXECUTED, 1 refused or another result, 2 usage error, 3 rover not reachable.
    """


def _operation(declaration: CommandDeclaration) -> click.Command:
    """Return the sub-command of a request."""
    parameters = parameters_of(declaration)
    if declaration.family is Family.MOTION:
        parameters.append(_replace())

    @sending
    def send(
        sender: "CommandSender",
        /,
        preemption: PreemptionPolicy = PreemptionPolicy.APPEND,
        **given: Any,
    ) -> None:
        sender.send(request_of(declaration, given), preemption)

    return SendingCommand(
        declaration.name,
        params=parameters,
        callback=send,
        help=help_of(declaration, parameters, "rover command", declaration.examples),
    )


def request_of(declaration: CommandDeclaration, given: dict[str, Any]) -> Request:
    """Return the request of the given values.

    Raises:
        click.UsageError: all are missing, and it needs one.
    """
    written = declaration.user_arguments
    if declaration.at_least_one and all(value is None for value in given.values()):
        names = ", ".join(f"--{argument.name}" for argument in written)
        raise click.UsageError(f"give at least one of {names}")
    request: Request = declaration.build_request(*(given[each.field] for each in written))
    return request


def parameters_of(declaration: CommandDeclaration) -> list[click.Parameter]:
    """Return the command-line parameters of a request, in the order of its written arguments."""
    options = declaration.at_least_one
    required = [each for each in declaration.user_arguments if not (each.optional or options)]
    return [
        _parameter(each, options, is_only=[each] == required or each not in required)
        for each in declaration.user_arguments
    ]


def _parameter(argument: Argument, as_option: bool, is_only: bool) -> click.Parameter:
    """Return a parameter; `is_only` accepts a decimal comma, as no other number follows it."""
    kind = _type(argument, is_only)
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


def _type(argument: Argument, is_only: bool) -> Any:
    if argument.repeated:
        return WaypointType()
    if issubclass(argument.kind, Enum):
        return _ChoiceOfValues(argument.kind)
    match argument.choices:
        case range() as numbers:
            return click.IntRange(numbers[0], numbers[-1])
        case tuple() as tokens:
            return click.Choice(tokens, case_sensitive=False)
        case None:
            is_quantity = argument.kind is float
            return QuantityType(argument.unit, comma=is_only) if is_quantity else argument.kind


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


@command.command(cls=SendingCommand)
@click.argument("text", metavar="[TEXT]...", nargs=-1, shell_complete=_action_hints)
@sending
def action(sender: "CommandSender", text: tuple[str, ...]) -> None:
    """Execute a text command; without one, list the supported ones.

    \b
    Examples:
      rover command action
      rover command action VIDEO ON
      rover command action VIDEO OFF
    """
    if text:
        sender.send(ExecuteAction(" ".join(text)))
    else:
        run(_list(sender))


async def _list(sender: "CommandSender") -> None:
    async with await connect(sender.to, sender.source) as client:
        for offered in await client.list_actions():
            about = "" if offered.value is None else offered.value.value
            echo_line(f"{offered.name:<12} {about}")


@click.command(cls=SendingCommand)
@sending
def resume(sender: "CommandSender") -> None:
    """Let a stopped or paused rover continue: by `resume`, or by `resumePlan` of its plan.

    \b
    Example:
      rover resume
    """
    from adapters.mrs.cli.sending import request_to_resume

    sender.send_chosen(request_to_resume)


operations: Final = OperationGroup("rover", {**command.commands, "resume": resume})
"""The operations as commands of `rover` itself; its `resume` chooses between two operations."""
