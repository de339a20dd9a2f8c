"""`read_command_text` reads the text of a `rover command` as a command of another link."""

import shlex
from typing import Final

import click

from adapters.mrs.cli.command_group import SENDING_OPTIONS, OperationCommand, command, request_of
from executive.commands import Command, ExecuteAction, PreemptionPolicy, all_declarations
from executive.values.reports import Identity

_LIFETIME: Final = next(each for each in SENDING_OPTIONS if each.name == "lifetime_s")


def read_command_text(text: str, identity: Identity, link: str) -> Command:
    """Return the command of a text such as `moveTo 1 2 --heading 90deg --lifetime 10s`.

    Options on the sender and its connection, such as `--to`, do not apply.

    Raises:
        ValueError: the text is no command; the message names the error.
    """
    name, *arguments = shlex.split(text) or ["?"]
    if name == "action" and arguments:
        return Command(identity, ExecuteAction(" ".join(arguments)), link)
    group = click.Context(command, info_name="rover command")
    operation = command.get_command(group, name)
    declaration = next((each for each in all_declarations() if each.name == name), None)
    try:
        if operation is None or declaration is None:
            raise command.unknown(group, name)
        own = [each for each in operation.params if not getattr(each, "hidden", False)]
        parser = OperationCommand(name, params=[*own, _LIFETIME], add_help_option=False)
        given = dict(parser.make_context(name, arguments, parent=group).params)
        lifetime_s = given.pop("lifetime_s")
        preemption = given.pop("preemption", PreemptionPolicy.APPEND)
        request = request_of(declaration, given)
    except click.ClickException as error:
        raise ValueError(error.format_message()) from error
    return Command(identity, request, link, lifetime_s=lifetime_s, preemption=preemption)
