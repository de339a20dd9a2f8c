"""Every operation that carries a command: Motion Control, Camera, and Status's interval.

This is the stop path. Between the octets and the core's inbox lie the decoding of the message, the
making of one command and one future, and nothing else.
"""

from collections.abc import Awaitable, Callable
from functools import partial
from typing import Any, Protocol

from adapters.mal import Call
from adapters.mrs.aboard.served_operations import ServedOperations
from adapters.mrs.spec import REQUESTS, CommandHeader, command_of
from executive.commands import Command, Request


class CommandIntake(Protocol):
    """What takes commands: the core aboard, or who passes them on."""

    def submit(self, command: Command) -> Awaitable[None]:
        """Take a command; raises MalError, here or when it is awaited, if it is not taken."""
        ...


def serve_commands(
    offer: ServedOperations,
    intake: CommandIntake,
    known: Callable[[str, str], bool] = lambda *_: True,
) -> None:
    """Put up operations of `REQUESTS`; each is acknowledged when the intake has taken it.

    Args:
        offer: where.
        intake: what takes commands.
        known: whether an operation of a service is put up, too; all are, unless this is given.
    """
    for (service, operation), make in REQUESTS.items():
        if known(service, operation):
            offer.serve(service, operation, partial(_submit, intake, make))


def _submit(
    intake: CommandIntake,
    make: Callable[..., Request],
    call: Call,
    header: CommandHeader,
    *parts: Any,
) -> Awaitable[None]:
    return intake.submit(command_of(header, call.supplements, make(*parts)))
