"""The Service Layer: which services and operations work here, and what the asset is."""

import asyncio
from typing import Final

from adapters.mal.mal_area import ServiceId
from adapters.mal.provider import Call
from adapters.mal.specification import Service
from adapters.mal.uri import MalUri
from adapters.mrs.core import Core
from adapters.mrs.errors import AreaError, with_text
from adapters.mrs.offer import Offer, publishes
from adapters.mrs.specification import NAME
from adapters.mrs.types import AssetInfo, ServiceDescriptor
from adapters.mrs.values import asset_mode
from executive.settings import Settings

SERVICE: Final = "ServiceLayer"
DISTRIBUTION: Final = "rover-executive"


class DirectoryService:
    """Serves getServices, getService and getAsset. Services cannot be registered."""

    def __init__(self, offer: Offer, core: Core, settings: Settings) -> None:
        """Put the operations up."""
        self._offer = offer
        self._core = core
        self._settings = settings
        offer.serve(SERVICE, "getServices", self._list)
        offer.serve(SERVICE, "getService", self._get)
        offer.serve(SERVICE, "getAsset", self._asset)

    def _list(self, call: Call) -> tuple[tuple[ServiceDescriptor, ...]]:
        return (tuple(self._describe(call, service) for service in self._offer.services()),)

    def _get(self, call: Call, name: str) -> tuple[ServiceDescriptor]:
        for service in self._offer.services():
            if service.name == name:
                return (self._describe(call, service),)
        raise with_text(AreaError.NOT_FOUND, name)

    def _asset(self, call: Call) -> asyncio.Future[tuple[AssetInfo]]:
        from importlib.metadata import version  # 1.4 MB, for who asks

        settings, software = self._settings, version(DISTRIBUTION)
        return self._core.ask(
            lambda executive: (
                AssetInfo(
                    asset=settings.asset,
                    domain=settings.domain,
                    description=settings.description,
                    softwareVersion=software,
                    mode=asset_mode(executive.mode),
                ),
            )
        )

    def _describe(self, call: Call, service: Service) -> ServiceDescriptor:
        """Describe a service at the address by which the caller came."""
        uri = MalUri(*call.connection.local_address, NAME)
        first = service.operations[0]
        return ServiceDescriptor(
            name=service.name,
            service=ServiceId(
                keyArea=first.area, keyService=first.service, keyAreaVersion=first.area_version
            ),
            providerURI=str(uri),
            brokerURI=str(uri.broker) if publishes(service) else None,
            operations=self._offer.operations(service),
        )
