"""`mrs_specification` loads mrs.xml, which drives the provider and the client."""

from functools import cache
from pathlib import Path
from typing import Final

from adapters.mal import Service, ServiceId, Specification, load_specification
from adapters.mrs.spec import types
from adapters.mrs.transport import NAME

MRS_XML: Final = Path(__file__).with_name("mrs.xml")


@cache
def mrs_specification() -> Specification:
    """Return the specification, bound to the classes of `adapters.mrs.spec.types`."""
    return load_specification(MRS_XML, types)


def service_id(service: Service) -> ServiceId:
    """Return the key of a service in a directory: area, service and version numbers."""
    first = service.operations[0]
    return ServiceId(
        keyArea=first.area, keyService=first.service, keyAreaVersion=first.area_version
    )


def find_service(key: ServiceId) -> Service | None:
    """Return the service of the MRS with this key, or None."""
    return _services().get(key)


@cache
def _services() -> dict[ServiceId, Service]:
    (area,) = (area for area in mrs_specification().areas if area.name == NAME)
    return {service_id(service): service for service in area.services}
