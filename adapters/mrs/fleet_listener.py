"""What others say at the service layer above."""

import asyncio
import logging
from collections import deque
from contextlib import suppress
from typing import Final

from adapters.mal import Consumer, MalError, Subscription, UpdateHeader
from adapters.mrs import monitoring_client_service as monitoring
from adapters.mrs import notification_client_service as notification
from adapters.mrs.errors import AreaError
from adapters.mrs.fleet import Fleet, Other
from adapters.mrs.fleet_past import missed
from adapters.mrs.heard import sound_notification, sound_value
from adapters.mrs.monitoring_client_service import MonitoringClientService
from adapters.mrs.notification_client_service import NotificationClientService
from adapters.mrs.registry import asset_of
from adapters.mrs.types import Notification, ParameterValue, ServiceDescriptor

_LOG: Final = logging.getLogger(__name__)

SUBSCRIPTION: Final = "fleet"

MOST_HELD: Final = 4096
"""Notifications that may come in while those before them are still asked for."""

_Heard = tuple[UpdateHeader, Notification]


class FleetListener:
    """Subscribes to all, keeps what it hears, and passes it on to who subscribed here.

    Only what an asset says itself, at that service layer, is believed: what that passes on from
    yet another is not, so that nothing goes round in a circle. Nor is anybody believed about an
    asset that speaks here itself.

    Attributes:
        strangers: set when somebody was heard for the first time, whose address is to be asked.
    """

    def __init__(
        self,
        asset: str,
        fleet: Fleet,
        monitoring_client: MonitoringClientService,
        notification_client: NotificationClientService,
    ) -> None:
        """Have heard nothing."""
        self._asset = asset
        self._fleet = fleet
        self._monitoring = monitoring_client
        self._notification = notification_client
        self._held: deque[_Heard] | None = None
        self.strangers = asyncio.Event()

    async def listen(self, consumer: Consumer, host: str, uri: str) -> None:
        """Subscribe, learn who is there, and catch up with what was missed.

        Args:
            consumer: connected with the service layer above.
            host: the asset that this is aboard of.
            uri: where it is.

        Raises:
            MalError: an answer is an error, or the connection is lost.
        """
        held = self._held = deque(maxlen=MOST_HELD)
        subscription = Subscription(subscriptionId=SUBSCRIPTION)
        try:
            await consumer.subscribe(
                monitoring.SERVICE, monitoring.MONITOR, subscription, self._hear_value
            )
            await consumer.subscribe(
                notification.SERVICE, notification.MONITOR, subscription, self._hear_notification
            )
            for other in (self._meet(host, uri), *await self.learn(consumer)):
                if other is not None:
                    await self._catch_up(consumer, other)
        finally:
            self._held = None
        for update, told in held:
            self._pass_on(update, told)

    async def learn(self, consumer: Consumer) -> tuple[Other, ...]:
        """Ask who is registered above; return whom it is about.

        Raises:
            MalError: the answer is an error, or the connection is lost.
        """
        self.strangers.clear()
        services: tuple[ServiceDescriptor, ...]
        (services,) = await consumer.request("ServiceLayer", "getServices")
        found = (
            self._meet(asset, service.providerURI)
            for service in services
            if (asset := asset_of(service)) is not None
        )
        return tuple(other for other in found if other is not None)

    async def _catch_up(self, consumer: Consumer, other: Other) -> None:
        if other.speaks_here:
            return
        values: tuple[ParameterValue, ...]
        try:
            (values,) = await consumer.request(monitoring.SERVICE, "getValue", other.asset, ())
            for value in values:
                self._keep_value(other, value, ())
            last = other.history.last
            async for told in missed(consumer, other.asset, last):
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

    def _keep_value(self, other: Other, value: ParameterValue, domain: tuple[str, ...]) -> None:
        if sound_value(value):
            with suppress(MalError):  # too many parameters: those that came first are kept
                other.take_value(value)
                self._monitoring.publish(value, other.asset, domain)

    def _keep_notification(
        self, other: Other, told: Notification, domain: tuple[str, ...], aloud: bool = True
    ) -> None:
        if sound_notification(told) and other.take_notification(told) and aloud:
            self._notification.publish(told, other.asset, domain)

    def _of(self, update: UpdateHeader) -> Other | None:
        """Return the asset that says something itself, unless that is heard nearer."""
        key = update.keyValues[0].value if update.keyValues else None
        if key is None or update.source != key.value:
            return None
        known = self._fleet.knows(str(key.value))
        other = self._meet(str(key.value), None)
        if other is None or other.speaks_here:
            return None
        if not known:
            self.strangers.set()
        return other

    def _meet(self, asset: str, uri: str | None) -> Other | None:
        if asset == self._asset:
            return None
        try:
            other = self._fleet.meet(asset)
        except MalError as error:
            _LOG.debug("%s is not listened to: %s", asset[:80], error)
            return None
        if not other.speaks_here:
            other.above = True
            other.uri = uri or other.uri
        return other
