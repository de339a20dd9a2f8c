"""What this asset says of itself to the service layer above."""

import asyncio
from collections import deque
from typing import Final

from adapters.mal import Consumer, MalError, Publication
from adapters.mrs import monitoring_client_service as monitoring
from adapters.mrs import notification_client_service as notification
from adapters.mrs.core import Core
from adapters.mrs.errors import AreaError
from adapters.mrs.monitoring_service import present_values
from adapters.mrs.notification_service import AT_ONCE, past_notifications
from adapters.mrs.reports import notification_keys
from adapters.mrs.types import Notification, ParameterValue

RECENT: Final = 256
"""Notifications at hand without asking the ledger."""
_MILLISECOND_NS: Final = 1_000_000


class FleetSpeaker:
    """Publishes as a remote publisher, over one connection after the other.

    Of values the newest of each parameter is said. Of notifications none is left out: what was not
    heard above before the connection was lost is taken from the ledger.

    Attributes:
        silent: set while there is nothing to say.
    """

    def __init__(self, asset: str, domain: tuple[str, ...], core: Core) -> None:
        """Have said nothing."""
        self._asset = asset
        self._domain = domain
        self._core = core
        self._values: dict[str, ParameterValue] = {}
        self._recent: deque[Notification] = deque(maxlen=RECENT)
        self._first: int | None = None
        self._next = 0
        self._newest = 0
        self._news = asyncio.Event()
        self.silent = asyncio.Event()

    def value(self, value: ParameterValue) -> None:
        """Say a value at the next occasion."""
        self._values[value.name] = value
        self._wake()

    def notification(self, notification: Notification) -> None:
        """Say a notification, after all before it; one that is told again is not said again."""
        if notification.sequence > self._newest:
            self._newest = notification.sequence
            self._recent.append(notification)
            self._wake()

    async def note_beginning(self) -> None:
        """Remember where the ledger ends: what is older is said only to who heard what was before.

        Raises:
            MalError: the core does not answer.
        """
        if self._first is None:
            newest = await self._core.ask(lambda executive: executive.ledger.last_sequence)
            self._first = self._next = newest + 1
            self._newest = max(self._newest, newest)

    async def speak(self, consumer: Consumer) -> None:
        """Say everything, until cancelled.

        Raises:
            MalError: the service layer refuses something, or the connection is lost.
        """
        values = await consumer.publication(monitoring.SERVICE, monitoring.MONITOR)
        notifications = await consumer.publication(notification.SERVICE, notification.MONITOR)
        self._next = await self._heard_above(consumer)
        (present,) = await present_values(self._core, ())
        self._values = {value.name: value for value in present} | self._values
        while True:
            self._news.clear()
            await self._say_values(values)
            await self._say_notifications(notifications)
            if not self._news.is_set():
                self.silent.set()
            await self._news.wait()

    def _wake(self) -> None:
        self.silent.clear()
        self._news.set()

    async def _say_values(self, publication: Publication) -> None:
        waiting, self._values = self._values, {}
        for value in waiting.values():
            await publication.publish(
                value, keys=(self._asset, value.name), domain=self._domain, source=self._asset
            )

    async def _say_notifications(self, publication: Publication) -> None:
        while self._next <= self._newest:
            for said in await self._from(self._next):
                await publication.publish(
                    said,
                    keys=notification_keys(self._asset, said),
                    domain=self._domain,
                    source=self._asset,
                )
                self._next = said.sequence + 1

    async def _from(self, sequence: int) -> tuple[Notification, ...]:
        recent = tuple(kept for kept in self._recent if kept.sequence >= sequence)
        if recent and recent[0].sequence == sequence:
            return recent
        (page,) = await past_notifications(self._core, sequence, None, RECENT)
        return page

    async def _heard_above(self, consumer: Consumer) -> int:
        """Return the sequence number after the last that the service layer above remembers.

        If it remembers nothing of this ledger, it hears again what was said since the beginning.
        """
        assert self._first is not None
        known: tuple[Notification, ...]
        since = max(1, self._next - AT_ONCE)
        try:
            (known,) = await consumer.request(
                notification.SERVICE, "getNotifications", self._asset, since, 0
            )
        except MalError as error:
            if error.number != AreaError.NOT_FOUND.value:
                raise
            known = ()
        if known:
            (own,) = await past_notifications(self._core, known[-1].sequence, None, 1)
            if own and _same(own[0], known[-1]):
                return known[-1].sequence + 1
        return max(self._first, self._next - AT_ONCE)


def _same(own: Notification, heard: Notification) -> bool:
    """Whether a notification is the one that was heard; times are rounded on their way."""
    return (own.sequence, own.commandId, own.text) == (
        heard.sequence,
        heard.commandId,
        heard.text,
    ) and abs(own.timestamp - heard.timestamp) <= _MILLISECOND_NS
