"""Monitoring Client and Notification Client: what this asset and all others heard of have told."""

from collections.abc import Awaitable
from typing import Final

from adapters.mal import Call, Connection, Keys, UpdateHeader
from adapters.mrs.aboard import (
    Gateway,
    ServedOperations,
    page_size,
    past_notifications,
    present_values,
)
from adapters.mrs.fleet.asset_discovery import AssetDiscovery
from adapters.mrs.fleet.directory_service import own_info
from adapters.mrs.fleet.known_assets import KnownAssets
from adapters.mrs.spec import (
    AssetInfo,
    Notification,
    ParameterValue,
    invalid,
    is_valid_notification,
    is_valid_value,
    notification_keys,
    require_few,
)
from executive.settings import Settings

MONITORING: Final = "MonitoringClient"
MONITOR_VALUE: Final = "monitorAssetValue"


class MonitoringClientService:
    """Serves the three operations; others publish through the broker as themselves.

    What an asset says itself carries its name as source; what is passed on, that of who does.
    """

    def __init__(
        self,
        offer: ServedOperations,
        core: Gateway,
        settings: Settings,
        fleet: KnownAssets,
        inquiry: AssetDiscovery,
    ) -> None:
        """Put the operations up."""
        self._core = core
        self._settings = settings
        self._fleet = fleet
        self._inquiry = inquiry
        self._publisher = offer.publisher(MONITORING, MONITOR_VALUE)
        offer.provider.open(MONITORING, MONITOR_VALUE, droppable=True, admit=self._admit)
        offer.serve(MONITORING, "listAssets", self._list)
        offer.serve(MONITORING, "getValue", self._get)

    def publish(
        self, value: ParameterValue, asset: str, domain: tuple[str, ...] | None = None
    ) -> None:
        """Broadcast a value, this asset's own or one that it passes on."""
        self._publisher.publish(
            value,
            keys=(asset, value.name),
            domain=self._settings.domain if domain is None else domain,
            source=self._settings.asset,
            droppable=True,
        )

    def _admit(
        self, connection: Connection, update: UpdateHeader, keys: Keys, value: ParameterValue
    ) -> None:
        asset = publishing_asset(update, keys)
        other = self._fleet.speaking(asset, connection)
        name = keys["parameter"]
        if name is None or name.value != value.name or not is_valid_value(value):
            raise invalid(1)
        other.take_value(value)

    async def _list(self, _: Call) -> tuple[tuple[AssetInfo, ...]]:
        (own,) = await own_info(self._core)
        return ((own, *await self._inquiry.ask(self._fleet.others)),)

    def _get(
        self, _: Call, asset: str, names: tuple[str, ...]
    ) -> Awaitable[tuple[tuple[ParameterValue, ...]]] | tuple[tuple[ParameterValue, ...]]:
        if asset == self._settings.asset:
            return present_values(self._core, names)
        require_few(names)
        other = self._fleet.find(asset)
        return (tuple(other.value(name) for name in names or other.values),)


def publishing_asset(update: UpdateHeader, keys: Keys) -> str:
    """Return the asset that an update is of, which must be its source too.

    Raises:
        MalError: Invalid, it is not.
    """
    asset = keys["asset"]
    if asset is None or update.source != asset.value:
        raise invalid(0)
    return str(asset.value)


NOTIFICATION: Final = "NotificationClient"
MONITOR_NOTIFICATION: Final = "monitorAssetNotification"
NOTIFICATION_KEYS: Final = ("asset", "kind", "severity", "commandId", "stage")


class NotificationClientService:
    """Serves the two operations; others publish through the broker as themselves."""

    def __init__(
        self, offer: ServedOperations, core: Gateway, settings: Settings, fleet: KnownAssets
    ) -> None:
        """Put the operations up."""
        self._core = core
        self._settings = settings
        self._fleet = fleet
        self._publisher = offer.publisher(NOTIFICATION, MONITOR_NOTIFICATION)
        offer.provider.open(NOTIFICATION, MONITOR_NOTIFICATION, admit=self._admit)
        offer.serve(NOTIFICATION, "getNotifications", self._get)

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
        asset = publishing_asset(update, keys)
        other = self._fleet.speaking(asset, connection)
        given = tuple(
            None if (key := keys[name]) is None else key.value for name in NOTIFICATION_KEYS
        )
        if given != notification_keys(asset, notification) or not is_valid_notification(
            notification
        ):
            raise invalid(1)
        other.take_notification(notification)

    def _get(
        self, _: Call, asset: str, since: int | None, most: int
    ) -> Awaitable[tuple[tuple[Notification, ...]]] | tuple[tuple[Notification, ...]]:
        if asset == self._settings.asset:
            return past_notifications(self._core, since, None, most)
        return (self._fleet.find(asset).history.since(since or 0, page_size(most)),)
