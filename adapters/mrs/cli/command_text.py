"""`read_command_text` reads the text of a `rover command` as a command of another link."""

import shlex
from typing import Any, Final

import click

from adapters.mrs.cli.command_group import (
    OperationCommand,
    command,
    operation_request,
    sending_option,
)
from executive.commands import Command, ExecuteAction, PreemptionPolicy
from executive.values.reports import Identity

_GROUP: Final = "rover command"
ACTION: Final = "action"


def read_command_text(text: str, identity: Identity, link: str) -> Command:
    """Return the command of a text such as `moveTo 1 2 --heading 90deg --lifetime 10s`.

    Options on the sender and its connection, such as `--to`, do not apply.

    Raises:
        ValueError: the text is no command; the message names the error.
    """
    name, *arguments = shlex.split(text) or [""]
    if name == ACTION and arguments:
        return Command(identity, ExecuteAction(" ".join(arguments)), link)
    group = click.Context(command, info_name=_GROUP)
    try:
        operation = command.get_command(group, name)
        if operation is None or name == ACTION:
            raise command.unknown(group, name) if name else click.UsageError("no command")
        context = _parser_of(operation).make_context(name, arguments, parent=group)
        given: dict[str, Any] = dict(context.params)
        lifetime_s = given.pop(_LIFETIME.name)
        preemption = given.pop("preemption", PreemptionPolicy.APPEND)
        request = operation_request(name, given)
    except click.ClickException as error:
        raise ValueError(error.format_message()) from error
    return Command(identity, request, link, lifetime_s=lifetime_s, preemption=preemption)


_LIFETIME: Final = sending_option("lifetime_s")


def _parser_of(operation: click.Command) -> click.Command:
    """Return the parser of an operation: with its own parameters, and the lifetime."""
    own = [each for each in operation.params if not getattr(each, "hidden", False)]
    return OperationCommand(operation.name, params=[*own, _LIFETIME], add_help_option=False)
