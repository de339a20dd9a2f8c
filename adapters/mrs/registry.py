"""The services that others registered here, and what of a descriptor makes sense."""

from dataclasses import dataclass
from typing import Final

from adapters.mal import Connection, MalError, MalUri, StandardError
from adapters.mrs.errors import AreaError, invalid, with_text
from adapters.mrs.heard import sound_name
from adapters.mrs.specification import mrs_specification
from adapters.mrs.types import ServiceDescriptor

MOST_SERVICES: Final = 64
MOST_OPERATIONS: Final = 256
LONGEST_URI: Final = 256
HIGHEST_PORT: Final = 65535

SERVICE_LAYER: Final = "ServiceLayer"


def asset_of(descriptor: ServiceDescriptor) -> str | None:
    """Return the asset whose Service Layer it describes, which is called `ASSET.ServiceLayer`."""
    asset, _, service = descriptor.name.rpartition(".")
    return asset if asset and service == SERVICE_LAYER else None


def sensible(descriptor: ServiceDescriptor) -> bool:
    """Whether a descriptor makes sense: name, addresses, and operations that the service has."""
    operations = descriptor.operations
    return (
        sound_name(descriptor.name)
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
    called, key = descriptor.name.rpartition(".")[2], descriptor.service
    (area,) = (area for area in mrs_specification().areas if area.name == "MRS")
    if key.keyArea != area.number:
        return called not in {service.name for service in area.services}
    try:
        return all(
            mrs_specification()
            .resolve(area.number, key.keyAreaVersion, key.keyService, number)
            .service_name
            == called
            for number in operations
        )
    except MalError:
        return False


@dataclass(frozen=True, slots=True)
class _Registration:
    descriptor: ServiceDescriptor
    connection: Connection


class Registry:
    """Services by their names. Who holds a name keeps it while its connection is open."""

    def __init__(self) -> None:
        """Hold nothing."""
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
        try:
            return self._held[name].descriptor
        except KeyError:
            raise with_text(AreaError.NOT_FOUND, name) from None

    def register(self, descriptor: ServiceDescriptor, connection: Connection) -> None:
        """Add a service, or have it registered again from its own address.

        Where too many are held, one whose connection is gone gives way.

        Raises:
            MalError: Invalid, the descriptor makes no sense; Duplicate, another service holds the
                name; TOO_MANY.
        """
        if not sensible(descriptor):
            raise invalid(0)
        held = self._held.get(descriptor.name)
        if held is not None and held.connection.is_open:
            if held.descriptor.providerURI != descriptor.providerURI:
                raise with_text(AreaError.DUPLICATE, descriptor.name)
        elif held is None and len(self._held) == MOST_SERVICES:
            self._forget_one()
        self._held[descriptor.name] = _Registration(descriptor, connection)

    def deregister(self, name: str) -> ServiceDescriptor:
        """Remove a service and return it.

        Raises:
            MalError: NotFound.
        """
        descriptor = self.find(name)
        del self._held[name]
        return descriptor

    def _forget_one(self) -> None:
        for name, held in self._held.items():
            if not held.connection.is_open:
                del self._held[name]
                return
        raise with_text(StandardError.TOO_MANY, f"{MOST_SERVICES} registered services at most")
