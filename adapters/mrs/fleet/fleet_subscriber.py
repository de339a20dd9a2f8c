"""What others publish at the service layer above, and what was missed of it."""

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

MOST_HELD: Final = 4096
"""Notifications that may come in while those before them are still asked for."""

_Heard = tuple[UpdateHeader, Notification]


class FleetSubscriber:
    """Subscribes to all assets, keeps what they publish, and passes it on to subscribers here.

    Only what an asset publishes itself at that service layer is taken: not what that passes on from
    yet another, so that nothing goes in circles, and nothing of an asset that publishes here.

    Args:
        pass_on_value, pass_on_notification: called with what is news, its asset and its domain.

    Attributes:
        new_assets: set when a new asset published something; its address is to be asked for.
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
        self._held: deque[_Heard] | None = None
        self.new_assets = asyncio.Event()

    async def subscribe(self, consumer: Consumer, host: str, uri: str) -> None:
        """Subscribe, ask which assets there are, and catch up with what was missed.

        The service layer above is that of the asset `host`, at `uri`.

        Raises:
            MalError: an answer is an error, or the connection is lost.
        """
        held = self._held = deque(maxlen=MOST_HELD)
        subscription = Subscription(subscriptionId=SUBSCRIPTION)
        try:
            await consumer.subscribe(
                "MonitoringClient", "monitorAssetValue", subscription, self._hear_value
            )
            await consumer.subscribe(
                "NotificationClient",
                "monitorAssetNotification",
                subscription,
                self._hear_notification,
            )
            for other in (self._find_or_add(host, uri), *await self.discover(consumer)):
                if other is not None:
                    await self._catch_up(consumer, other)
        finally:
            self._held = None
        for update, told in held:
            self._pass_on(update, told)

    async def discover(self, consumer: Consumer) -> tuple[KnownAsset, ...]:
        """Ask which assets are registered above, and return them.

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
                self._keep_value(other, value, ())
            last = other.history.last
            async for told in missed_notifications(consumer, other.asset, last):
                self._keep_notification(other, told, (), aloud=last is not None)
        except MalError as error:
            if error.number != AreaError.NOT_FOUND.value:
                raise

    def _hear_value(self, update: UpdateHeader, value: ParameterValue) -> None:
        other = self._of(update)
        if other is not None:
            self._keep_value(other, value, update.domain or ())

    def _hear_notification(self, update: UpdateHeader, told: Notification) -> None:
        if self._held is None:
            self._pass_on(update, told)
        else:
            self._held.append((update, told))

    def _pass_on(self, update: UpdateHeader, told: Notification) -> None:
        other = self._of(update)
        if other is not None:
            self._keep_notification(other, told, update.domain or ())

    def _keep_value(
        self, other: KnownAsset, value: ParameterValue, domain: tuple[str, ...]
    ) -> None:
        if is_valid_value(value):
            with suppress(MalError):  # too many parameters: those that came first are kept
                other.take_value(value)
                self._pass_on_value(value, other.asset, domain)

    def _keep_notification(
        self, other: KnownAsset, told: Notification, domain: tuple[str, ...], aloud: bool = True
    ) -> None:
        if is_valid_notification(told) and other.history.take(told) and aloud:
            self._pass_on_notification(told, other.asset, domain)

    def _of(self, update: UpdateHeader) -> KnownAsset | None:
        """Return the asset that published an update itself, unless it publishes here, too."""
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
            _LOG.debug("%s is not listened to: %s", asset[:80], error)
            return None
        if not other.publishes_here:
            other.above = True
            other.uri = uri or other.uri
        return other


FIRST_PAGE: Final = 100
"""Notifications from before the first meeting that are asked for."""


async def missed_notifications(
    consumer: Consumer, asset: str, last: Notification | None
) -> AsyncIterator[Notification]:
    """Give what an asset notified since the last notification that is known, oldest first.

    Before anything was heard, and when its ledger is another now, that is the last it said.

    Raises:
        MalError: NotFound, the asset is not known there; any other answer that is an error.
    """
    known = False
    if last is not None:
        async for told in _since(consumer, asset, last.sequence):
            if not known and told != last:
                break
            if known:
                yield told
            known = True
    if not known:
        async for told in _since(consumer, asset, await _newest(consumer, asset) - FIRST_PAGE + 1):
            yield told


async def _since(consumer: Consumer, asset: str, sequence: int) -> AsyncIterator[Notification]:
    since = max(1, sequence)
    while page := await past_page(consumer, asset, since, 0):
        for told in page:
            yield told
        if page[-1].sequence < since:
            return
        since = page[-1].sequence + 1


async def _newest(consumer: Consumer, asset: str) -> int:
    """Return the highest sequence number, 0 for none, by halving the range in which it lies."""
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
    consumer: Consumer, asset: str, since: int, most: int
) -> tuple[Notification, ...]:
    """Ask a service layer for so many notifications of an asset, 0 for a page; oldest first."""
    page: tuple[Notification, ...]
    (page,) = await consumer.request("NotificationClient", "getNotifications", asset, since, most)
    return page
