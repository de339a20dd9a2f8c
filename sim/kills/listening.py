"""How a client hears the rover: by the broker, and what it missed, of the broker or the rover."""

import asyncio
from contextlib import suppress
from typing import Final

from adapters.mal.errors import MalError
from adapters.mal.mal_area import Subscription, UpdateHeader
from adapters.mrs.rover_consumer import RoverConsumer
from adapters.mrs.session import Session
from adapters.mrs.types import Notification
from sim.kills.journal import Way
from sim.kills.view import View
from sim.scenario import from_wire

LOOK_S: Final = 1.0
"""At most between two looks at what is missing."""


class Listener:
    """Has the view complete, over losses of both links.

    Args:
        asset: the rover that is listened to.
        quiet: whether the rover itself is to be asked too while nothing seems to be missing: what
            was said last may be missing, and nobody knows.
    """

    def __init__(self, view: View, asset: str, quiet: bool) -> None:
        """Have heard nothing."""
        self._view = view
        self._asset = asset
        self._quiet = quiet
        self._gap = asyncio.Event()

    async def subscribe(self, broker: RoverConsumer) -> None:
        """Subscribe over a new connection with the broker; raises MalError."""
        await broker.subscribe(
            "NotificationClient",
            "monitorAssetNotification",
            Subscription(subscriptionId="view"),
            self._on_update,
        )
        self._gap.set()

    async def complete(self, broker: Session, rover: Session) -> None:
        """Ask for what is missing, for ever."""
        while True:
            with suppress(TimeoutError):
                await asyncio.wait_for(self._gap.wait(), LOOK_S)
            self._gap.clear()
            await self._ask(broker, Way.BROKER_MEMORY)
            if self._quiet or self._view.whole_to < self._view.newest:
                await self._ask(rover, Way.LEDGER)

    async def _ask(self, session: Session, way: Way) -> None:
        consumer = await session.consumer()
        since = self._view.whole_to + 1
        try:
            while page := await self._page(consumer, way, since):
                for notification in page:
                    self._view.hear(from_wire.report(notification), way)
                since = page[-1].sequence + 1
        except (MalError, ConnectionError):
            return  # the link was lost, or the broker has not heard of the rover yet

    async def _page(
        self, consumer: RoverConsumer, way: Way, since: int
    ) -> tuple[Notification, ...]:
        page: tuple[Notification, ...]
        if way is Way.LEDGER:
            (page,) = await consumer.request("Notification", "getNotifications", since, None, 0)
        else:
            (page,) = await consumer.request(
                "NotificationClient", "getNotifications", self._asset, since, 0
            )
        return page

    def _on_update(self, header: UpdateHeader, notification: Notification) -> None:
        asset = header.keyValues[0].value if header.keyValues else None
        if asset is None or asset.value != self._asset:
            return
        self._view.hear(from_wire.report(notification), Way.BROKER)
        if self._view.whole_to < self._view.newest:
            self._gap.set()
