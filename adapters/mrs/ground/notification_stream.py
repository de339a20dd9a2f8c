"""What a rover broadcasts, as streams that go on across losses of the link."""

import asyncio
from collections.abc import Callable
from typing import Any, Final, Generic, TypeVar

from adapters.mal import Subscription, UpdateHeader
from adapters.mrs.ground.rover_consumer import RoverConsumer
from adapters.mrs.spec import Notification

T = TypeVar("T")

SUBSCRIPTION: Final = "all"


class Stream(Generic[T]):
    """An asynchronous iterator over what is put; it ends when closed, or raises when failed."""

    def __init__(self) -> None:
        self._items: asyncio.Queue[T | None] = asyncio.Queue()
        self._fault: Exception | None = None
        self.closed = False

    def put(self, item: T) -> None:
        """Add an item; none is taken once closed."""
        if not self.closed:
            self._items.put_nowait(item)

    def close(self, fault: Exception | None = None) -> None:
        """End after what was put; with a fault, raise it there."""
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
    """The streams of one broadcast; what comes goes to all of them."""

    def __init__(self) -> None:
        self._streams: list[Stream[T]] = []

    @property
    def wanted(self) -> bool:
        """Whether anybody may still be listening."""
        return any(not stream.closed for stream in self._streams)

    def open(self) -> Stream[T]:
        """Return what comes from now on."""
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
    """The streams of a PUBSUB operation, subscribed to while somebody listens.

    Args:
        service, operation: what to subscribe to.
        item: makes an item of the parts of an update.
    """

    def __init__(
        self, service: str, operation: str, item: Callable[..., T] = lambda update: update
    ) -> None:
        super().__init__()
        self._address = (service, operation)
        self._item = item

    async def subscribe(self, consumer: RoverConsumer) -> None:
        """Subscribe over a connection, if anybody listens; raises as `RoverConsumer` does."""
        if self.wanted:
            subscription = Subscription(subscriptionId=SUBSCRIPTION)
            await consumer.subscribe(*self._address, subscription, self._on_update)

    def _on_update(self, _: UpdateHeader, *parts: Any) -> None:
        self.put(self._item(*parts))


class NotificationStream:
    """Passes on every notification from the first connection on, each once and in order.

    A notification that the rover sends again, because its command came again, is passed on again.

    Args:
        deliver: called with each notification.
        on_new_ledger: called when the rover came back with another ledger: its numbers start anew,
            and what it knew of commands is gone.
    """

    def __init__(
        self, deliver: Callable[[Notification], None], on_new_ledger: Callable[[], None]
    ) -> None:
        self._deliver = deliver
        self._on_new_ledger = on_new_ledger
        self._last: Notification | None = None
        self._held: list[Notification] | None = None

    async def restore(self, consumer: RoverConsumer) -> None:
        """Subscribe on a new connection, and catch up with what was missed since the last one.

        Raises:
            MalError: the rover answers with an error, or the connection is lost again.
        """
        held = self._held = []
        try:
            await consumer.subscribe(
                "Notification",
                "monitorNotification",
                Subscription(subscriptionId=SUBSCRIPTION),
                self._take,
            )
            missed = await self._missed(consumer)
        finally:
            self._held = None
        known = {notification.sequence for notification in missed}
        for notification in (*missed, *(n for n in held if n.sequence not in known)):
            self._pass_on(notification)

    def _take(self, _: UpdateHeader, notification: Notification) -> None:
        if self._held is None:
            self._pass_on(notification)
        else:
            self._held.append(notification)

    def _pass_on(self, notification: Notification) -> None:
        last = 0 if self._last is None else self._last.sequence
        if notification.sequence > last:  # what a relay says of itself has no number: 0
            self._last = notification
        self._deliver(notification)

    async def _missed(self, consumer: RoverConsumer) -> list[Notification]:
        if self._last is None:
            return []
        found: list[Notification] = []
        since: int | None = self._last.sequence
        while since is not None:
            (page,) = await consumer.request("Notification", "getNotifications", since, None, 0)
            found += page
            since = page[-1].sequence + 1 if page else None
        if not found or found[0] != self._last:
            self._last = None
            self._on_new_ledger()
            return []
        return found[1:]
