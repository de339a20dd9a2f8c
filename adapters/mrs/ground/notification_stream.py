"""Streams of a rover's broadcasts that continue across losses of the link."""

import asyncio
from collections.abc import Callable
from typing import Any, Final, Generic, TypeVar

from adapters.mal import MalError, StandardError, Subscription, UpdateHeader
from adapters.mrs.ground.queries import LINK_LOST_ERRORS
from adapters.mrs.ground.rover_consumer import RoverConsumer
from adapters.mrs.spec import Notification, cursor_of, lost_command

T = TypeVar("T")

SUBSCRIPTION: Final = "all"


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
        service, operation: the operation.
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


class NotificationStream:
    """Delivers every notification from the first connection on, in the order of recording.

    A notification that the rover repeats for a repeated command is delivered again.

    Args:
        deliver: called with each notification.
        on_new_ledger: called when the rover restarted with another ledger: its sequence numbers
            start again, and its commands are unknown.

    Attributes:
        behind: whether notifications may be missing, because the rover could not read its record.
    """

    def __init__(
        self, deliver: Callable[[Notification], None], on_new_ledger: Callable[[], None]
    ) -> None:
        self._deliver = deliver
        self._on_new_ledger = on_new_ledger
        self._has_last = False
        self._last: Notification | None = None
        self._held: list[Notification] | None = None
        self._ahead: set[int] = set()
        self.behind = True

    async def restore(self, consumer: RoverConsumer) -> None:
        """Subscribe on a new connection, and catch up with notifications since the last one.

        Raises:
            MalError: the rover rejects the subscription, or the connection is lost again.
        """
        self.behind = True
        held = self._held = []
        subscription = Subscription(subscriptionId=SUBSCRIPTION)
        await consumer.subscribe("Notification", "monitorNotification", subscription, self._take)
        await self._catch_up(consumer, held)

    async def catch_up(self, consumer: RoverConsumer) -> None:
        """Catch up on the same connection, if the rover could not read its record before.

        Raises:
            MalError: the connection is lost.
        """
        if self.behind:
            held = self._held = []
            await self._catch_up(consumer, held)

    async def _catch_up(self, consumer: RoverConsumer, held: list[Notification]) -> None:
        missed: list[Notification] = []
        try:
            missed = await self._missed(consumer)
            self.behind = False
        except MalError as error:  # without its record the rover still accepts a stop
            if error.number in LINK_LOST_ERRORS:
                raise
            self.behind = error.number == StandardError.INTERNAL.value
        finally:
            if self._held is held:
                self._held = None
        known = {notification.cursor for notification in missed}
        missed.sort(
            key=lambda each: lost_command(each) is not None
        )  # its end may be recorded later
        for notification in (*missed, *(n for n in held if n.cursor not in known)):
            self._pass_on(notification)

    def _take(self, _: UpdateHeader, notification: Notification) -> None:
        if self._held is None:
            self._pass_on(notification)
        else:
            self._held.append(notification)

    def _pass_on(self, notification: Notification) -> None:
        cursor = cursor_of(notification)
        if self.behind:
            self._ahead.add(cursor)
        elif cursor > cursor_of(self._last):
            self._last, self._has_last = notification, True
            if cursor in self._ahead:
                self._ahead.remove(cursor)
                return
        self._deliver(notification)

    async def _missed(self, consumer: RoverConsumer) -> list[Notification]:
        """Return the notifications recorded after the last one; none on the first connection."""
        if self._has_last:
            found: list[Notification] = []
            since: int | None = cursor_of(self._last)
            while since is not None:
                (page,) = await consumer.request("Notification", "getNotifications", since, None, 0)
                found += page
                since = cursor_of(page[-1]) + 1 if page else None
            if self._last is None:
                return found
            if found[:1] == [self._last]:
                return found[1:]
            self._on_new_ledger()
        (self._last,) = await consumer.request("Notification", "getLastNotification")
        self._has_last = True
        self._ahead.clear()
        return []
