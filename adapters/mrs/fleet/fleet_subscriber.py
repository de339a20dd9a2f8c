"""`FleetSubscriber` receives other assets' updates from the upstream layer, with catch-up."""

import asyncio
import logging
from collections import deque
from collections.abc import AsyncIterator, Callable
from contextlib import suppress
from typing import Final

from adapters.mal import Consumer, MalError, Subscription, UpdateHeader
from adapters.mrs.fleet.directory_service import asset_of
from adapters.mrs.fleet.known_assets import KnownAsset, KnownAssets
from adapters.mrs.spec import (
    AreaError,
    Notification,
    ParameterValue,
    ServiceDescriptor,
    is_valid_notification,
    is_valid_value,
)

_LOG: Final = logging.getLogger(__name__)

SUBSCRIPTION: Final = "fleet"

MAX_BUFFERED: Final = 4096
"""Maximum notifications buffered during the catch-up."""

_Received = tuple[UpdateHeader, Notification]


class FleetSubscriber:
    """Subscribes to all assets, stores their updates, and forwards them to subscribers here.

    It accepts only updates that an asset itself publishes at that service layer. Forwarded updates
    are ignored, to avoid loops, as are updates of an asset that publishes here.

    Args:
        pass_on_value, pass_on_notification: called with each new item, its asset and its domain.

    Attributes:
        new_assets: set when an unknown asset has published; its address is to be queried.
    """

    def __init__(
        self,
        asset: str,
        known: KnownAssets,
        pass_on_value: Callable[[ParameterValue, str, tuple[str, ...]], None],
        pass_on_notification: Callable[[Notification, str, tuple[str, ...]], None],
    ) -> None:
        self._asset = asset
        self._known = known
        self._pass_on_value = pass_on_value
        self._pass_on_notification = pass_on_notification
        self._held: deque[_Received] | None = None
        self.new_assets = asyncio.Event()

    async def subscribe(self, consumer: Consumer, host: str, uri: str) -> None:
        """Subscribe, list the assets, and catch up with missed updates.

        The upstream service layer is that of the asset `host`, at `uri`.

        Raises:
            MalError: an answer is an error, or the connection is lost.
        """
        held = self._held = deque(maxlen=MAX_BUFFERED)
        subscription = Subscription(subscriptionId=SUBSCRIPTION)
        try:
            await consumer.subscribe(
                "MonitoringClient", "monitorAssetValue", subscription, self._on_value
            )
            await consumer.subscribe(
                "NotificationClient",
                "monitorAssetNotification",
                subscription,
                self._on_notification,
            )
            for other in (self._find_or_add(host, uri), *await self.discover(consumer)):
                if other is not None:
                    await self._catch_up(consumer, other)
        finally:
            self._held = None
        for update, notification in held:
            self._pass_on(update, notification)

    async def discover(self, consumer: Consumer) -> tuple[KnownAsset, ...]:
        """Return the assets that are registered upstream.

        Raises:
            MalError: the answer is an error, or the connection is lost.
        """
        self.new_assets.clear()
        services: tuple[ServiceDescriptor, ...]
        (services,) = await consumer.request("ServiceLayer", "getServices")
        found = (
            self._find_or_add(asset, service.providerURI)
            for service in services
            if (asset := asset_of(service)) is not None
        )
        return tuple(other for other in found if other is not None)

    async def _catch_up(self, consumer: Consumer, other: KnownAsset) -> None:
        if other.publishes_here:
            return
        values: tuple[ParameterValue, ...]
        try:
            (values,) = await consumer.request("MonitoringClient", "getValue", other.asset, ())
            for value in values:
                self._store_value(other, value, ())
            last = other.history.last
            async for each in missed_notifications(consumer, other.asset, last):
                self._store_notification(other, each, (), aloud=last is not None)
        except MalError as error:
            if error.number != AreaError.NOT_FOUND.value:
                raise

    def _on_value(self, update: UpdateHeader, value: ParameterValue) -> None:
        other = self._upstream_asset(update)
        if other is not None:
            self._store_value(other, value, update.domain or ())

    def _on_notification(self, update: UpdateHeader, notification: Notification) -> None:
        if self._held is None:
            self._pass_on(update, notification)
        else:
            self._held.append((update, notification))

    def _pass_on(self, update: UpdateHeader, notification: Notification) -> None:
        other = self._upstream_asset(update)
        if other is not None:
            self._store_notification(other, notification, update.domain or ())

    def _store_value(
        self, other: KnownAsset, value: ParameterValue, domain: tuple[str, ...]
    ) -> None:
        if is_valid_value(value):
            with suppress(MalError):  # too many parameters: only the first ones are stored
                other.add_value(value)
                self._pass_on_value(value, other.asset, domain)

    def _store_notification(
        self,
        other: KnownAsset,
        notification: Notification,
        domain: tuple[str, ...],
        aloud: bool = True,
    ) -> None:
        if is_valid_notification(notification) and other.history.add(notification) and aloud:
            self._pass_on_notification(notification, other.asset, domain)

    def _upstream_asset(self, update: UpdateHeader) -> KnownAsset | None:
        """Return the asset that published an update itself upstream; None for all others."""
        key = update.keyValues[0].value if update.keyValues else None
        if key is None or update.source != key.value:
            return None
        known = self._known.knows(str(key.value))
        other = self._find_or_add(str(key.value), None)
        if other is None or other.publishes_here:
            return None
        if not known:
            self.new_assets.set()
        return other

    def _find_or_add(self, asset: str, uri: str | None) -> KnownAsset | None:
        if asset == self._asset:
            return None
        try:
            other = self._known.find_or_add(asset)
        except MalError as error:
            _LOG.debug("%s is ignored: %s", asset[:80], error)
            return None
        if not other.publishes_here:
            other.above = True
            other.uri = uri or other.uri
        return other


FIRST_PAGE: Final = 100
"""Number of past notifications that are requested of a newly known asset."""


async def missed_notifications(
    consumer: Consumer, asset: str, last: Notification | None
) -> AsyncIterator[Notification]:
    """Yield the notifications of an asset after the last known one, oldest first.

    Without a known one, or with a new ledger of the asset, yield its last `FIRST_PAGE`.

    Raises:
        MalError: NotFound, the asset is not known there; any other error of an answer.
    """
    known = False
    if last is not None:
        async for each in _since(consumer, asset, last.sequence):
            if not known and each != last:
                break
            if known:
                yield each
            known = True
    if not known:
        async for each in _since(consumer, asset, await _newest(consumer, asset) - FIRST_PAGE + 1):
            yield each


async def _since(consumer: Consumer, asset: str, sequence: int) -> AsyncIterator[Notification]:
    since = max(1, sequence)
    while page := await past_page(consumer, asset, since, 0):
        for each in page:
            yield each
        if page[-1].sequence < since:
            return
        since = page[-1].sequence + 1


async def _newest(consumer: Consumer, asset: str) -> int:
    """Return the maximum sequence number by bisection; 0 for none."""
    at_least, below = 0, 1
    while page := await past_page(consumer, asset, below, 1):
        at_least, below = page[0].sequence, 2 * page[0].sequence
    while below - at_least > 1:
        middle = (at_least + below) // 2
        page = await past_page(consumer, asset, middle, 1)
        if page:
            at_least = page[0].sequence
        else:
            below = middle
    return at_least


async def past_page(
    consumer: Consumer, asset: str, since: int, maximum: int
) -> tuple[Notification, ...]:
    """Query a service layer for at most `maximum` notifications of an asset, 0 for a page."""
    page: tuple[Notification, ...]
    (page,) = await consumer.request(
        "NotificationClient", "getNotifications", asset, since, maximum
    )
    return page
