"""`DirectoryService`, service ServiceLayer: directory of the own and the registered services."""

from dataclasses import dataclass, replace
from typing import Final

from adapters.mal import CallContext, Connection, MalError, MalUri, StandardError
from adapters.mrs.aboard import ServedOperations
from adapters.mrs.fleet.known_assets import KnownAssets
from adapters.mrs.spec import (
    MAX_NAME_LENGTH,
    AreaError,
    ServiceDescriptor,
    find_or_raise,
    find_service,
    is_valid_name,
    mrs_specification,
    with_text,
)
from adapters.mrs.transport import NAME

SERVICE: Final = "ServiceLayer"
SERVICE_LAYER_ABOVE: Final = f"{SERVICE}.above"
"""Name in the directory of the service layer at which this asset is registered."""
MAX_SERVICES: Final = 64
MAX_SERVICES_PER_PEER: Final = 24
"""Maximum services of one peer, so that it cannot fill the directory; chosen, not measured."""
MAX_OPERATIONS: Final = 256
MAX_URI_LENGTH: Final = 256
MAX_PORT: Final = 65535
_ADDRESS: Final = f"maltcp://HOST:PORT/NAME, at most {MAX_URI_LENGTH} characters"


def asset_of(descriptor: ServiceDescriptor) -> str | None:
    """Return the asset of a descriptor with the name `ASSET.ServiceLayer`, or None."""
    asset, _, service = descriptor.name.rpartition(".")
    return asset if asset and service == SERVICE else None


def descriptor_fault(descriptor: ServiceDescriptor) -> str | None:
    """Return the error in name, addresses or operations of a descriptor, or None."""
    operations = descriptor.operations
    if not is_valid_name(descriptor.name):
        return f"name: 1 to {MAX_NAME_LENGTH} printable characters without a space"
    if not _reachable(descriptor.providerURI):
        return f"providerURI: {_ADDRESS}"
    if descriptor.brokerURI is not None and not _reachable(descriptor.brokerURI):
        return f"brokerURI: {_ADDRESS}"
    if not 0 < len(operations) <= MAX_OPERATIONS or 0 in operations:
        return f"operations: 1 to {MAX_OPERATIONS} numbers, none of them 0"
    if len(set(operations)) != len(operations):
        return "operations: each number once"
    return _contradiction(descriptor)


def _reachable(uri: str) -> bool:
    try:
        return len(uri) <= MAX_URI_LENGTH and 0 < MalUri.parse(uri).port <= MAX_PORT
    except ValueError:
        return False


def _contradiction(descriptor: ServiceDescriptor) -> str | None:
    """Return the contradiction between a descriptor and the MRS specification, or None.

    A service of the MRS has its name there, optionally after a prefix with a dot; services of other
    areas must not have such a name. Otherwise other areas are not checked.
    """
    name, service = descriptor.name.rpartition(".")[2], find_service(descriptor.service)
    (area,) = (area for area in mrs_specification().areas if area.name == NAME)
    if descriptor.service.keyArea != area.number:
        taken = name in {each.name for each in area.services}
        return f"name: {name} is a service of the {NAME}, area {area.number}" if taken else None
    if service is None:
        return f"service: the {NAME} has no service of that number and version"
    if service.name != name:
        return f"name: must be NAME.{service.name}, as in the {NAME}"
    unknown = {*descriptor.operations} - {operation.number for operation in service.operations}
    return f"operations: {name} has no {min(unknown)}" if unknown else None


@dataclass(frozen=True, slots=True)
class _Registration:
    descriptor: ServiceDescriptor
    connection: Connection

    def is_of(self, connection: Connection) -> bool:
        """Whether its peer is that of a connection, or is disconnected.

        With TLS the same peer has the same certificate name; in clear text, the same host.
        """
        own = self.connection
        if own.peer_name is None:
            return not own.is_open or own.peer_host == connection.peer_host
        return not own.is_open or own.peer_name == connection.peer_name


class ServiceRegistry:
    """Services by name. A name is reserved while the connection that registered it is open.

    With TLS a name begins with that of the registering peer's certificate.
    """

    def __init__(self) -> None:
        self._held: dict[str, _Registration] = {}

    @property
    def descriptors(self) -> tuple[ServiceDescriptor, ...]:
        """All registered services."""
        return tuple(held.descriptor for held in self._held.values())

    def find(self, name: str) -> ServiceDescriptor:
        """Return a service; raises NotFound."""
        return find_or_raise(self._held, name).descriptor

    def register(self, descriptor: ServiceDescriptor, connection: Connection) -> None:
        """Add a service, or renew the registration of the same peer and address.

        If the registry is full, a service with a closed connection is dropped.

        Raises:
            MalError: Invalid, the descriptor is not valid; Rejected, the certificate has another
                name; Duplicate, the name is reserved by another service; TOO_MANY.
        """
        fault = descriptor_fault(descriptor)
        if fault is not None:
            raise with_text(AreaError.INVALID, fault)
        peer = connection.peer_name
        if peer is not None and not (peer and descriptor.name.startswith(f"{peer}.")):
            text = f"{descriptor.name}: the certificate has the name {peer or 'none'}"
            raise with_text(AreaError.REJECTED, text)
        held = self._held.get(descriptor.name)
        if held is not None and held.connection.is_open:
            same_uri = held.descriptor.providerURI == descriptor.providerURI
            if not (same_uri and held.is_of(connection)):
                raise with_text(AreaError.DUPLICATE, descriptor.name)
        elif held is None:
            self._require_capacity(connection)
        self._held[descriptor.name] = _Registration(descriptor, connection)

    def deregister(self, name: str, connection: Connection) -> None:
        """Remove a service.

        Raises:
            MalError: NotFound; Rejected, another peer registered it and is connected.
        """
        held = find_or_raise(self._held, name)
        if not held.is_of(connection):
            raise with_text(AreaError.REJECTED, f"{name} was registered by {held.connection.peer}")
        del self._held[name]

    def _require_capacity(self, connection: Connection) -> None:
        own = [held for held in self._held.values() if held.connection.is_open]
        if sum(held.is_of(connection) for held in own) >= MAX_SERVICES_PER_PEER:
            text = f"at most {MAX_SERVICES_PER_PEER} registered services of one peer"
            raise with_text(StandardError.TOO_MANY, text)
        if len(self._held) == MAX_SERVICES:
            self._drop_one()

    def _drop_one(self) -> None:
        for name, held in self._held.items():
            if not held.connection.is_open:
                del self._held[name]
                return
        raise with_text(StandardError.TOO_MANY, f"at most {MAX_SERVICES} registered services")


class DirectoryService:
    """Serves ServiceLayer except getAsset.

    The directory lists services of this asset, registered services, and the upstream service layer.
    """

    def __init__(self, served: ServedOperations, asset: str, known: KnownAssets) -> None:
        self._served = served
        self._own = f"{asset}.{SERVICE}"
        self._known = known
        self._registry = ServiceRegistry()
        self._above: ServiceDescriptor | None = None
        served.serve(SERVICE, "getServices", self._list)
        served.serve(SERVICE, "getService", self._get)
        served.serve(SERVICE, "registerService", self._register)
        served.serve(SERVICE, "deregisterService", self._deregister)

    def describe_self(self, uri: MalUri) -> ServiceDescriptor:
        """Return the descriptor to register upstream, given the address of this asset."""
        service = next(each for each in self._served.services() if each.name == SERVICE)
        return self._served.describe(service, uri, self._own)

    def list_above(self, service: ServiceDescriptor) -> None:
        """List the upstream service layer as `SERVICE_LAYER_ABOVE`."""
        self._above = replace(service, name=SERVICE_LAYER_ABOVE)

    def _list(self, call: CallContext) -> tuple[tuple[ServiceDescriptor, ...]]:
        above = () if self._above is None else (self._above,)
        return ((*self._served.descriptors(call), *self._registry.descriptors, *above),)

    def _get(self, call: CallContext, name: str) -> tuple[ServiceDescriptor]:
        (known,) = self._list(call)
        return (find_or_raise({each.name: each for each in known}, name),)

    def _register(self, call: CallContext, descriptor: ServiceDescriptor) -> None:
        served = {service.name for service in self._served.services()}
        if descriptor.name in served | {self._own, SERVICE_LAYER_ABOVE}:
            raise with_text(AreaError.DUPLICATE, descriptor.name)
        asset = asset_of(descriptor)
        if asset is not None and descriptor_fault(descriptor) is None:
            descriptor = _at_peer(descriptor, call.connection.peer_host)
        self._registry.register(descriptor, call.connection)
        if asset is None:
            return
        try:
            other = self._known.find_or_add(asset)
        except MalError:
            self._registry.deregister(descriptor.name, call.connection)
            raise
        other.connection, other.uri = call.connection, descriptor.providerURI

    def _deregister(self, call: CallContext, name: str) -> None:
        asset = asset_of(self._registry.find(name))
        self._registry.deregister(name, call.connection)
        if asset is not None and self._known.knows(asset):
            self._known.find(asset).connection = None


def _at_peer(descriptor: ServiceDescriptor, host: str) -> ServiceDescriptor:
    """Return a descriptor with the URIs moved to the host that registered it.

    Clients connect to these URIs; a registration must not send them to a third host.
    """

    def at_host(uri: str) -> str:
        return str(replace(MalUri.parse(uri), host=host))

    broker = descriptor.brokerURI
    return replace(
        descriptor,
        providerURI=at_host(descriptor.providerURI),
        brokerURI=None if broker is None else at_host(broker),
    )
