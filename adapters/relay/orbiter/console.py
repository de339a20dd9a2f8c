"""`Console` of `rover mops`: reads commands, prints life cycles and telemetry, line by line."""

import asyncio
import shlex
import time
from collections.abc import AsyncIterator, Callable, Sequence
from datetime import UTC, datetime
from itertools import cycle
from typing import Final

from adapters.mops import Dictionary, Message, MopsError, encoded
from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import DEFINED, ReceivedValue, describe_error, forwarded_command
from adapters.relay.orbiter.link_status import CONTACT, LINK_PARAMETERS, ORBITER_PARAMETERS
from executive.commands import Command, ExecuteAction, Request
from executive.values.quantities import read_quantity, unit_of
from executive.values.reports import Report

MISSING_VALUE: Final = "-"


class Console:
    """Reads and prints lines until the input ends and every command has ended.

    Args:
        client: session with a rover, or with the relay for one.
        dictionary: MOPS formats of the commands.

    Attributes:
        well: whether each command up to now was valid, and ended EXECUTED.
    """

    def __init__(
        self, client: MrsClient, dictionary: Dictionary, print_line: Callable[[str], None]
    ) -> None:
        self.well = True
        self._client = client
        self._dictionary = dictionary
        self._print = print_line
        self._gathered: dict[str, dict[str, ReceivedValue]] = {
            "TELEMETRY": {},
            "DTN": {},
            "HEALTH": {},
        }

    async def run(self, lines: AsyncIterator[str], telemetry: bool) -> None:
        """Read lines to their end; raise ConnectionError if the connection is not re-established.

        Args:
            lines: the input.
            telemetry: whether parameters are printed as they arrive.
        """
        listeners = [asyncio.create_task(self._print_reports())]
        if telemetry:
            listeners.append(asyncio.create_task(self._receive_telemetry()))
        running: set[asyncio.Task[None]] = set()
        try:
            async for text in lines:
                if text.split() == ["quit"]:
                    return
                await self._execute(text, running)
            if running:
                await asyncio.gather(*running)
        finally:
            for task in (*listeners, *running):
                task.cancel()

    async def _execute(self, text: str, running: set[asyncio.Task[None]]) -> None:
        try:
            arguments = shlex.split(text, comments=True)
            if not arguments:
                return
            if arguments == ["help"]:
                for one in help_lines(self._dictionary):
                    self._print(one)
            elif arguments == ["status"]:
                for value in await self._client.get_value():
                    self._gather(value)
            else:
                command = self._client.command(self._request(arguments[0], arguments[1:]))
                self._print(line(time.time(), "SENT", str(command.identity), *arguments))
                running.add(asyncio.create_task(self._run(command)))
        except ValueError as fault:  # by shlex, or a MopsError
            self.well = False
            self._print(line(time.time(), "REFUSED", f"{text.strip()!r}: {fault}"))

    def _request(self, name: str, values: list[str]) -> Request:
        if name.upper() == CONTACT:
            return ExecuteAction(" ".join((name, *values)).upper())
        entry = self._dictionary.commands.get(name)
        if entry is None:
            raise MopsError(f"unknown command {name}: help lists the commands")
        given = tuple(map(_input, cycle(entry.inputs or ("",)), values))
        return self._dictionary.request(Message(entry.code, "MOE", "ANY", entry.command, given))

    async def _run(self, command: Command) -> None:
        def on_stored(where: str) -> None:
            self._print(line(time.time(), "STORED", str(command.identity), where))

        outcome = await self._client.run(command, on_stored=on_stored)
        self.well = self.well and outcome.executed
        if outcome.refusal is not None:
            why = describe_error(outcome.refusal)
            self._print(line(time.time(), "REFUSED", str(command.identity), why))

    async def _print_reports(self) -> None:
        async for received in self._client.notifications():
            self._print(report_line(received.report))

    async def _receive_telemetry(self) -> None:
        async for value in await self._client.telemetry():
            self._gather(value)

    def _gather(self, value: ReceivedValue) -> None:
        """Print a group of parameters when its last one has arrived."""
        kind = _KINDS.get(value.name, "HEALTH")
        gathered = self._gathered[kind]
        if kind != "HEALTH" or value.value is not None:
            gathered[value.name] = value
        if value.name in _LAST:
            self._print(values_line(kind, tuple(gathered.values())))
            gathered.clear()


_KINDS: Final = {
    definition.name: kind
    for kind, definitions in (("TELEMETRY", DEFINED), ("DTN", LINK_PARAMETERS))
    for definition in definitions
}
"""Group of each parameter: of the rover, or of the link; all others are HEALTH."""

_LAST: Final = frozenset(each[-1].name for each in (DEFINED, LINK_PARAMETERS, ORBITER_PARAMETERS))
"""Last parameter of each group, in the order of `listDefinition`."""


_WIDTH = 9


def line(utc_s: float, kind: str, *parts: str) -> str:
    """Return a line: time in UTC, one word, the rest; unprintable characters become `?`."""
    time = datetime.fromtimestamp(utc_s, UTC)
    head = f"{time:%H:%M:%S}.{time.microsecond // 1000:03d}Z {kind:<{_WIDTH}}"
    whole = " ".join((head, *filter(None, parts))).rstrip()
    return "".join(each if each.isprintable() else "?" for each in whole)


def report_line(report: Report) -> str:
    """Return the line of a report; its type is the command's stage, or FORWARDED."""
    if (left := forwarded_command(report)) is not None:
        return line(report.utc_s, "FORWARDED", str(left))
    if report.stage is None:
        return line(report.utc_s, report.kind.name, report.severity.name, report.text)
    steps = "" if report.step is None else f"{report.step}/{report.step_count}"
    code = "" if report.reason is None else f"reason {report.reason.value}:"
    identity = str(report.identity)
    return line(report.utc_s, report.stage.name, identity, steps, code, report.text)


def values_line(kind: str, values: Sequence[ReceivedValue]) -> str:
    """Return the line of parameters, with `-` for unknown values."""
    figures = (f"{value.name}={_written(value.value)}" for value in values)
    return line(max(value.utc_s for value in values), kind, *figures)


def _written(value: float | str | None) -> str:
    if value is None:
        return "-"
    return repr(value) if isinstance(value, str) else format(value, "z.3f")


def _input(field: str, text: str) -> str:
    """Return an input as in a message, where quantities are in SI units.

    Raises:
        QuantityError: an angle without a unit, or no quantity of the field.
    """
    if text == MISSING_VALUE:
        return ""
    if unit := unit_of(field):
        return repr(read_quantity(text, unit, bare=not unit.startswith("rad")))
    return encoded(text)


def help_lines(dictionary: Dictionary) -> list[str]:
    """Return the lines of the command `help`."""
    commands = dictionary.commands.items()
    return [
        *(f"  {' '.join((name, *map(str.upper, entry.inputs)))}" for name, entry in commands),
        "  contact   up, down or plan: override the contact with the rover, or follow the plan",
        "  status    present telemetry and state of the relay",
        "  help      this list",
        "  quit      end at once, even with open commands",
        "metres and seconds, or as 50cm; angles as 90deg or 1.57rad;",
        "- for an omitted value; values with spaces in quotes",
    ]
