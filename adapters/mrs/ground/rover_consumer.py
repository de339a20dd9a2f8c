"""`RoverConsumer`: a client of all services of a rover, each at its address in the directory."""

import asyncio
import ssl
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final, TypeVar

from adapters.mal import (
    AttributeType,
    Consumer,
    MalError,
    MalUri,
    NamedValue,
    OnUpdate,
    ProgressStream,
    StandardError,
    Subscription,
    TypedAttribute,
)
from adapters.mrs.spec import AreaError, ServiceDescriptor, find_service, mrs_specification
from adapters.mrs.transport import TransportSettings
from adapters.system import OPERATING_SYSTEM, System

T = TypeVar("T")

DIRECTORY: Final = "ServiceLayer"


@dataclass(frozen=True, slots=True)
class ServiceLocation:
    """Address of a service.

    Attributes:
        is_broker: whether it is a separate broker, not a provider.
    """

    uri: str
    is_broker: bool = False


@dataclass(frozen=True, slots=True)
class ServiceLocations:
    """Addresses of services, by name, that differ from the directory's.

    Attributes:
        listed: operation numbers of every listed service.
    """

    providers: dict[str, ServiceLocation] = field(default_factory=dict)
    brokers: dict[str, ServiceLocation] = field(default_factory=dict)
    listed: dict[str, tuple[int, ...]] = field(default_factory=dict, compare=False)


def service_locations(
    found: Iterable[ServiceDescriptor], requested_uri: MalUri
) -> ServiceLocations:
    """Return the addresses of services from the entries of a directory.

    The directory's own URI is replaced by the queried one, since the client may use a tunnel or
    another network. Only services with the name of the specification count. Those of other assets
    have other names; no command of this rover is sent there.

    Args:
        found: entries of the directory.
        requested_uri: URI at which the directory was queried.
    """
    listed = {each.name: each for each in reversed(tuple(found)) if _is_ours(each)}
    itself = listed.get(DIRECTORY)
    here = {str(requested_uri)} if itself is None else {str(requested_uri), itself.providerURI}
    brokers_here = {_broker(uri) for uri in here}
    locations = ServiceLocations(listed={name: each.operations for name, each in listed.items()})
    for name, each in listed.items():
        if each.providerURI not in here:
            locations.providers[name] = ServiceLocation(each.providerURI)
        if each.brokerURI is None or each.brokerURI in brokers_here:
            continue
        with_provider = each.brokerURI == _broker(each.providerURI)
        locations.brokers[name] = (
            ServiceLocation(each.providerURI)
            if with_provider
            else ServiceLocation(each.brokerURI, is_broker=True)
        )
    return locations


def _broker(uri: str) -> str | None:
    """Return the broker URI of a provider, reached over the same connection."""
    try:
        return str(MalUri.parse(uri).broker)
    except ValueError:
        return None  # another transport, not supported here


def _is_ours(descriptor: ServiceDescriptor) -> bool:
    """Whether it is a service of the MRS with the name of the specification."""
    service = find_service(descriptor.service)
    return service is not None and service.name == descriptor.name


class Dialer:
    """Connects to providers and brokers.

    Args:
        name: the last part of the client's own URI.
        terms: encoding and certificates; the files are read at first use.
        timeout_s: timeout of a connection attempt and of each reply.
        system: clock of messages.
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
        """Connect to a provider, or to a separate broker.

        Raises:
            CertificateError: a certificate file cannot be used.
            MalError: no answer, or the TLS handshake failed.
            ValueError: the URI is not valid.
        """
        if self._tls is None:
            self._tls = self._terms.for_consumer()
        name, encoding, timeout_s = self._name, self._terms.encoding, self._timeout_s
        return await Consumer.connect(
            mrs_specification(), uri, name, encoding, timeout_s, is_broker, self._tls, self._system
        )


class NotServedError(MalError):
    """An operation is missing from the asset's directory; NotSupported of the MRS."""

    def __init__(self, text: str) -> None:
        super().__init__(AreaError.NOT_SUPPORTED.value, TypedAttribute(AttributeType.STRING, text))


async def repeated(request: Callable[[], Awaitable[T]], attempts: int) -> T:
    """Send a request again if it or its answer is lost; raises the last error."""
    while True:
        attempts -= 1
        try:
            return await request()
        except MalError as error:
            if error.number != StandardError.DELIVERY_TIMEDOUT.value or not attempts:
                raise


class RoverConsumer:
    """Has the calls of a `Consumer`, and directs each to the address of its service.

    A connection to another address than the directory's is opened at first use; if one is lost,
    all must be reconnected. Besides the errors of `Consumer`, the calls raise ConnectionError if
    an address of the directory does not answer.
    """

    def __init__(self, directory: Consumer, dialer: Dialer) -> None:
        self._directory = directory
        self._uri: MalUri | None = None
        self._dialer = dialer
        self._locations = ServiceLocations()
        self._answered = asyncio.Event()
        self._fault: MalError | None = None
        self._opened: dict[ServiceLocation, Consumer] = {}
        self._opening = asyncio.Lock()
        self._lost = asyncio.Event()
        self._watches = [asyncio.create_task(self._watch(directory))]

    @property
    def has_answered(self) -> bool:
        """Whether the directory has answered."""
        return self._answered.is_set() and self._fault is None

    @property
    def is_distributed(self) -> bool:
        """Whether the directory lists services at other addresses than its own."""
        return bool(self._locations.providers or self._locations.brokers)

    async def discover(self, uri: MalUri, attempts: int = 1) -> None:
        """Query the directory, connected at this URI; raises as `request` does.

        A call before the answer goes to the directory's own address. If it fails there and the
        directory lists another one, it is sent there.
        """
        try:
            request = partial(self._directory.request, DIRECTORY, "getServices")
            (found,) = await repeated(request, attempts)
            self._uri, self._locations = uri, service_locations(found, uri)
        except MalError as error:
            self._fault = error
            raise
        finally:
            self._answered.set()

    async def wait_discovered(self) -> None:
        """Wait until the directory has answered; raises its error."""
        await self._answered.wait()
        if self._fault is not None:
            raise self._fault

    def require(self, service: str, operation: str) -> None:
        """Check that the directory lists an operation; a directory without entries passes.

        Raises:
            NotServedError: the operation is not listed.
        """
        listed = self._locations.listed
        if service not in listed and listed and service != DIRECTORY:
            raise NotServedError(f"{self._uri} does not serve {service}")
        number = mrs_specification().operation(service, operation).number
        if listed.get(service) and number not in listed[service]:
            raise NotServedError(f"{self._uri} does not serve {service}.{operation}")

    async def lists(self, service: str, operation: str) -> bool:
        """Whether the directory lists an operation; a directory without entries does not."""
        await self.wait_discovered()
        number = mrs_specification().operation(service, operation).number
        return number in self._locations.listed.get(service, ())

    async def submit(
        self, service: str, operation: str, *parts: Any, supplements: tuple[NamedValue, ...] = ()
    ) -> None:
        """Send a SUBMIT, and return when it is acknowledged."""
        await self._call(
            partial(self._consumer_of, service, operation),
            lambda each: each.submit(service, operation, *parts, supplements=supplements),
        )

    async def request(
        self, service: str, operation: str, *parts: Any, **options: Any
    ) -> tuple[Any, ...]:
        """Send a REQUEST with the options of `Consumer.request`, and return the response."""
        return await self._call(
            partial(self._consumer_of, service, operation),
            lambda each: each.request(service, operation, *parts, **options),
        )

    @asynccontextmanager
    async def progress(
        self, service: str, operation: str, *parts: Any
    ) -> AsyncIterator[ProgressStream]:
        """Start a PROGRESS; the context is entered at its acknowledgement."""
        await self.wait_discovered()
        provider = await self._consumer_of(service, operation)
        async with provider.progress(service, operation, *parts) as progress:
            yield progress

    async def subscribe(
        self, service: str, operation: str, subscription: Subscription, on_update: OnUpdate
    ) -> None:
        """Register a subscription with the service's broker."""
        await self._call(
            partial(self._broker_of, service, operation),
            lambda each: each.subscribe(service, operation, subscription, on_update),
        )

    async def wait_lost(self) -> None:
        """Wait until any of the connections is closed, by either end."""
        await self._lost.wait()

    async def close(self) -> None:
        """Close all connections, even if this is cancelled."""
        for watch in self._watches:
            watch.cancel()
        self._lost.set()
        consumers = (self._directory, *self._opened.values())
        await asyncio.gather(*(consumer.close() for consumer in consumers))

    async def _call(
        self, find: Callable[[], Awaitable[Consumer]], call: Callable[[Consumer], Awaitable[T]]
    ) -> T:
        consumer = await find()
        try:
            return await call(consumer)
        except MalError as error:
            if error.number == StandardError.DELIVERY_TIMEDOUT.value:
                raise
            await self.wait_discovered()
            if (listed := await find()) is consumer:
                raise
            return await call(listed)

    async def _broker_of(self, service: str, operation: str) -> Consumer:
        self.require(service, operation)
        location = self._locations.brokers.get(service)
        return self._directory if location is None else await self._at(location, service)

    async def _consumer_of(self, service: str, operation: str) -> Consumer:
        self.require(service, operation)
        location = self._locations.providers.get(service)
        return self._directory if location is None else await self._at(location, service)

    async def _at(self, location: ServiceLocation, service: str) -> Consumer:
        async with self._opening:
            if location not in self._opened:
                try:
                    opened = await self._dialer.connect(location.uri, is_broker=location.is_broker)
                except (MalError, ValueError) as error:
                    text = f"{service}, listed at {location.uri}, is not reachable: {error}"
                    raise ConnectionError(text) from error
                self._opened[location] = opened
                self._watches.append(asyncio.create_task(self._watch(opened)))
            return self._opened[location]

    async def _watch(self, consumer: Consumer) -> None:
        await consumer.wait_lost()
        self._lost.set()
