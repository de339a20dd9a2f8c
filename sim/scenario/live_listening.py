"""What the ground hears of a live run over one client, put into the record."""

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any, Final

from adapters.mrs.client import MrsClient
from adapters.mrs.files_client import FileNews
from adapters.mrs.stream import Stream
from adapters.mrs.types import Notification, ParameterValue, PlanUpdate
from executive.files import FileEvent, FileEventKind
from sim.scenario import from_wire
from sim.scenario.how import How
from sim.scenario.live_files import event
from sim.scenario.record import Record, SeenMode

LOOK_S: Final = 0.1
"""Between two questions for the mode."""


class Listening:
    """Listens over one client, from `begin` to `end`.

    Args:
        how: what travels by that link is listened to.
        on_news: called after each report.
    """

    def __init__(
        self, client: MrsClient, record: Record, how: How, on_news: Callable[[], None]
    ) -> None:
        """Hear notifications from now on."""
        self._client = client
        self._record = record
        self._direct = how is How.DIRECT
        self._on_news = on_news
        self._notifications = client.notifications()
        self._tasks: list[asyncio.Task[None]] = []

    async def begin(self) -> None:
        """Hear the rest as well."""
        client = self._client
        self._start(self._hear(self._notifications))
        self._start(self._measure(await client.telemetry()))
        if self._direct:
            self._start(self._follow(await client.file_events()))
            self._start(self._watch(await client.plan_updates()))
        self._start(self._look())

    async def catch_up(self) -> None:
        """Ask for what was told while nobody listened; telemetry of that time is gone."""
        record, client = self._record, self._client
        since = max((report.sequence for report in record.reports), default=0) + 1
        while past := await client.get_notifications(since):
            record.reports += map(from_wire.report, past)
            since = past[-1].sequence + 1
        record.plans += map(from_wire.plan_update, await client.get_plan_status())
        told = {news.path for news in record.file_events}
        there = [file.path for file in await client.list_files()]
        record.file_events += [
            FileEvent(FileEventKind.STORED, path) for path in there if path not in told
        ]
        self._on_news()

    def check(self) -> None:
        """Raise what ended the listening, if anything did."""
        for task in self._tasks:
            if task.done():
                task.result()

    async def end(self) -> None:
        """Listen no more."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def _start(self, work: Coroutine[Any, Any, None]) -> None:
        self._tasks.append(asyncio.create_task(work))

    async def _hear(self, notifications: Stream[Notification]) -> None:
        async for notification in notifications:
            self._record.reports.append(from_wire.report(notification))
            self._on_news()

    async def _measure(self, telemetry: Stream[ParameterValue]) -> None:
        async for value in telemetry:
            self._record.values += self._record.heard(from_wire.parameter_values([value]))

    async def _follow(self, news: Stream[FileNews]) -> None:
        async for told in news:
            self._record.file_events.append(event(told.event, told.file))

    async def _watch(self, updates: Stream[PlanUpdate]) -> None:
        async for update in updates:
            self._record.plans.append(from_wire.plan_update(update))

    async def _look(self) -> None:
        while True:
            status = await self._client.get_status()
            mode = from_wire.mode(status.mode)
            if mode is not None:
                seen_s = from_wire.utc_s(status.timestamp) - self._record.start_utc_s
                self._record.modes.append(SeenMode(seen_s, mode))
            await asyncio.sleep(LOOK_S)
