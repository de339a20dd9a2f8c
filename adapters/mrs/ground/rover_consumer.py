"""One consumer for all services of a rover, each where the rover's directory says it is."""

import asyncio
import ssl
from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any, Final

from adapters.mal import (
    AttributeType,
    Consumer,
    MalError,
    MalUri,
    NamedValue,
    OnUpdate,
    ProgressStream,
    Subscription,
    TypedAttribute,
)
from adapters.mrs.spec import AreaError, ServiceDescriptor, find_service, mrs_specification
from adapters.mrs.terms import TransportSettings
from adapters.system import OPERATING_SYSTEM, System

DIRECTORY: Final = "ServiceLayer"


@dataclass(frozen=True, slots=True)
class ServiceLocation:
    """Where something is served.

    Attributes:
        is_broker: whether a broker of its own is there, and not a provider.
    """

    uri: str
    is_broker: bool = False


@dataclass(frozen=True, slots=True)
class ServiceLocations:
    """The services, by name, that are not where the directory is.

    Attributes:
        providers: where their operations are answered.
        brokers: where their updates are subscribed to.
        listed: the operations of each service that is anywhere, by number.
    """

    providers: dict[str, ServiceLocation] = field(default_factory=dict)
    brokers: dict[str, ServiceLocation] = field(default_factory=dict)
    listed: dict[str, tuple[int, ...]] = field(default_factory=dict, compare=False)


def service_locations(found: Iterable[ServiceDescriptor], asked: MalUri) -> ServiceLocations:
    """Sort out what a directory says.

    What it says of itself is where it was asked, by whatever name the ground knows that place: a
    tunnel, another network. A service counts under the name that the specification gives it; what
    other assets registered goes by other names, and no command of this one goes there.

    Args:
        found: what the directory says.
        asked: where it was asked.
    """
    listed = {each.name: each for each in reversed(tuple(found)) if _is_ours(each)}
    itself = listed.get(DIRECTORY)
    here = {str(asked)} if itself is None else {str(asked), itself.providerURI}
    brokers_here = {_broker(uri) for uri in here}
    places = ServiceLocations(listed={name: each.operations for name, each in listed.items()})
    for name, each in listed.items():
        if each.providerURI not in here:
            places.providers[name] = ServiceLocation(each.providerURI)
        if each.brokerURI is None or each.brokerURI in brokers_here:
            continue
        with_provider = each.brokerURI == _broker(each.providerURI)
        places.brokers[name] = (
            ServiceLocation(each.providerURI)
            if with_provider
            else ServiceLocation(each.brokerURI, is_broker=True)
        )
    return places


def _broker(uri: str) -> str | None:
    """Return the broker that belongs to a provider, which is reached over the same connection."""
    try:
        return str(MalUri.parse(uri).broker)
    except ValueError:
        return None  # of a transport that is not spoken here


def _is_ours(descriptor: ServiceDescriptor) -> bool:
    """Whether it is a service of the MRS under its own name."""
    service = find_service(descriptor.service)
    return service is not None and service.name == descriptor.name


class Dialer:
    """Connects to providers and brokers.

    Args:
        name: the last part of this end's own URI.
        terms: the encoding, and the certificates of this end, which are read when first needed.
        timeout_s: how long to wait for a connection, and for each reply.
        system: the time of messages.
    """

    def __init__(
        self,
        name: str,
        terms: TransportSettings,
        timeout_s: float,
        system: System = OPERATING_SYSTEM,
    ) -> None:
        self._name, self._system = name, system
        self._terms = terms
        self._timeout_s = timeout_s
        self._tls: ssl.SSLContext | None = None

    async def connect(self, uri: str | MalUri, *, is_broker: bool = False) -> Consumer:
        """Connect to a provider, or a broker of its own.

        Raises:
            CertificateError: a certificate file cannot be used.
            MalError: nobody answers there, or TLS could not be agreed on.
            ValueError: the URI is none.
        """
        if self._tls is None:
            self._tls = self._terms.for_consumer()
        name, encoding, timeout_s = self._name, self._terms.encoding, self._timeout_s
        return await Consumer.connect(
            mrs_specification(), uri, name, encoding, timeout_s, is_broker, self._tls, self._system
        )


class NotServedError(MalError):
    """An asset serves only a part of the MRS, as its directory says; NotSupported by the MRS."""

    def __init__(self, text: str) -> None:
        super().__init__(AreaError.NOT_SUPPORTED.value, TypedAttribute(AttributeType.STRING, text))


class RoverConsumer:
    """Has the calls of a `Consumer`, and takes each to where its service is.

    A connection to another place than the directory's is opened when it is first needed; when one
    is lost, all are to be made again. Besides what `Consumer` raises, the calls raise
    ConnectionError when nobody answers where the directory sends them.
    """

    def __init__(self, directory: Consumer, dialer: Dialer) -> None:
        self._directory = directory
        self._uri: MalUri | None = None
        self._dialer = dialer
        self._places = ServiceLocations()
        self._opened: dict[ServiceLocation, Consumer] = {}
        self._opening = asyncio.Lock()
        self._lost = asyncio.Event()
        self._watches = [asyncio.create_task(self._watch(directory))]

    async def discover(self, uri: MalUri) -> None:
        """Ask the directory, which was connected to by this URI; raises as `request` does."""
        (found,) = await self._directory.request(DIRECTORY, "getServices")
        self._uri, self._places = uri, service_locations(found, uri)

    def require(self, service: str, operation: str) -> None:
        """Check that the directory lists an operation, where it lists anything.

        Raises:
            NotServedError: it does not.
        """
        listed = self._places.listed
        if service not in listed and listed and service != DIRECTORY:
            raise NotServedError(f"{self._uri} does not serve {service}")
        number = mrs_specification().operation(service, operation).number
        if listed.get(service) and number not in listed[service]:
            raise NotServedError(f"{self._uri} does not serve {service}.{operation}")

    async def submit(
        self, service: str, operation: str, *parts: Any, supplements: tuple[NamedValue, ...] = ()
    ) -> None:
        """Do a SUBMIT, and return when it is acknowledged."""
        provider = await self._provider(service, operation)
        await provider.submit(service, operation, *parts, supplements=supplements)

    async def request(self, service: str, operation: str, *parts: Any) -> tuple[Any, ...]:
        """Do a REQUEST, and return the parts of the response."""
        return await (await self._provider(service, operation)).request(service, operation, *parts)

    @asynccontextmanager
    async def progress(
        self, service: str, operation: str, *parts: Any
    ) -> AsyncIterator[ProgressStream]:
        """Do a PROGRESS, which is entered when it is acknowledged."""
        provider = await self._provider(service, operation)
        async with provider.progress(service, operation, *parts) as progress:
            yield progress

    async def subscribe(
        self, service: str, operation: str, subscription: Subscription, on_update: OnUpdate
    ) -> None:
        """Register a subscription with the service's broker."""
        self.require(service, operation)
        place = self._places.brokers.get(service)
        broker = self._directory if place is None else await self._at(place, service)
        await broker.subscribe(service, operation, subscription, on_update)

    async def lost(self) -> None:
        """Return when any of the connections is gone, by whichever end."""
        await self._lost.wait()

    async def close(self) -> None:
        """Close all connections, even if this is cancelled."""
        for watch in self._watches:
            watch.cancel()
        self._lost.set()
        consumers = (self._directory, *self._opened.values())
        await asyncio.gather(*(consumer.close() for consumer in consumers))

    async def _provider(self, service: str, operation: str) -> Consumer:
        self.require(service, operation)
        place = self._places.providers.get(service)
        return self._directory if place is None else await self._at(place, service)

    async def _at(self, place: ServiceLocation, service: str) -> Consumer:
        async with self._opening:
            if place not in self._opened:
                try:
                    opened = await self._dialer.connect(place.uri, is_broker=place.is_broker)
                except (MalError, ValueError) as error:
                    text = f"{service} is at {place.uri} by the directory: {error}"
                    raise ConnectionError(text) from error
                self._opened[place] = opened
                self._watches.append(asyncio.create_task(self._watch(opened)))
            return self._opened[place]

    async def _watch(self, consumer: Consumer) -> None:
        await consumer.lost()
        self._lost.set()
