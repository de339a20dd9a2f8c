"""The Monitoring Client service: the parameters of this asset and of all others heard of."""

from collections.abc import Awaitable
from typing import Final

from adapters.mal import Call, Connection, Keys, UpdateHeader
from adapters.mrs.core import Core
from adapters.mrs.directory_service import own_info
from adapters.mrs.errors import invalid, require_few
from adapters.mrs.fleet import Fleet
from adapters.mrs.heard import sound_value
from adapters.mrs.inquiry import Inquiry
from adapters.mrs.monitoring_service import present_values
from adapters.mrs.offer import Offer
from adapters.mrs.types import AssetInfo, ParameterValue
from executive.settings import Settings

SERVICE: Final = "MonitoringClient"
MONITOR: Final = "monitorAssetValue"


class MonitoringClientService:
    """Serves the three operations; others publish through the broker as themselves.

    What an asset says itself carries its name as source; what is passed on, that of who does.
    """

    def __init__(
        self, offer: Offer, core: Core, settings: Settings, fleet: Fleet, inquiry: Inquiry
    ) -> None:
        """Put the operations up."""
        self._core = core
        self._settings = settings
        self._fleet = fleet
        self._inquiry = inquiry
        self._publisher = offer.publisher(SERVICE, MONITOR)
        offer.provider.open(SERVICE, MONITOR, droppable=True, admit=self._admit)
        offer.serve(SERVICE, "listAssets", self._list)
        offer.serve(SERVICE, "getValue", self._get)

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
        asset = said_by_itself(update, keys)
        other = self._fleet.speaking(asset, connection)
        name = keys["parameter"]
        if name is None or name.value != value.name or not sound_value(value):
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


def said_by_itself(update: UpdateHeader, keys: Keys) -> str:
    """Return the asset that an update is of, which must be its source too.

    Raises:
        MalError: Invalid, it is not.
    """
    asset = keys["asset"]
    if asset is None or update.source != asset.value:
        raise invalid(0)
    return str(asset.value)
