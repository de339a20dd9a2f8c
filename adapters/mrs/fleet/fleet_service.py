"""`FleetService` serves the data of all known assets, and joins another service layer.

It queries each asset at its own address for its description, and caches the answer.
"""

import asyncio
import logging
from dataclasses import dataclass, replace
from typing import Final

from adapters.mal import CallContext, Connection, Keys, MalError, MalUri, UpdateHeader
from adapters.mrs.aboard import (
    AssetServices,
    CoreGateway,
    ServedOperations,
    own_info,
    page_size,
    past_notifications,
    present_values,
)
from adapters.mrs.fleet.directory_service import DirectoryService
from adapters.mrs.fleet.fleet_link import FleetLink, FleetPublisher
from adapters.mrs.fleet.fleet_subscriber import FleetSubscriber
from adapters.mrs.fleet.known_assets import KnownAsset, KnownAssets
from adapters.mrs.ground import Dialer
from adapters.mrs.spec import (
    AreaError,
    AssetInfo,
    AssetMode,
    Notification,
    ParameterValue,
    ServiceDescriptor,
    find_or_raise,
    invalid_error,
    is_valid_notification,
    is_valid_value,
    notification_keys,
    require_at_most,
    with_text,
)
from adapters.mrs.transport import TransportSettings
from adapters.system import OPERATING_SYSTEM, System
from executive.settings import Settings

_LOG: Final = logging.getLogger(__name__)

CONNECT_TIMEOUT_S: Final = 5.0
FRESH_S: Final = 1.0
"""Maximum age of a cached answer; chosen, not measured."""
ANSWER_TIMEOUT_S: Final = 2.0
"""Timeout of an asset's answer; then it is OFFLINE. Chosen, not measured."""
MAX_DOMAIN_PARTS: Final = 16
MAX_TEXT_LENGTH: Final = 256
EVERY_ADDRESS: Final = ("", "0.0.0.0", "::")
MONITORING: Final = "MonitoringClient"
NOTIFICATION: Final = "NotificationClient"

_NOTIFICATION_KEYS: Final = ("asset", "kind", "severity", "commandId", "stage")


class FleetService:
    """Serves ServiceLayer, MonitoringClient and NotificationClient, and joins a service layer.

    Every executive is a service layer with a broker, where other assets register and publish. With
    `join` it registers at another one. The source of an update is the asset itself, or the asset
    that forwards it.
    """

    def __init__(
        self,
        served: ServedOperations,
        gateway: CoreGateway,
        own: AssetServices,
        settings: Settings,
        terms: TransportSettings,
        system: System = OPERATING_SYSTEM,
    ) -> None:
        self._served = served
        self._gateway = gateway
        self._own = own
        self._asset = settings.asset
        self._domain = settings.domain
        self._terms, self._system = terms, system
        self._known = KnownAssets(settings.asset)
        self._directory = DirectoryService(served, settings.asset, self._known)
        self._discovery = AssetDiscovery(settings.asset, terms, system)
        self._link: FleetLink | None = None
        named = (settings.asset, settings.domain)
        value, notification = "monitorAssetValue", "monitorAssetNotification"
        self._publish_value = served.broadcast(MONITORING, value, *named, droppable=True)
        self._publish_notification = served.broadcast(NOTIFICATION, notification, *named)
        served.provider.open(MONITORING, value, droppable=True, admit=self._admit_value)
        served.provider.open(NOTIFICATION, notification, admit=self._admit_notification)
        served.serve(MONITORING, "listAssets", self._list_assets)
        served.serve(MONITORING, "getValue", self._get_value)
        served.serve(NOTIFICATION, "getNotifications", self._get_notifications)
        served.serve("Monitoring", "publishParameters", self._publish_parameters)

    def join(self, uri: MalUri) -> None:
        """Register at another service layer, publish and subscribe there, until `leave`."""
        subscriber = FleetSubscriber(
            self._asset, self._known, self._pass_on_value, self._pass_on_notification
        )
        publisher = FleetPublisher(self._asset, self._domain, self._gateway)
        self._link = FleetLink(
            uri,
            self._gateway,
            Dialer(self._asset, self._terms, CONNECT_TIMEOUT_S, self._system),
            self._registration,
            self._directory.list_above,
            publisher,
            subscriber,
        )
        self._link.start()
        self._own.above = publisher

    async def leave(self) -> None:
        """Publish the backlog and deregister, if connected."""
        if self._link is not None:
            await self._link.leave()

    def _registration(self, local_host: str) -> ServiceDescriptor:
        """Return the descriptor of this service layer, given the local address of a connection."""
        served = self._served.provider.uri
        host = local_host if served.host in EVERY_ADDRESS else served.host
        return self._directory.describe_self(replace(served, host=host))

    def _pass_on_value(self, value: ParameterValue, asset: str, domain: tuple[str, ...]) -> None:
        self._publish_value(value, keys=(asset, value.name), domain=domain)

    def _pass_on_notification(
        self, notification: Notification, asset: str, domain: tuple[str, ...]
    ) -> None:
        keys = notification_keys(asset, notification)
        self._publish_notification(notification, keys=keys, domain=domain)

    def _admit_value(
        self, connection: Connection, update: UpdateHeader, keys: Keys, value: ParameterValue
    ) -> None:
        other = self._known.registered_over(_publishing_asset(update, keys), connection)
        name = keys["parameter"]
        if name is None or name.value != value.name or not is_valid_value(value):
            raise invalid_error(1)
        other.add_value(value)

    def _admit_notification(
        self, connection: Connection, update: UpdateHeader, keys: Keys, notification: Notification
    ) -> None:
        asset = _publishing_asset(update, keys)
        other = self._known.registered_over(asset, connection)
        given = tuple(key and key.value for key in map(keys.get, _NOTIFICATION_KEYS))
        fits = given == notification_keys(asset, notification)
        if not fits or not is_valid_notification(notification):
            raise invalid_error(1)
        other.history.add(notification)

    def _publish_parameters(self, call: CallContext, values: tuple[ParameterValue, ...]) -> None:
        """Accept values of the asset that is registered over this connection, never of this one."""
        require_at_most(values)
        other = self._known.registered_by(call.connection)
        for value in values:
            if not is_valid_value(value):
                text = f"values: {value.name[:80]} must be a VALID finite Double, or NULL"
                raise with_text(AreaError.INVALID, text)
        for value in values:
            other.add_value(value)
            self._pass_on_value(value, other.asset, ())

    async def _list_assets(self, _: CallContext) -> tuple[tuple[AssetInfo, ...]]:
        own = await self._gateway.query(own_info)
        return ((own, *await self._discovery.discover_all(self._known.others)),)

    async def _get_value(
        self, _: CallContext, asset: str, names: tuple[str, ...]
    ) -> tuple[tuple[ParameterValue, ...]]:
        if asset == self._asset:
            values = self._own.housekeeping
            return (
                await self._gateway.query(
                    lambda executive: present_values(executive, names, values)
                ),
            )
        require_at_most(names)
        other = self._known.find(asset)
        return (tuple(find_or_raise(other.values, name) for name in names or other.values),)

    async def _get_notifications(
        self, _: CallContext, asset: str, since: int | None, maximum: int
    ) -> tuple[tuple[Notification, ...]]:
        if asset == self._asset:
            return (
                await self._gateway.query(
                    lambda executive: past_notifications(executive, since, None, maximum)
                ),
            )
        return (self._known.find(asset).history.since(since or 0, page_size(maximum)),)


def _publishing_asset(update: UpdateHeader, keys: Keys) -> str:
    """Return the asset of an update; raises Invalid unless it is also the source."""
    asset = keys["asset"]
    if asset is None or update.source != asset.value:
        raise invalid_error(0)
    return str(asset.value)


@dataclass(frozen=True, slots=True)
class _Answer:
    info: AssetInfo
    at_s: float


class AssetDiscovery:
    """Queries each asset at its own address, and caches the answers."""

    def __init__(self, name: str, terms: TransportSettings, system: System) -> None:
        self._dialer = Dialer(name, terms, ANSWER_TIMEOUT_S, system)
        self._answers: dict[str, _Answer] = {}
        self._queries: dict[str, asyncio.Task[AssetInfo]] = {}

    async def discover_all(self, others: tuple[KnownAsset, ...]) -> tuple[AssetInfo, ...]:
        """Return the description of each other asset; OFFLINE without an answer."""
        for unknown in self._answers.keys() - {other.asset for other in others}:
            del self._answers[unknown]
        return tuple(await asyncio.gather(*map(self._one, others)))

    async def _one(self, other: KnownAsset) -> AssetInfo:
        answer = self._answers.get(other.asset)
        now_s = asyncio.get_running_loop().time()
        if answer is not None and now_s - answer.at_s < FRESH_S:
            return answer.info
        task = self._queries.get(other.asset)
        if task is None:
            task = self._queries[other.asset] = asyncio.create_task(self._discover(other))
            task.add_done_callback(lambda _: self._queries.pop(other.asset))
        return await asyncio.shield(task)

    async def _discover(self, other: KnownAsset) -> AssetInfo:
        try:
            async with asyncio.timeout(ANSWER_TIMEOUT_S):
                info = await self._get(other)
        except (MalError, OSError, ValueError) as fault:
            _LOG.debug("%s does not answer: %s", other.asset, fault)
            info = self._offline(other.asset)
        self._answers[other.asset] = _Answer(info, asyncio.get_running_loop().time())
        return info

    async def _get(self, other: KnownAsset) -> AssetInfo:
        if other.uri is None:
            raise ValueError("its address is unknown")
        consumer = await self._dialer.connect(other.uri)
        try:
            info: AssetInfo
            (info,) = await consumer.request("ServiceLayer", "getAsset")
        finally:
            await consumer.close()
        if info.asset != other.asset or not _is_valid(info):
            raise ValueError(
                f"another asset answers at its address: {info.asset[:MAX_TEXT_LENGTH]}"
            )
        return info

    def _offline(self, asset: str) -> AssetInfo:
        known = self._answers.get(asset)
        if known is not None:
            return replace(known.info, mode=AssetMode.OFFLINE)
        return AssetInfo(
            asset=asset, domain=(), description="", softwareVersion="", mode=AssetMode.OFFLINE
        )


def _is_valid(info: AssetInfo) -> bool:
    texts = (info.description, info.softwareVersion, *info.domain)
    return len(info.domain) <= MAX_DOMAIN_PARTS and all(
        len(text) <= MAX_TEXT_LENGTH for text in texts
    )
