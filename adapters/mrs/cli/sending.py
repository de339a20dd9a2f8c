"""Sends one command for a person at a terminal, and tells how it goes."""

import asyncio
import sys
from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING, Final

import click

from adapters.mal import CertificateError
from adapters.mrs.cli.target import Target
from adapters.mrs.terms import TermsError
from executive.commands import Arrival, Command, Request

if TYPE_CHECKING:
    from adapters.mrs.ground import MrsClient, Outcome
    from adapters.mrs.spec import Notification

FAILED: Final = 1
HINT: Final = (
    "start a rover with `rover demo --stay` (add --relay for one behind the orbiter), or say where"
    " one is with --to"
)
TERMS_HINT: Final = (
    "say how it is spoken to with --certificate, --key and --authorities (or without them), and"
    " --encoding"
)


@dataclass(frozen=True, slots=True)
class Sending:
    """How commands are to be sent, as the options of `rover command` say.

    Attributes:
        to: the rover.
        command_id: the number to use; None for a new one.
        wait: whether to wait for the end of the command.
    """

    to: Target
    source: str
    command_id: int | None
    lifetime_s: float | None
    wait: bool

    def send(self, request: Request, arrival: Arrival = Arrival.APPEND) -> None:
        """Send a request and print each stage of its life; exits 1 unless it ends EXECUTED.

        Raises:
            ConnectionError: the rover cannot be reached.
        """
        if not asyncio.run(self._send(request, arrival)):
            sys.exit(FAILED)

    async def _send(self, request: Request, arrival: Arrival) -> bool:
        from adapters.mrs.ground import MrsClient

        async with await connect(MrsClient, self.to, self.source) as client:
            command = client.command(
                request,
                command_id=self.command_id,
                lifetime_s=self.lifetime_s,
                arrival=arrival,
            )
            click.echo(f"{command.identity} {command.name}")
            try:
                return await (_run if self.wait else _submit)(client, command)
            except asyncio.CancelledError:
                click.echo(
                    f"{command.identity} may go on aboard: `rover command stop` ends it", err=True
                )
                raise


async def connect(client: "type[MrsClient]", to: Target, source: str) -> "MrsClient":
    """Connect for a person: an address that is none is a usage error, and a silent rover a hint."""
    from adapters.mrs.ground import UnknownHostError

    try:
        return await client.connect(to.uri, source, terms=to.terms)
    except ValueError as error:
        raise click.UsageError(f"--to: {error}") from error
    except CertificateError as error:
        raise click.UsageError(f"TLS: {error}") from error
    except TermsError as error:
        raise ConnectionError(f"{error}; {TERMS_HINT}") from error
    except UnknownHostError as error:
        raise ConnectionError(f"{error}: look at --to, or at ROVER_URI") from error
    except ConnectionError as error:
        raise ConnectionError(f"{error}; {HINT}") from error


async def _run(client: "MrsClient", command: Command) -> bool:
    from adapters.mrs.spec import Stage

    def on_stored(where: str) -> None:
        click.echo(f"{_clock(datetime.now())}  STORED     {where}")

    outcome = await client.run(
        command, lambda notification: click.echo(notification_line(notification)), on_stored
    )
    told = outcome.stage is Stage.REJECTED or outcome.given_up is not None
    if outcome.refusal is not None and not told:
        click.secho(f"refused: {await _refusal(client, outcome)}", fg="red", err=True)
    return outcome.executed


async def _refusal(client: "MrsClient", outcome: "Outcome") -> str:
    """Return why a command was not taken; a repeat is known by its report, which comes again."""
    from adapters.mrs.ground import where_stored
    from adapters.mrs.spec import AreaError, describe_error

    assert outcome.refusal is not None
    identity = outcome.command.identity
    if outcome.refusal.number != AreaError.DUPLICATE.value:
        return describe_error(outcome.refusal)
    if outcome.life:
        return f"Duplicate: {identity} is a repeat and not done again; above is how far it had come"
    where = await where_stored(client.get_value)
    if where is None:
        return f"Duplicate: {identity} was another command before: take another number"
    return (
        f"Duplicate: {identity} was taken before, {where}; nothing was heard of it yet, or it was"
        " another command"
    )


async def _submit(client: "MrsClient", command: Command) -> bool:
    from adapters.mal import MalError
    from adapters.mrs.ground import where_stored
    from adapters.mrs.spec import describe_error

    try:
        await client.submit(command)
    except MalError as refusal:
        click.secho(f"refused: {describe_error(refusal)}", fg="red", err=True)
        return False
    where = await where_stored(client.get_value)
    click.echo("taken" if where is None else f"stored {where}")
    return True


def notification_line(notification: "Notification") -> str:
    """Return a notification as one line: time aboard, stage, text, and why with its figures."""
    from adapters.mrs.ground import TERMINAL
    from adapters.mrs.spec import Stage, given_up

    time = _clock(datetime.fromtimestamp(notification.timestamp / 1e9))
    stage = notification.stage
    name = stage.name if stage else notification.severity.name
    if stage in TERMINAL:
        name = click.style(f"{name:<9}", fg="green" if stage is Stage.EXECUTED else "red")
    elif given_up(notification) is not None:
        name = click.style("GIVEN UP ", fg="red")
    said = [time, f"{name:<9}"]
    if notification.step is not None:
        said.append(f"{notification.step}/{notification.stepCount}")
    if notification.code is not None:
        said.append(f"{notification.code} {_reason(notification.code)}:")
    said.append(notification.text or "")
    figures = [
        f"{figure.name} {figure.value.value:g}"
        for figure in notification.parameters or ()
        if figure.value is not None and isinstance(figure.value.value, float)
    ]
    if figures:
        said.append(f"[{', '.join(figures)}]")
    return "  ".join(said[:2]) + "  " + " ".join(said[2:])


def _clock(time: datetime) -> str:
    return f"{time:%H:%M:%S}.{time.microsecond // 1000:03d}"


def _reason(code: int) -> str:
    from executive.reasons import Reason

    try:
        return Reason(code).name
    except ValueError:
        return "unknown here"
