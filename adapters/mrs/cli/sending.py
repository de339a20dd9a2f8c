"""`CommandSender` sends one command from a terminal, and prints its stages."""

import asyncio
import sys
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Final

import click

from adapters.mal import MalError
from adapters.mrs.cli.options import RoverTarget
from adapters.mrs.cli.status_command import suspended_plans
from adapters.mrs.cli.terminal import FAILED, clock, connect, echo_json, echo_line
from adapters.mrs.ground import CommandOutcome, MrsClient, describe_storage
from adapters.mrs.spec import (
    AreaError,
    AssetMode,
    ReceivedReport,
    describe_error,
    lost_command,
    notification_of,
)
from executive.commands import (
    Command,
    Precondition,
    PreemptionPolicy,
    Request,
    Resume,
    ResumePlan,
    Stop,
)
from executive.values.quantities import quantity_text
from executive.values.reasons import PREDICTED
from executive.values.reports import TERMINAL, Report, Stage

RequestChoice = Callable[[MrsClient], Awaitable[Request]]


@dataclass(frozen=True, slots=True)
class CommandSender:
    """Sends commands with the options of `rover command`.

    Attributes:
        command_id: the number to use; None for a new one.
        authority: the epoch to claim, e.g. of an orbiter; None for this source's own.
        wait, as_json: whether to wait for its end, and to print reports as JSON.
        precondition: condition of its execution; None for none.
    """

    to: RoverTarget
    source: str | None = None
    command_id: int | None = None
    lifetime_s: float | None = None
    authority: int | None = None
    wait: bool = True
    as_json: bool = False
    precondition: Precondition | None = None

    def send(
        self, request: Request, preemption: PreemptionPolicy = PreemptionPolicy.APPEND
    ) -> None:
        """Send a request and print each stage; exits 1 unless it ends EXECUTED.

        Raises:
            ConnectionError: the rover is not reachable.
        """

        async def choose(_: MrsClient) -> Request:
            return request

        self.send_chosen(choose, preemption)

    def send_chosen(
        self, choose: RequestChoice, preemption: PreemptionPolicy = PreemptionPolicy.APPEND
    ) -> None:
        """Send the request that is chosen once connected; otherwise as `send`."""
        if not asyncio.run(self._send(choose, preemption)):
            sys.exit(FAILED)

    async def _send(self, choose: RequestChoice, preemption: PreemptionPolicy) -> bool:
        async with await connect(self.to, self.source) as client:
            request = await choose(client)
            if not await self._is_authorized(client, request):
                return False
            command = client.command(
                request,
                command_id=self.command_id,
                lifetime_s=self.lifetime_s,
                preemption=preemption,
                precondition=self.precondition,
            )
            source, number = command.identity.source, command.identity.command_id
            self._print(
                f"{command.identity} {command.name}",
                {"source": source, "commandId": number, "command": command.name},
            )
            try:
                return await (self._run if self.wait else self._submit)(client, command)
            except asyncio.CancelledError:
                click.echo(f"{command.identity} may continue: `rover stop` ends it", err=True)
                raise

    async def _is_authorized(self, client: MrsClient, request: Request) -> bool:
        """Request the authority if it is needed and free; a stop does not need it."""
        if self.authority is not None:
            client.authority.epoch = self.authority
        elif not isinstance(request, Stop):
            try:
                await client.authority.ensure()
            except MalError as refusal:
                _echo_refused(describe_error(refusal))
                return False
        return True

    def _print(self, line: str, value: object, word: str = "", fg: str | None = None) -> None:
        if self.as_json:
            echo_json(value)
        else:
            echo_line(line, word=word, fg=fg)

    def _print_report(self, received: ReceivedReport) -> None:
        word, fg = _stage_word(received.report)
        value = notification_of(received.report, received.cursor)
        self._print(report_line(received.report), value, word, fg)

    async def _run(self, client: MrsClient, command: Command) -> bool:
        outcome = await client.run(
            command,
            self._print_report,
            lambda where: self._print(f"{clock()}  STORED     {where}", {"stored": where}),
        )
        printed = outcome.stage is Stage.REJECTED or outcome.loss is not None
        if outcome.refusal is not None and not printed:
            _echo_refused(await _refusal(client, outcome))
        return outcome.executed

    async def _submit(self, client: MrsClient, command: Command) -> bool:
        try:
            await client.submit(command)
        except MalError as refusal:
            _echo_refused(describe_error(refusal))
            return False
        where = await describe_storage(client.get_value)
        self._print(
            "acknowledged" if where is None else f"stored {where}",
            {"acknowledged": True, "stored": where},
        )
        return True


def _echo_refused(why: str) -> None:
    echo_line(f"refused: {why}", word="refused:", fg="red", err=True)


async def _refusal(client: MrsClient, outcome: CommandOutcome) -> str:
    """Return the reason why a command was not accepted; a repeat repeats its last report."""
    assert outcome.refusal is not None
    identity = outcome.command.identity
    if outcome.refusal.number != AreaError.DUPLICATE.value:
        return describe_error(outcome.refusal)
    if outcome.reports:
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


def report_line(report: Report) -> str:
    """Return a report as one line: on-board time, stage, reason, text and figures."""
    name, _ = _stage_word(report)
    parts = []
    if report.step is not None:
        parts.append(f"{report.step}/{report.step_count}")
    if report.reason is not None:
        parts.append(f"{report.reason.value} {report.reason.name}:")
    parts.append(report.text)
    if figures := _figures(report):
        parts.append(f"[{', '.join(figures)}]")
    return f"{clock(report.utc_s)}  {name:<9}  {' '.join(parts)}"


def _figures(report: Report) -> list[str]:
    """Return the figures of a motion that an operator compares, each with its prediction, if any.

    Other figures are in the text, with their units, which a notification does not carry.
    """
    known = {figure.name: figure.value for figure in report.figures}
    return [
        f"{name} {quantity_text(known[name], unit, '.2f')}"
        + (
            f" (predicted {quantity_text(known[PREDICTED + name], unit, '.2f')})"
            if PREDICTED + name in known
            else ""
        )
        for name, unit in _MOTION_FIGURES.items()
        if name in known and report.stage is Stage.EXECUTED
    ]


_MOTION_FIGURES: Final = {
    "duration": "s",
    "length": "m",
    "position error": "m",
    "heading error": "rad",
}


def _stage_word(report: Report) -> tuple[str, str | None]:
    """Return the label of a command's stage, and its colour if it has ended."""
    if lost_command(report) is not None:
        return "LOST", "red"
    if report.stage is None:
        return "PREDICTED", None
    return report.stage.name, _COLOURS.get(report.stage)


_COLOURS: Final = {stage: "green" if stage is Stage.EXECUTED else "red" for stage in TERMINAL}


async def request_to_resume(client: MrsClient) -> Request:
    """Return `resume`, or `resumePlan` of the suspended plan if nothing else stops the rover.

    Prints the choice. An orbiter, which does not know the mode, gets `resume`.

    Raises:
        click.ClickException: nothing is to be resumed, or one of several plans.
    """
    try:
        asset, mode = (await client.get_asset()).asset, (await client.get_status()).mode
        latched = any(each.onResume for each in (await client.get_faults()).active)
    except MalError:
        return Resume()
    plans = [each.plan_id for each in await suspended_plans(client, mode)]
    if mode in {AssetMode.STOPPED, AssetMode.SAFE} or latched:
        echo_line(f"{asset} is {mode.name}: resume releases it", err=True)
        for plan in plans:
            echo_line(f"plan {plan} is suspended: `rover resume` again resumes it", err=True)
        return Resume()
    if mode is not AssetMode.PAUSED:
        raise click.ClickException(f"{asset} is {mode.name}: there is nothing to resume")
    if len(plans) > 1:
        choices = " or ".join(f"`rover plan resume {plan}`" for plan in plans)
        raise click.ClickException(f"several plans are suspended: {choices}")
    if not plans:
        return Resume()
    echo_line(f"{asset} is PAUSED: resumes plan {plans[0]}", err=True)
    return ResumePlan(plans[0])
