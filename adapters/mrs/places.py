"""Where the services of a rover are, as its directory tells (thesis 3.3)."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cache
from typing import Final

from adapters.mal.uri import MalUri
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
    tunnel, another network. If a service is there twice, the one at that place counts, else the
    first.

    Args:
        found: what the directory says.
        asked: where it was asked.
    """
    here = {str(asked), *(each.providerURI for each in found if each.name == DIRECTORY)}
    places, known = Places(), set[str]()
    for each in sorted(found, key=lambda each: each.providerURI not in here):
        name = _service_name(each)
        if name is None or name in known:
            continue
        known.add(name)
        if each.providerURI not in here:
            places.providers[name] = Place(each.providerURI)
        broker = each.brokerURI
        if broker is None or broker in {_broker(uri) for uri in here}:
            continue
        own = broker == _broker(each.providerURI)
        places.brokers[name] = Place(each.providerURI) if own else Place(broker, is_broker=True)
    return places


def _broker(uri: str) -> str | None:
    """Return the broker that belongs to a provider, which is reached over the same connection."""
    try:
        return str(MalUri.parse(uri).broker)
    except ValueError:
        return None  # of a transport that is not spoken here


def _service_name(descriptor: ServiceDescriptor) -> str | None:
    service = descriptor.service
    address = (service.keyArea, service.keyAreaVersion, service.keyService)
    return _names().get(address)


@cache
def _names() -> dict[tuple[int, int, int], str]:
    return {
        (operation.area, operation.area_version, operation.service): service.name
        for area in mrs_specification().areas
        for service in area.services
        for operation in service.operations
    }
