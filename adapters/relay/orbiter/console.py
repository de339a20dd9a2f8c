"""`rover mops`: commands typed in, life cycles and telemetry coming out, line by line."""

import asyncio
import shlex
import time
from collections.abc import AsyncIterator, Callable, Sequence
from datetime import UTC, datetime
from typing import Final

from adapters.mal import TypedAttribute
from adapters.mops import Dictionary, Message, MopsError, encoded
from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import DEFINED, Notification, ParameterValue, describe_error, forwarded
from adapters.relay.orbiter.link_status import CONTACT, LINK_PARAMETERS, ORBITER_PARAMETERS
from executive.commands import Command, ExecuteAction, Request

NOT_GIVEN: Final = "-"


class Console:
    """Reads lines and prints lines, until there are no more and every command has ended.

    Args:
        client: a session with a rover, or with the relay for one.
        dictionary: how commands are spelled.
        say: takes each line that is said.

    Attributes:
        well: whether every command so far was understood, and ended EXECUTED.
    """

    def __init__(
        self, client: MrsClient, dictionary: Dictionary, say: Callable[[str], None]
    ) -> None:
        self.well = True
        self._client = client
        self._dictionary = dictionary
        self._say = say
        self._gathered: dict[str, dict[str, ParameterValue]] = {
            "TELEMETRY": {},
            "DTN": {},
            "HEALTH": {},
        }

    async def run(self, lines: AsyncIterator[str], telemetry: bool) -> None:
        """Read lines to their end; raises ConnectionError when the other end does not come back.

        Args:
            lines: what is typed.
            telemetry: whether parameters are said as they come.
        """
        listeners = [asyncio.create_task(self._notifications())]
        if telemetry:
            listeners.append(asyncio.create_task(self._telemetry()))
        running: set[asyncio.Task[None]] = set()
        try:
            async for text in lines:
                if text.split() == ["quit"]:
                    return
                await self._take(text, running)
            if running:
                await asyncio.gather(*running)
        finally:
            for task in (*listeners, *running):
                task.cancel()

    async def _take(self, text: str, running: set[asyncio.Task[None]]) -> None:
        try:
            words = shlex.split(text, comments=True)
            if not words:
                return
            if words == ["help"]:
                for one in help_lines(self._dictionary):
                    self._say(one)
            elif words == ["status"]:
                for value in await self._client.get_value():
                    self._gather(value)
            else:
                command = self._client.command(self._request(words[0], words[1:]))
                self._say(line(time.time(), "SENT", str(command.identity), *words))
                running.add(asyncio.create_task(self._run(command)))
        except ValueError as fault:  # of shlex, or a MopsError
            self.well = False
            self._say(line(time.time(), "REFUSED", f"{text.strip()!r}: {fault}"))

    def _request(self, name: str, values: list[str]) -> Request:
        if name.upper() == CONTACT:
            return ExecuteAction(" ".join((name, *values)).upper())
        entry = self._dictionary.commands.get(name)
        if entry is None:
            raise MopsError(f"there is no command {name}: help lists them")
        given = tuple("" if value == NOT_GIVEN else encoded(value) for value in values)
        return self._dictionary.request(Message(entry.code, "MOE", "ANY", entry.command, given))

    async def _run(self, command: Command) -> None:
        def on_stored(where: str) -> None:
            self._say(line(time.time(), "STORED", str(command.identity), where))

        outcome = await self._client.run(command, on_stored=on_stored)
        self.well = self.well and outcome.executed
        if outcome.refusal is not None:
            why = describe_error(outcome.refusal)
            self._say(line(time.time(), "REFUSED", str(command.identity), why))

    async def _notifications(self) -> None:
        async for notification in self._client.notifications():
            self._say(notification_line(notification))

    async def _telemetry(self) -> None:
        async for value in await self._client.telemetry():
            self._gather(value)

    def _gather(self, value: ParameterValue) -> None:
        """Print parameters that belong together when the last of them has come."""
        kind = _KINDS.get(value.name, "HEALTH")
        gathered = self._gathered[kind]
        if kind != "HEALTH" or value.value is not None:
            gathered[value.name] = value
        if value.name in _LAST:
            self._say(values_line(kind, tuple(gathered.values())))
            gathered.clear()


_KINDS: Final = {
    definition.name: kind
    for kind, definitions in (("TELEMETRY", DEFINED), ("DTN", LINK_PARAMETERS))
    for definition in definitions
}
"""Of the rover, and of the link; what is known of the components is HEALTH."""

_LAST: Final = frozenset(each[-1].name for each in (DEFINED, LINK_PARAMETERS, ORBITER_PARAMETERS))
"""The parameters that come last, as `listDefinition` has them."""


_WIDTH = 9


def line(utc_s: float, kind: str, *said: str) -> str:
    """Return a line: time in UTC, one word, the rest; what is not printable is a `?`."""
    time = datetime.fromtimestamp(utc_s, UTC)
    head = f"{time:%H:%M:%S}.{time.microsecond // 1000:03d}Z {kind:<{_WIDTH}}"
    whole = " ".join((head, *filter(None, said))).rstrip()
    return "".join(each if each.isprintable() else "?" for each in whole)


def notification_line(notification: Notification) -> str:
    """Return the line of a notification; a command's stage, or its departure, is its word."""
    utc_s, text = notification.timestamp / 1e9, notification.text or ""
    if (left := forwarded(notification)) is not None:
        return line(utc_s, "FORWARDED", str(left))
    if notification.stage is None:
        severity = notification.severity.name
        return line(utc_s, notification.kind.name, severity, text)
    whose = f"{notification.source}:{notification.commandId}"
    steps = "" if notification.step is None else f"{notification.step}/{notification.stepCount}"
    code = "" if notification.code is None else f"reason {notification.code}:"
    return line(utc_s, notification.stage.name, whose, steps, code, text)


def values_line(kind: str, values: Sequence[ParameterValue]) -> str:
    """Return the line of parameters, `-` where one is not known."""
    figures = (f"{value.name}={_written(value.value)}" for value in values)
    return line(max(value.timestamp for value in values) / 1e9, kind, *figures)


def _written(value: TypedAttribute | None) -> str:
    if value is None:
        return "-"
    return repr(value.value) if isinstance(value.value, str) else format(value.value, "z.3f")


def help_lines(dictionary: Dictionary) -> list[str]:
    """Return what can be typed."""
    commands = dictionary.commands.items()
    return [
        *(f"  {' '.join((name, *map(str.upper, entry.inputs)))}" for name, entry in commands),
        "  contact   up, down or plan: open or close the way from the orbiter, or as planned",
        "  status    telemetry and relay, as they are now",
        "  help      this list",
        "  quit      end, whatever is under way",
        "m, rad, s; - for what is not given; words with spaces in quotes",
    ]
