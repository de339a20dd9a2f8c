"""Mission control of a live run: sends what is due over the socket, and keeps what comes back."""

import asyncio
import time
from contextlib import suppress
from typing import Final

from adapters.mal.errors import MalError
from adapters.mrs.client import MrsClient
from adapters.mrs.files_client import FileNews
from adapters.mrs.stream import Stream
from adapters.mrs.types import Notification, ParameterValue
from executive.commands import Command
from sim.scenario import from_wire
from sim.scenario.expectations import Answer
from sim.scenario.live_files import event, fetched
from sim.scenario.model import Ask, Entry, Fetch, Repeat, Scenario, Send
from sim.scenario.record import Asked, Record, SeenMode, Sending
from sim.scenario.timeline import Ground, Timeline

LOOK_S: Final = 0.1
"""Between two questions for the mode."""


class LiveSession:
    """One play, over one client.

    Args:
        record: filled with all but the true poses.
    """

    def __init__(self, scenario: Scenario, client: MrsClient, record: Record) -> None:
        """Listen from now on."""
        self._client = client
        self._record = record
        self._lasts_s = scenario.lasts_s
        self._timeline = Timeline(scenario, record)
        self._ground = Ground(scenario)
        self._notifications = client.notifications()
        self._news = asyncio.Event()

    async def play(self) -> None:
        """Play to the end.

        Raises:
            ConnectionError: the rover could not be reached any more.
        """
        listening = [
            asyncio.create_task(self._hear(self._notifications)),
            asyncio.create_task(self._measure(await self._client.telemetry())),
            asyncio.create_task(self._follow(await self._client.file_events())),
            asyncio.create_task(self._look()),
        ]
        try:
            await self._send()
            for task in listening:
                if task.done():
                    task.result()
        finally:
            for task in listening:
                task.cancel()
            await asyncio.gather(*listening, return_exceptions=True)
        self._record.simulated_s = self._record.wall_s = self._now_s()

    def _now_s(self) -> float:
        return time.time() - self._record.start_utc_s

    async def _send(self) -> None:
        while (now_s := self._now_s()) < self._lasts_s:
            for entry in self._timeline.due(now_s):
                await self._carry_out(entry)
                self._record.played += 1
            self._news.clear()
            until_s = min(self._timeline.next_s(), self._lasts_s)
            with suppress(TimeoutError):
                await asyncio.wait_for(self._news.wait(), max(0.0, until_s - self._now_s()))

    async def _carry_out(self, entry: Entry) -> None:
        match entry:
            case Send() | Repeat():
                label = entry.name if isinstance(entry, Send) else entry.repeat
                command = self._ground.command(entry, time.time())
                sent_s = self._now_s()
                answer = await self._submit(command)
                self._record.sendings.append(Sending(label, command.identity, sent_s, answer))
            case Ask(ask=label):
                values = [from_wire.parameter_value(v) for v in await self._client.get_value()]
                files = tuple(file.path for file in await self._client.list_files())
                self._record.answers.append(Asked(label, self._record.heard(values), files))
            case Fetch(fetch=path):
                self._record.fetched.append(await fetched(self._client, path, self._record.files))
            case _:
                raise TypeError(f"{type(entry).__name__} cannot be done over the socket")

    async def _submit(self, command: Command) -> Answer:
        try:
            await self._client.submit(command)
        except MalError as error:
            return from_wire.answer(error)
        return Answer.ADMITTED

    async def _hear(self, notifications: Stream[Notification]) -> None:
        async for notification in notifications:
            self._record.reports.append(from_wire.report(notification))
            self._news.set()

    async def _measure(self, telemetry: Stream[ParameterValue]) -> None:
        async for value in telemetry:
            self._record.values += self._record.heard([from_wire.parameter_value(value)])

    async def _follow(self, news: Stream[FileNews]) -> None:
        async for told in news:
            self._record.file_events.append(event(told.event, told.file))

    async def _look(self) -> None:
        while True:
            status = await self._client.get_status()
            mode = from_wire.mode(status.mode)
            if mode is not None:
                seen_s = from_wire.utc_s(status.timestamp) - self._record.start_utc_s
                self._record.modes.append(SeenMode(seen_s, mode))
            await asyncio.sleep(LOOK_S)
