"""The Service Layer: which services and operations work here, who is registered, what this is."""

import asyncio
from dataclasses import replace
from typing import Final

from adapters.mal import Call, MalError, MalUri
from adapters.mrs.core import Core
from adapters.mrs.errors import AreaError, with_text
from adapters.mrs.fleet import Fleet
from adapters.mrs.offer import Offer
from adapters.mrs.registry import Registry, asset_of
from adapters.mrs.specification import NAME
from adapters.mrs.types import AssetInfo, ServiceDescriptor
from adapters.mrs.values import asset_info
from executive.settings import Settings

SERVICE: Final = "ServiceLayer"
ABOVE: Final = f"{SERVICE}.above"
"""Under which the service layer is listed that this asset is registered at."""
DISTRIBUTION: Final = "rover-executive"


class DirectoryService:
    """Serves the five operations.

    A client finds here what this asset serves, what others registered, and the service layer above.
    """

    def __init__(self, offer: Offer, core: Core, settings: Settings, fleet: Fleet) -> None:
        """Put the operations up."""
        self._offer = offer
        self._core = core
        self._own = f"{settings.asset}.{SERVICE}"
        self._fleet = fleet
        self._registry = Registry()
        self._above: ServiceDescriptor | None = None
        offer.serve(SERVICE, "getServices", self._list)
        offer.serve(SERVICE, "getService", self._get)
        offer.serve(SERVICE, "registerService", self._register)
        offer.serve(SERVICE, "deregisterService", self._deregister)
        offer.serve(SERVICE, "getAsset", lambda _: own_info(core))

    def self_at(self, uri: MalUri) -> ServiceDescriptor:
        """Return this service as it is registered elsewhere, given where this asset is reached."""
        service = next(known for known in self._offer.services() if known.name == SERVICE)
        return self._offer.describe(service, uri, self._own)

    def listed_above(self, service: ServiceDescriptor) -> None:
        """List the Service Layer that this asset is registered at, under the name `ABOVE`."""
        self._above = replace(service, name=ABOVE)

    def _list(self, call: Call) -> tuple[tuple[ServiceDescriptor, ...]]:
        uri = MalUri(*call.connection.local_address, NAME)
        own = tuple(
            self._offer.describe(service, uri, service.name) for service in self._offer.services()
        )
        above = () if self._above is None else (self._above,)
        return ((*own, *self._registry.descriptors, *above),)

    def _get(self, call: Call, name: str) -> tuple[ServiceDescriptor]:
        (known,) = self._list(call)
        for descriptor in known:
            if descriptor.name == name:
                return (descriptor,)
        raise with_text(AreaError.NOT_FOUND, name)

    def _register(self, call: Call, descriptor: ServiceDescriptor) -> None:
        served = {service.name for service in self._offer.services()}
        if descriptor.name in served | {self._own, ABOVE}:
            raise with_text(AreaError.DUPLICATE, descriptor.name)
        self._registry.register(descriptor, call.connection)
        asset = asset_of(descriptor)
        if asset is None:
            return
        try:
            other = self._fleet.meet(asset)
        except MalError:
            self._registry.deregister(descriptor.name)
            raise
        other.speaker, other.uri = call.connection, descriptor.providerURI

    def _deregister(self, _: Call, name: str) -> None:
        asset = asset_of(self._registry.deregister(name))
        if asset is not None and self._fleet.knows(asset):
            self._fleet.find(asset).speaker = None


def own_info(core: Core) -> asyncio.Future[tuple[AssetInfo]]:
    """Return what this asset is."""
    from importlib.metadata import version  # 1.4 MB, for who asks

    software = version(DISTRIBUTION)
    return core.ask(lambda executive: (asset_info(executive, software),))
