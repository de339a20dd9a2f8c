"""`Streams` of a rover's broadcasts and of its tree that continue across losses of the link."""

import asyncio
import logging
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final, Generic, TypeVar

from adapters.mal import MalError, StandardError, Subscription, UpdateHeader
from adapters.mrs.ground.queries import LINK_LOST_ERRORS
from adapters.mrs.ground.rover_consumer import RoverConsumer
from adapters.mrs.spec import (
    Notification,
    ReceivedReport,
    TreeUpdate,
    lost_command,
    received_report,
)

if TYPE_CHECKING:
    from trees import TreeSnapshot

T = TypeVar("T")

SUBSCRIPTION: Final = "all"
_LOG: Final = logging.getLogger(__name__)


class Stream(Generic[T]):
    """An asynchronous iterator over items; it ends when closed, or raises when failed."""

    def __init__(self) -> None:
        self._items: asyncio.Queue[T | None] = asyncio.Queue()
        self._fault: Exception | None = None
        self.closed = False

    def put(self, item: T) -> None:
        """Add an item; ignored once closed."""
        if not self.closed:
            self._items.put_nowait(item)

    def close(self, fault: Exception | None = None) -> None:
        """End after the items in the queue; with a fault, raise it there."""
        if not self.closed:
            self.closed = True
            self._fault = fault
            self._items.put_nowait(None)

    def __aiter__(self) -> "Stream[T]":
        return self

    async def __anext__(self) -> T:
        item = await self._items.get()
        if item is not None:
            return item
        self._items.put_nowait(None)
        raise self._fault or StopAsyncIteration


class Streams(Generic[T]):
    """The streams of one broadcast; each receives every item."""

    def __init__(self) -> None:
        self._streams: list[Stream[T]] = []

    @property
    def has_subscribers(self) -> bool:
        """Whether any stream is open."""
        return any(not stream.closed for stream in self._streams)

    def open(self) -> Stream[T]:
        """Return a stream of the items from now on."""
        stream: Stream[T] = Stream()
        self._streams.append(stream)
        return stream

    def put(self, item: T) -> None:
        """Add an item to all streams."""
        for stream in self._streams:
            stream.put(item)

    def close(self, fault: Exception | None) -> None:
        """End all streams."""
        for stream in self._streams:
            stream.close(fault)


class Updates(Streams[T]):
    """The streams of a PUBSUB operation, subscribed to while any of them is open.

    Args:
        item: converts the parts of an update to an item.
    """

    def __init__(
        self, service: str, operation: str, item: Callable[..., T] = lambda update: update
    ) -> None:
        super().__init__()
        self._address = (service, operation)
        self._item = item

    async def subscribe(self, consumer: RoverConsumer) -> None:
        """Subscribe over a connection, if a stream is open; raises as `RoverConsumer` does."""
        if self.has_subscribers:
            subscription = Subscription(subscriptionId=SUBSCRIPTION)
            await consumer.subscribe(*self._address, subscription, self._on_update)

    def _on_update(self, _: UpdateHeader, *parts: Any) -> None:
        self.put(self._item(*parts))


_PASSING_ERRORS: Final = {StandardError.INTERNAL.value, StandardError.DELIVERY_TIMEDOUT.value}
"""Errors of a query that may succeed later on the same connection."""


class NotificationStream:
    """Delivers every report from the first connection on, in the order of recording.

    A report that the rover repeats for a repeated command is delivered again.

    Args:
        on_new_ledger: called when the rover restarted with another ledger: its sequence numbers
            start again, and its commands are unknown.

    Attributes:
        behind: whether reports may be missing: the rover could not read its record, or the link
            lost some.
    """

    def __init__(
        self, deliver: Callable[[ReceivedReport], None], on_new_ledger: Callable[[], None]
    ) -> None:
        self._deliver = deliver
        self._on_new_ledger = on_new_ledger
        self._has_last = False
        self._last: ReceivedReport | None = None
        self._held: list[ReceivedReport] | None = None
        self._ahead: set[int] = set()
        self.behind = True

    async def restore(self, consumer: RoverConsumer) -> None:
        """Subscribe on a new connection, and catch up with reports since the last one.

        Raises:
            MalError: the rover rejects the subscription, or the connection is lost again.
        """
        self.behind = True
        held = self._held = []
        subscription = Subscription(subscriptionId=SUBSCRIPTION)
        await consumer.subscribe(
            "Notification", "monitorNotification", subscription, self._on_update
        )
        await self._catch_up(consumer, held)

    async def catch_up(self, consumer: RoverConsumer, last: ReceivedReport | None = None) -> None:
        """Catch up on the same connection, if reports may be missing.

        Args:
            consumer: the connection.
            last: the last report of the rover, if it was requested: it must have arrived before.

        Raises:
            MalError: the connection is lost.
        """
        if last is not None:
            self.behind |= self._has_last and last.cursor > self._last_cursor
        if self.behind and self._held is None:  # not beside another one
            held = self._held = []
            await self._catch_up(consumer, held)

    async def _catch_up(self, consumer: RoverConsumer, held: list[ReceivedReport]) -> None:
        missed: list[ReceivedReport] = []
        try:
            missed = await self._missed(consumer)
            self.behind = False
        except MalError as error:  # without its record the rover still accepts a stop
            if error.number in LINK_LOST_ERRORS:
                raise
            self.behind = error.number in _PASSING_ERRORS
        finally:
            if self._held is held:
                self._held = None
        known = {received.cursor for received in missed}
        # the end of a lost command may be recorded later
        missed.sort(key=lambda each: lost_command(each.report) is not None)
        for received in (*missed, *(each for each in held if each.cursor not in known)):
            self._pass_on(received)

    def _on_update(self, _: UpdateHeader, notification: Notification) -> None:
        received = received_report(notification)
        if self._held is None:
            self.behind |= self._last is not None and received.cursor > self._last.cursor + 1
            self._pass_on(received)
        else:
            self._held.append(received)

    def _pass_on(self, received: ReceivedReport) -> None:
        if self.behind:
            self._ahead.add(received.cursor)
        elif received.cursor > self._last_cursor:
            self._last, self._has_last = received, True
            if received.cursor in self._ahead:
                self._ahead.remove(received.cursor)
                return
        self._deliver(received)

    @property
    def _last_cursor(self) -> int:
        return 0 if self._last is None else self._last.cursor

    async def _missed(self, consumer: RoverConsumer) -> list[ReceivedReport]:
        """Return the reports recorded after the last one; none on the first connection."""
        if self._has_last:
            found: list[ReceivedReport] = []
            since: int | None = self._last_cursor
            while since is not None:
                (page,) = await consumer.request("Notification", "getNotifications", since, None, 0)
                found += map(received_report, page)
                since = found[-1].cursor + 1 if page else None
            if self._last is None:
                return found
            if found[:1] == [self._last]:
                return found[1:]
            self._on_new_ledger()
        (last,) = await consumer.request("Notification", "getLastNotification")
        self._last = None if last is None else received_report(last)
        self._has_last = True
        self._ahead.clear()
        return []


class TreeUpdates(Updates["TreeSnapshot"]):
    """The streams of the behaviour tree: differences are merged into the full tree.

    Differences from a missed full update are skipped until the next full one.
    """

    def __init__(self) -> None:
        super().__init__("Status", "monitorTree")
        self._number = 0
        self._whole: TreeSnapshot | None = None

    async def subscribe(self, consumer: RoverConsumer) -> None:
        """Subscribe over a connection, if a stream is open; the first update is a full one."""
        self._whole = None
        await super().subscribe(consumer)

    def _on_update(self, _: UpdateHeader, update: TreeUpdate) -> None:
        from adapters.mrs.spec.tree_updates import snapshot_of_update

        is_whole = update.nodes is not None
        if not is_whole and (self._whole is None or update.whole != self._number):
            return
        try:
            snapshot = snapshot_of_update(update, self._whole)
        except ValueError as error:
            _LOG.warning("invalid tree update: %s", error)
            return
        if is_whole:
            self._number, self._whole = update.whole, snapshot
        self.put(snapshot)
