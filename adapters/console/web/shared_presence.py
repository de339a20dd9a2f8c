"""`SharedPresence`: exchanges the open pages among the consoles at one archive."""

import asyncio
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Final

from sqlalchemy.exc import SQLAlchemyError

from adapters.console.archive import (
    POLL_S,
    Archive,
    ConsolePages,
    forget_pages,
    read_pages,
    write_pages,
)
from adapters.console.web.hub import Hub

PRESENCE_TIMEOUT_S: Final = 5.0
"""Heartbeat timeout after which a console has ended or lost the database, s."""


class SharedPresence:
    """Publishes the open pages of other consoles.

    Args:
        archive: stores the pages of each console.
        hub: pages of this console.
        now_s: monotonic clock, s.
    """

    def __init__(self, archive: Archive, hub: Hub, now_s: Callable[[], float]) -> None:
        self._archive, self._hub, self._now_s = archive, hub, now_s
        self._own = ConsolePages(hub.instance, 0, ())
        self._last_beats: dict[str, tuple[int, float]] = {}

    async def run(self) -> None:
        """Exchange the open pages periodically."""
        while True:
            try:
                await self.exchange()
            except SQLAlchemyError:  # the archive logs that it cannot be written
                self._hub.publish_other_pages(())
            await asyncio.sleep(POLL_S)

    async def exchange(self) -> None:
        """Store the open pages of this console, and read those of others.

        Raises:
            SQLAlchemyError: the archive cannot be written or read.
        """
        await self._write()
        await self._poll()

    async def close(self) -> None:
        """Delete the stored pages of this console."""
        with suppress(SQLAlchemyError):
            own = ConsolePages(self._hub.instance, 0, ())
            await self._archive.write(partial(write_pages, console=own))

    async def _write(self) -> None:
        before, pages = self._own, self._hub.pages
        if before.pages or pages:
            self._own = ConsolePages(before.instance, before.heartbeat + 1, pages)
            await self._archive.write(partial(write_pages, console=self._own))

    async def _poll(self) -> None:
        found = [
            each
            for each in await self._archive.read(read_pages)
            if each.instance != self._own.instance
        ]
        expired = [each for each in found if self._silent_s(each) > PRESENCE_TIMEOUT_S]
        for each in expired:
            await self._archive.write(partial(forget_pages, console=each))
        here = [each for each in found if each not in expired]
        self._last_beats = {each.instance: self._last_beats[each.instance] for each in here}
        self._hub.publish_other_pages(tuple(page for each in here for page in each.pages))

    def _silent_s(self, console: ConsolePages) -> float:
        """Return the time since a console's last heartbeat, s, by this console's clock."""
        now_s = self._now_s()
        beat, beat_s = self._last_beats.get(console.instance, (None, now_s))
        if beat != console.heartbeat:
            beat_s = now_s
        self._last_beats[console.instance] = (console.heartbeat, beat_s)
        return now_s - beat_s
