"""Where the services of a rover are, as its directory tells (thesis 3.3)."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cache
from typing import Final

from adapters.mal import MalUri
from adapters.mrs.specification import mrs_specification
from adapters.mrs.types import ServiceDescriptor

DIRECTORY: Final = "ServiceLayer"


@dataclass(frozen=True, slots=True)
class Place:
    """Where something is served.

    Attributes:
        is_broker: whether a broker of its own is there, and not a provider.
    """

    uri: str
    is_broker: bool = False


@dataclass(frozen=True, slots=True)
class Places:
    """The services, by name, that are not where the directory is.

    Attributes:
        providers: where their operations are answered.
        brokers: where their updates are subscribed to.
    """

    providers: dict[str, Place] = field(default_factory=dict)
    brokers: dict[str, Place] = field(default_factory=dict)


def places_of(found: Iterable[ServiceDescriptor], asked: MalUri) -> Places:
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
    places = Places()
    for name, each in listed.items():
        if each.providerURI not in here:
            places.providers[name] = Place(each.providerURI)
        if each.brokerURI is None or each.brokerURI in brokers_here:
            continue
        with_provider = each.brokerURI == _broker(each.providerURI)
        places.brokers[name] = (
            Place(each.providerURI) if with_provider else Place(each.brokerURI, is_broker=True)
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
    service = descriptor.service
    address = (service.keyArea, service.keyAreaVersion, service.keyService)
    return _addresses().get(descriptor.name) == address


@cache
def _addresses() -> dict[str, tuple[int, int, int]]:
    return {
        operation.service_name: (operation.area, operation.area_version, operation.service)
        for area in mrs_specification().areas
        for service in area.services
        for operation in service.operations
    }
