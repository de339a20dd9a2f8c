"""The Notification Client service: what this asset and all others heard of have reported."""

from collections.abc import Awaitable
from typing import Final

from adapters.mal import Call, Connection, Keys, UpdateHeader
from adapters.mrs.core import Core
from adapters.mrs.errors import invalid
from adapters.mrs.fleet import Fleet
from adapters.mrs.heard import sound_notification
from adapters.mrs.monitoring_client_service import said_by_itself
from adapters.mrs.notification_service import at_once, past_notifications
from adapters.mrs.offer import Offer
from adapters.mrs.reports import notification_keys
from adapters.mrs.types import Notification
from executive.settings import Settings

SERVICE: Final = "NotificationClient"
MONITOR: Final = "monitorAssetNotification"
KEYS: Final = ("asset", "kind", "severity", "commandId", "stage")


class NotificationClientService:
    """Serves the two operations; others publish through the broker as themselves."""

    def __init__(self, offer: Offer, core: Core, settings: Settings, fleet: Fleet) -> None:
        """Put the operations up."""
        self._core = core
        self._settings = settings
        self._fleet = fleet
        self._publisher = offer.publisher(SERVICE, MONITOR)
        offer.provider.open(SERVICE, MONITOR, admit=self._admit)
        offer.serve(SERVICE, "getNotifications", self._get)

    def publish(
        self, notification: Notification, asset: str, domain: tuple[str, ...] | None = None
    ) -> None:
        """Broadcast a notification, this asset's own or one that it passes on."""
        self._publisher.publish(
            notification,
            keys=notification_keys(asset, notification),
            domain=self._settings.domain if domain is None else domain,
            source=self._settings.asset,
            droppable=False,
        )

    def _admit(
        self, connection: Connection, update: UpdateHeader, keys: Keys, notification: Notification
    ) -> None:
        asset = said_by_itself(update, keys)
        other = self._fleet.speaking(asset, connection)
        given = tuple(None if (key := keys[name]) is None else key.value for name in KEYS)
        if given != notification_keys(asset, notification) or not sound_notification(notification):
            raise invalid(1)
        other.take_notification(notification)

    def _get(
        self, _: Call, asset: str, since: int | None, most: int
    ) -> Awaitable[tuple[tuple[Notification, ...]]] | tuple[tuple[Notification, ...]]:
        if asset == self._settings.asset:
            return past_notifications(self._core, since, None, most)
        return (self._fleet.find(asset).history.since(since or 0, at_once(most)),)
