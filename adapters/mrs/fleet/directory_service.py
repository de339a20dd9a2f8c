"""The Service Layer: which services work here, and which others registered."""

from dataclasses import dataclass, replace
from typing import Final

from adapters.mal import Call, Connection, MalError, MalUri, StandardError
from adapters.mrs.aboard import ServedOperations
from adapters.mrs.fleet.known_assets import KnownAssets
from adapters.mrs.spec import (
    AreaError,
    ServiceDescriptor,
    find_service,
    invalid,
    is_valid_name,
    look_up,
    mrs_specification,
    with_text,
)
from adapters.mrs.terms import NAME

SERVICE: Final = "ServiceLayer"
SERVICE_LAYER_ABOVE: Final = f"{SERVICE}.above"
"""Under which the service layer is listed that this asset is registered at."""
MOST_SERVICES: Final = 64
MOST_OPERATIONS: Final = 256
LONGEST_URI: Final = 256
HIGHEST_PORT: Final = 65535


def asset_of(descriptor: ServiceDescriptor) -> str | None:
    """Return the asset whose Service Layer it describes, which is called `ASSET.ServiceLayer`."""
    asset, _, service = descriptor.name.rpartition(".")
    return asset if asset and service == SERVICE else None


def is_valid_descriptor(descriptor: ServiceDescriptor) -> bool:
    """Whether a descriptor makes sense: name, addresses, and operations that the service has."""
    operations = descriptor.operations
    return (
        is_valid_name(descriptor.name)
        and _reachable(descriptor.providerURI)
        and (descriptor.brokerURI is None or _reachable(descriptor.brokerURI))
        and 0 < len(operations) <= MOST_OPERATIONS
        and len({0, *operations}) == len(operations) + 1  # each once, and none is 0
        and _has(descriptor, operations)
    )


def _reachable(uri: str) -> bool:
    try:
        return len(uri) <= LONGEST_URI and 0 < MalUri.parse(uri).port <= HIGHEST_PORT
    except ValueError:
        return False


def _has(descriptor: ServiceDescriptor, operations: tuple[int, ...]) -> bool:
    """Whether a service has the operations: of other areas than the MRS nothing is known here.

    A service of the MRS is called as there, perhaps with something and a dot in front, and no other
    is called so.
    """
    called, service = descriptor.name.rpartition(".")[2], find_service(descriptor.service)
    (area,) = (area for area in mrs_specification().areas if area.name == NAME)
    if descriptor.service.keyArea != area.number:
        return called not in {service.name for service in area.services}
    return (
        service is not None
        and service.name == called
        and {*operations} <= {operation.number for operation in service.operations}
    )


@dataclass(frozen=True, slots=True)
class _Registration:
    descriptor: ServiceDescriptor
    connection: Connection


class ServiceRegistry:
    """Services by name. A name is held while the connection that registered it is open."""

    def __init__(self) -> None:
        self._held: dict[str, _Registration] = {}

    @property
    def descriptors(self) -> tuple[ServiceDescriptor, ...]:
        """All that are registered."""
        return tuple(held.descriptor for held in self._held.values())

    def find(self, name: str) -> ServiceDescriptor:
        """Return a service.

        Raises:
            MalError: NotFound.
        """
        return look_up(self._held, name).descriptor

    def register(self, descriptor: ServiceDescriptor, connection: Connection) -> None:
        """Add a service, or have it registered again from its own address.

        Where too many are held, one whose connection is gone gives way.

        Raises:
            MalError: Invalid, the descriptor makes no sense; Duplicate, another service holds the
                name; TOO_MANY.
        """
        if not is_valid_descriptor(descriptor):
            raise invalid(0)
        held = self._held.get(descriptor.name)
        if held is not None and held.connection.is_open:
            if held.descriptor.providerURI != descriptor.providerURI:
                raise with_text(AreaError.DUPLICATE, descriptor.name)
        elif held is None and len(self._held) == MOST_SERVICES:
            self._drop_one()
        self._held[descriptor.name] = _Registration(descriptor, connection)

    def deregister(self, name: str) -> ServiceDescriptor:
        """Remove a service and return it.

        Raises:
            MalError: NotFound.
        """
        descriptor = self.find(name)
        del self._held[name]
        return descriptor

    def _drop_one(self) -> None:
        for name, held in self._held.items():
            if not held.connection.is_open:
                del self._held[name]
                return
        raise with_text(StandardError.TOO_MANY, f"{MOST_SERVICES} registered services at most")


class DirectoryService:
    """Serves the Service Layer, but for getAsset.

    A client finds here what this asset serves, what others registered, and the service layer above.
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
        """Return this service as it is registered elsewhere, given where this asset is reached."""
        service = next(each for each in self._served.services() if each.name == SERVICE)
        return self._served.describe(service, uri, self._own)

    def list_above(self, service: ServiceDescriptor) -> None:
        """List the Service Layer that this asset is registered at, as `SERVICE_LAYER_ABOVE`."""
        self._above = replace(service, name=SERVICE_LAYER_ABOVE)

    def _list(self, call: Call) -> tuple[tuple[ServiceDescriptor, ...]]:
        above = () if self._above is None else (self._above,)
        return ((*self._served.descriptors(call), *self._registry.descriptors, *above),)

    def _get(self, call: Call, name: str) -> tuple[ServiceDescriptor]:
        (known,) = self._list(call)
        return (look_up({each.name: each for each in known}, name),)

    def _register(self, call: Call, descriptor: ServiceDescriptor) -> None:
        served = {service.name for service in self._served.services()}
        if descriptor.name in served | {self._own, SERVICE_LAYER_ABOVE}:
            raise with_text(AreaError.DUPLICATE, descriptor.name)
        self._registry.register(descriptor, call.connection)
        asset = asset_of(descriptor)
        if asset is None:
            return
        try:
            other = self._known.find_or_add(asset)
        except MalError:
            self._registry.deregister(descriptor.name)
            raise
        other.connection, other.uri = call.connection, descriptor.providerURI

    def _deregister(self, _: Call, name: str) -> None:
        asset = asset_of(self._registry.deregister(name))
        if asset is not None and self._known.knows(asset):
            self._known.find(asset).connection = None
