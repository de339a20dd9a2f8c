"""This asset among others: serves what is told of assets, and joins another's service layer."""

from dataclasses import replace
from typing import TYPE_CHECKING, Final

from adapters.mal import MalUri
from adapters.mrs.aboard import Gateway, ServedOperations
from adapters.mrs.fleet.asset_discovery import AssetDiscovery, Dialer
from adapters.mrs.fleet.client_services import MonitoringClientService, NotificationClientService
from adapters.mrs.fleet.directory_service import DirectoryService
from adapters.mrs.fleet.known_assets import KnownAssets
from adapters.mrs.spec import Notification, ParameterValue, ServiceDescriptor
from adapters.mrs.terms import Terms
from executive.settings import Settings

if TYPE_CHECKING:
    from adapters.mrs.fleet.fleet_link import FleetLink, FleetPublisher

EVERY_ADDRESS: Final = ("", "0.0.0.0", "::")


class FleetService:
    """Serves Service Layer, Monitoring Client and Notification Client, and joins another's.

    Every executive is a service layer with a broker, where others may register and publish. Told to
    `join` one, it does so too.

    Args:
        terms: on which others are spoken to.
    """

    def __init__(
        self, offer: ServedOperations, core: Gateway, settings: Settings, terms: Terms
    ) -> None:
        """Put the operations up."""
        self._asset = settings.asset
        self._domain = settings.domain
        self._offer = offer
        self._core = core
        self._dialling = Dialer(settings.asset, terms)
        self._fleet = KnownAssets(settings.asset)
        self._directory = DirectoryService(offer, core, settings, self._fleet)
        inquiry = AssetDiscovery(self._dialling)
        self._monitoring = MonitoringClientService(offer, core, settings, self._fleet, inquiry)
        self._notification = NotificationClientService(offer, core, settings, self._fleet)
        self._speaker: FleetPublisher | None = None
        self._link: FleetLink | None = None

    def value(self, value: ParameterValue) -> None:
        """Tell a value of this asset."""
        self._monitoring.publish(value, self._asset)
        if self._speaker is not None:
            self._speaker.value(value)

    def notification(self, notification: Notification) -> None:
        """Tell a notification of this asset."""
        self._notification.publish(notification, self._asset)
        if self._speaker is not None:
            self._speaker.notification(notification)

    def join(self, uri: MalUri) -> None:
        """Register at another service layer, speak and listen there, until told to leave."""
        from adapters.mrs.fleet.fleet_link import (
            FleetLink,  # for who has another above
            FleetPublisher,
        )
        from adapters.mrs.fleet.fleet_subscriber import FleetSubscriber

        self._speaker = FleetPublisher(self._asset, self._domain, self._core)
        listener = FleetSubscriber(self._asset, self._fleet, self._monitoring, self._notification)
        self._link = FleetLink(
            uri,
            self._core,
            self._dialling,
            self._registration,
            self._directory.listed_above,
            self._speaker,
            listener,
        )
        self._link.start()

    async def leave(self) -> None:
        """Say the rest and deregister, where that can be done."""
        if self._link is not None:
            await self._link.leave()

    def _registration(self, local_host: str) -> ServiceDescriptor:
        """Describe this Service Layer, given the address from where others are called."""
        served = self._offer.provider.uri
        host = local_host if served.host in EVERY_ADDRESS else served.host
        return self._directory.self_at(replace(served, host=host))
