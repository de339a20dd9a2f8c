"""Sends one command from a terminal, and prints its stages."""

import asyncio
import sys
from dataclasses import dataclass
from typing import Final

import click

from adapters.mal import MalError
from adapters.mrs.cli.options import RoverTarget
from adapters.mrs.cli.terminal import FAILED, clock, connect, echo_json, echo_line
from adapters.mrs.ground import CommandOutcome, MrsClient, describe_storage
from adapters.mrs.spec import (
    AreaError,
    Notification,
    Stage,
    describe_error,
    is_prediction,
    lost_command,
)
from executive.commands import Command, PreemptionPolicy, Request, Stop
from executive.values.reasons import PREDICTED, Reason
from executive.values.reports import TERMINAL


@dataclass(frozen=True, slots=True)
class CommandSender:
    """Sends commands with the options of `rover command`.

    Attributes:
        command_id: the number to use; None for a new one.
        authority: the epoch to claim, e.g. of an orbiter; None for this source's own.
        wait, as_json: whether to wait for its end, and to print notifications as JSON.
    """

    to: RoverTarget
    source: str | None = None
    command_id: int | None = None
    lifetime_s: float | None = None
    authority: int | None = None
    wait: bool = True
    as_json: bool = False

    def send(self, request: Request, arrival: PreemptionPolicy = PreemptionPolicy.APPEND) -> None:
        """Send a request and print each stage; exits 1 unless it ends EXECUTED.

        Raises:
            ConnectionError: the rover is not reachable.
        """
        if not asyncio.run(self._send(request, arrival)):
            sys.exit(FAILED)

    async def _send(self, request: Request, arrival: PreemptionPolicy) -> bool:
        async with await connect(self.to, self.source) as client:
            if not await self._is_authorized(client, request):
                return False
            command = client.command(
                request, command_id=self.command_id, lifetime_s=self.lifetime_s, arrival=arrival
            )
            source, number = command.identity.source, command.identity.command_id
            self._print(
                f"{command.identity} {command.name}",
                {"source": source, "commandId": number, "command": command.name},
            )
            try:
                return await (self._run if self.wait else self._submit)(client, command)
            except asyncio.CancelledError:
                click.echo(
                    f"{command.identity} may continue: `rover command stop` ends it", err=True
                )
                raise

    async def _is_authorized(self, client: MrsClient, request: Request) -> bool:
        """Request the authority if it is needed and free; a stop does not need it."""
        if self.authority is not None:
            client.authority.epoch = self.authority
        elif not isinstance(request, Stop):
            try:
                await client.authority.ensure()
            except MalError as refusal:
                echo_line(
                    f"refused: {describe_error(refusal)}", word="refused:", fg="red", err=True
                )
                return False
        return True

    def _print(self, line: str, value: object, word: str = "", fg: str | None = None) -> None:
        if self.as_json:
            echo_json(value)
        else:
            echo_line(line, word=word, fg=fg)

    def _print_notification(self, notification: Notification) -> None:
        word, fg = _stage_word(notification)
        self._print(notification_line(notification), notification, word, fg)

    async def _run(self, client: MrsClient, command: Command) -> bool:
        outcome = await client.run(
            command,
            self._print_notification,
            lambda where: self._print(f"{clock()}  STORED     {where}", {"stored": where}),
        )
        printed = outcome.stage is Stage.REJECTED or outcome.loss is not None
        if outcome.refusal is not None and not printed:
            echo_line(
                f"refused: {await _refusal(client, outcome)}", word="refused:", fg="red", err=True
            )
        return outcome.executed

    async def _submit(self, client: MrsClient, command: Command) -> bool:
        try:
            await client.submit(command)
        except MalError as refusal:
            echo_line(f"refused: {describe_error(refusal)}", word="refused:", fg="red", err=True)
            return False
        where = await describe_storage(client.get_value)
        self._print(
            "acknowledged" if where is None else f"stored {where}", {"taken": True, "stored": where}
        )
        return True


async def _refusal(client: MrsClient, outcome: CommandOutcome) -> str:
    """Return the reason why a command was not accepted; a repeat repeats its last report."""
    assert outcome.refusal is not None
    identity = outcome.command.identity
    if outcome.refusal.number != AreaError.DUPLICATE.value:
        return describe_error(outcome.refusal)
    if outcome.notifications:
        stop = isinstance(outcome.command.request, Stop)
        done = "the rover was stopped again" if stop else "not executed again"
        return f"Duplicate: {identity} is a repeat and {done}; its last stage is printed above"
    where = await describe_storage(client.get_value)
    if where is None:
        return (
            f"Duplicate: {identity} was accepted before, as this or another command, and is not"
            " executed again: choose a new number"
        )
    return (
        f"Duplicate: {identity} was accepted before, {where}; there is no report yet, or it was"
        " another command"
    )


def notification_line(notification: Notification) -> str:
    """Return a notification as one line: on-board time, stage, reason, text and figures."""
    name, _ = _stage_word(notification)
    parts = []
    if notification.step is not None:
        parts.append(f"{notification.step}/{notification.stepCount}")
    if notification.code is not None:
        parts.append(f"{notification.code} {_reason(notification.code)}:")
    parts.append(notification.text or "")
    figures = _figures(notification)
    if figures and not is_prediction(notification):
        parts.append(f"[{', '.join(figures)}]")
    return f"{clock(notification.timestamp)}  {name:<9}  {' '.join(parts)}"


def _figures(notification: Notification) -> list[str]:
    """Return the figures of a notification, each with its prediction, if any."""
    known = {
        figure.name: figure.value.value
        for figure in notification.parameters or ()
        if figure.value is not None and isinstance(figure.value.value, float)
    }
    return [
        f"{name} {value:g} (predicted {known[PREDICTED + name]:g})"
        if PREDICTED + name in known
        else f"{name} {value:g}"
        for name, value in known.items()
        if not (name.startswith(PREDICTED) and name.removeprefix(PREDICTED) in known)
    ]


def _stage_word(notification: Notification) -> tuple[str, str | None]:
    """Return the label of a command's stage, and its colour if it has ended."""
    stage = notification.stage
    if lost_command(notification) is not None:
        return "LOST", "red"
    if is_prediction(notification):
        return "PREDICTED", None
    if stage is None:
        return notification.severity.name, None
    return stage.name, _COLOURS.get(stage)


_COLOURS: Final = {stage: "green" if stage is Stage.EXECUTED else "red" for stage in TERMINAL}


def _reason(code: int) -> str:
    try:
        return Reason(code).name
    except ValueError:
        return "unknown here"
