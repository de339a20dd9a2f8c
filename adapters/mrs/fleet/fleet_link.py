"""`FleetLink` to the upstream service layer: registers there, and publishes this asset's data."""

import asyncio
import logging
from collections import deque
from collections.abc import Callable, Coroutine
from contextlib import suppress
from typing import Any, Final

from adapters.mal import Consumer, MalError, MalUri, Publication, StandardError
from adapters.mrs.aboard import PAGE, CoreGateway, past_notifications, present_values
from adapters.mrs.fleet.directory_service import SERVICE
from adapters.mrs.fleet.fleet_subscriber import FleetSubscriber, past_page
from adapters.mrs.ground import Dialer
from adapters.mrs.spec import (
    AreaError,
    AssetInfo,
    Notification,
    ParameterValue,
    ServiceDescriptor,
    describe_error,
    notification_keys,
)
from executive.values.reports import ReportKind, Severity

_LOG: Final = logging.getLogger(__name__)

MIN_BACKOFF_S: Final = 0.2
MAX_BACKOFF_S: Final = 5.0
"""Maximum pause between two connection attempts; doubled from `MIN_BACKOFF_S` each time."""
HEARTBEAT_S: Final = 5.0
"""Period of requests that check the connection and list the assets; chosen, not measured."""
LEAVE_TIMEOUT_S: Final = 0.5
"""Timeout at shutdown for publishing, and again for deregistration; chosen, not measured."""
RECENT: Final = 256
"""Number of notifications cached in memory; older ones are read from the ledger."""
_MILLISECOND_NS: Final = 1_000_000


class FleetPublisher:
    """Publishes as a remote publisher, over successive connections.

    Only the newest value of each parameter is published. Notifications are published without gaps:
    those that a lost connection did not deliver are read from the ledger.

    Attributes:
        idle: set while there is nothing to publish.
    """

    def __init__(self, asset: str, domain: tuple[str, ...], gateway: CoreGateway) -> None:
        self._asset = asset
        self._domain = domain
        self._gateway = gateway
        self._values: dict[str, ParameterValue] = {}
        self._recent: deque[Notification] = deque(maxlen=RECENT)
        self._first: int | None = None
        self._next = 0
        self._newest = 0
        self._pending = asyncio.Event()
        self.idle = asyncio.Event()

    def publish_value(self, value: ParameterValue) -> None:
        """Publish a value with the next batch."""
        self._values[value.name] = value
        self._wake()

    def publish_notification(self, notification: Notification) -> None:
        """Publish a notification once, after all earlier ones."""
        if notification.sequence > self._newest:
            self._newest = notification.sequence
            self._recent.append(notification)
            self._wake()

    async def note_beginning(self) -> None:
        """Note the present end of the ledger: older reports are published only to fill a gap.

        Raises:
            MalError: the core does not answer.
        """
        if self._first is None:
            newest = await self._gateway.query(lambda executive: executive.last_sequence)
            self._first = self._next = newest + 1
            self._newest = max(self._newest, newest)

    async def publish(self, consumer: Consumer) -> None:
        """Publish everything, until cancelled.

        Raises:
            MalError: the service layer answers with an error, or the connection is lost.
        """
        values = await consumer.publication("MonitoringClient", "monitorAssetValue")
        notifications = await consumer.publication("NotificationClient", "monitorAssetNotification")
        self._next = await self._next_sequence_upstream(consumer)
        present = await self._gateway.query(lambda executive: present_values(executive, ()))
        self._values = {value.name: value for value in present} | self._values
        while True:
            self._pending.clear()
            await self._publish_values(values)
            await self._publish_notifications(notifications)
            if not self._pending.is_set():
                self.idle.set()
            await self._pending.wait()

    def _wake(self) -> None:
        self.idle.clear()
        self._pending.set()

    async def _publish_values(self, publication: Publication) -> None:
        waiting, self._values = self._values, {}
        for value in waiting.values():
            keys = (self._asset, value.name)
            await publication.publish(value, keys=keys, domain=self._domain, source=self._asset)

    async def _publish_notifications(self, publication: Publication) -> None:
        while self._next <= self._newest:
            for each in await self._from(self._next):
                keys = notification_keys(self._asset, each)
                await publication.publish(each, keys=keys, domain=self._domain, source=self._asset)
                self._next = each.sequence + 1

    async def _from(self, sequence: int) -> tuple[Notification, ...]:
        recent = tuple(each for each in self._recent if each.sequence >= sequence)
        if recent and recent[0].sequence == sequence:
            return recent
        return await self._past_notifications(sequence, RECENT)

    async def _past_notifications(self, since: int, maximum: int) -> tuple[Notification, ...]:
        return await self._gateway.query(
            lambda executive: past_notifications(executive, since, None, maximum)
        )

    async def _next_sequence_upstream(self, consumer: Consumer) -> int:
        """Return the sequence number after the last one stored upstream.

        If upstream stores none of this ledger, everything since the start is published again.
        """
        assert self._first is not None
        try:
            known = await past_page(consumer, self._asset, max(1, self._next - PAGE), 0)
        except MalError as error:
            if error.number != AreaError.NOT_FOUND.value:
                raise
            known = ()
        if known:
            own = await self._past_notifications(known[-1].sequence, 1)
            if own and _is_same(own[0], known[-1]):
                return known[-1].sequence + 1
        return max(self._first, self._next - PAGE)


def _is_same(own: Notification, received: Notification) -> bool:
    """Whether a notification equals the received one; times are rounded in transmission."""
    return (own.sequence, own.commandId, own.text) == (
        received.sequence,
        received.commandId,
        received.text,
    ) and abs(own.timestamp - received.timestamp) <= _MILLISECOND_NS


class FleetLink:
    """Registers, publishes and subscribes; reconnects after each loss, without end.

    Loss and recovery of the service layer are reported with kind LINK.

    Args:
        registration: returns the descriptor to register, given the local address of a connection.
        on_above: called with the upstream service layer.
    """

    def __init__(
        self,
        uri: MalUri,
        gateway: CoreGateway,
        dialer: Dialer,
        registration: Callable[[str], ServiceDescriptor],
        on_above: Callable[[ServiceDescriptor], None],
        publisher: FleetPublisher,
        subscriber: FleetSubscriber,
    ) -> None:
        self._publisher = publisher
        self._uri = uri
        self._gateway = gateway
        self._dialer = dialer
        self._registration = registration
        self._on_above = on_above
        self._subscriber = subscriber
        self._is_connected: bool | None = None
        self._registered: tuple[Consumer, str] | None = None
        self._task: asyncio.Task[None] | None = None

    def start(self) -> None:
        """Start; runs until `leave`."""
        self._task = asyncio.create_task(self._run())

    async def leave(self) -> None:
        """Publish the backlog and deregister, within `LEAVE_TIMEOUT_S` each; then disconnect."""
        if self._registered is not None:
            consumer, name = self._registered
            with suppress(TimeoutError):
                async with asyncio.timeout(LEAVE_TIMEOUT_S):
                    await self._publisher.idle.wait()
            with suppress(MalError, TimeoutError):
                async with asyncio.timeout(LEAVE_TIMEOUT_S):
                    await consumer.submit(SERVICE, "deregisterService", name)
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)

    async def _run(self) -> None:
        loop = asyncio.get_running_loop()
        pause_s = MIN_BACKOFF_S
        while True:
            began_s = loop.time()
            try:
                await self._stay_connected()
            except (MalError, OSError) as fault:
                self._report_change(False, f"the service layer at {self._uri} {_describe(fault)}")
            except Exception:  # the rover's own services must continue
                _LOG.exception("service layer at %s", self._uri)
                self._report_change(False, f"the service layer at {self._uri} sent invalid data")
            if loop.time() - began_s > MAX_BACKOFF_S:
                pause_s = MIN_BACKOFF_S
            await asyncio.sleep(pause_s)
            pause_s = min(2 * pause_s, MAX_BACKOFF_S)

    async def _stay_connected(self) -> None:
        """Register, publish and subscribe over one connection until its loss, which raises."""
        await self._publisher.note_beginning()
        consumer = await self._dialer.connect(self._uri)
        try:
            await self._register(consumer)
            await _first_to_end(
                self._publisher.publish(consumer), self._subscribe(consumer), _lost(consumer)
            )
        finally:
            self._registered = None
            await consumer.close()

    async def _register(self, consumer: Consumer) -> None:
        own = self._registration(consumer.local_address[0])
        await consumer.submit(SERVICE, "registerService", own)
        self._registered = (consumer, own.name)
        above: ServiceDescriptor
        (above,) = await consumer.request(SERVICE, "getService", SERVICE)
        self._on_above(above)
        self._report_change(True, f"registered as {own.name} at the service layer at {self._uri}")

    async def _subscribe(self, consumer: Consumer) -> None:
        host: AssetInfo
        (host,) = await consumer.request(SERVICE, "getAsset")
        await self._subscriber.subscribe(consumer, host.asset, str(self._uri))
        while True:
            with suppress(TimeoutError):
                async with asyncio.timeout(HEARTBEAT_S):
                    await self._subscriber.new_assets.wait()
            await self._subscriber.discover(consumer)

    def _report_change(self, is_connected: bool, text: str) -> None:
        """Report a change of the connection; the same state is not reported twice."""
        if is_connected is self._is_connected:
            _LOG.debug("%s", text)
            return
        self._is_connected = is_connected
        severity = Severity.INFORMATIONAL if is_connected else Severity.WARNING
        reported = self._gateway.query(
            lambda executive: executive.report_event(severity, text, kind=ReportKind.LINK)
        )
        reported.add_done_callback(lambda done: done.cancelled() or done.exception())


def _describe(fault: MalError | OSError) -> str:
    if not isinstance(fault, MalError):
        return f"is not reachable: {fault}"
    refused = any(fault.number == error.value for error in AreaError)
    return f"{'refuses this asset' if refused else 'is not reachable'}: {describe_error(fault)}"


async def _lost(consumer: Consumer) -> None:
    await consumer.wait_lost()
    raise MalError(StandardError.DESTINATION_LOST)


async def _first_to_end(*works: Coroutine[Any, Any, None]) -> None:
    """Run coroutines concurrently until one ends or raises; then cancel the others."""
    tasks = [asyncio.create_task(work) for work in works]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
