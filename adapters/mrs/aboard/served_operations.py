"""What a provider of the MRS serves, noted as it is put up: the directory tells the truth."""

from typing import Final

from adapters.mal import Encoding, Handler, MalUri, Pattern, Provider, Publisher, Service, ServiceId
from adapters.mrs.spec import NAME, AreaError, ServiceDescriptor, mrs_specification, with_text

MESSAGE_CAP: Final = 1 << 20
"""Octets of the longest message taken aboard.

The longest that anyone needs to send is a plan, of 256 KiB at most. What goes out, such as a file's
chunks, is not bounded by it. More would let one message of empty list elements hold the link for
longer than its decoding of a second.
"""


class ServedOperations:
    """A provider, and the operations that work there.

    Attributes:
        provider: answers NotSupported to everything that was not put up here.
    """

    def __init__(self, encoding: Encoding = Encoding.FIXED) -> None:
        """Offer nothing yet."""
        self._specification = mrs_specification()
        self.provider = Provider(
            self._specification,
            NAME,
            encoding,
            not_served=with_text(
                AreaError.NOT_SUPPORTED, "this asset does not serve this operation"
            ),
            message_cap=MESSAGE_CAP,
        )
        self._working: set[tuple[str, str]] = set()

    def serve(self, service: str, operation: str, handler: Handler) -> None:
        """Let a handler answer a SUBMIT or REQUEST operation."""
        self.provider.serve(service, operation, handler)
        self._working.add((service, operation))

    def publisher(self, service: str, operation: str) -> Publisher:
        """Open a PUBSUB operation and return what publishes its updates."""
        self._working.add((service, operation))
        return self.provider.publisher(service, operation)

    def services(self) -> tuple[Service, ...]:
        """Return the services of which at least one operation works."""
        names = {service for service, _ in self._working}
        return tuple(
            service
            for area in self._specification.areas
            for service in area.services
            if service.name in names
        )

    def operations(self, service: Service) -> tuple[int, ...]:
        """Return the numbers of the operations that work."""
        return tuple(
            operation.number
            for operation in service.operations
            if (service.name, operation.name) in self._working
        )

    def describe(self, service: Service, uri: MalUri, name: str) -> ServiceDescriptor:
        """Return a service as a directory lists it, given where it is reached and as what."""
        first = service.operations[0]
        return ServiceDescriptor(
            name=name,
            service=ServiceId(
                keyArea=first.area, keyService=first.service, keyAreaVersion=first.area_version
            ),
            providerURI=str(uri),
            brokerURI=str(uri.broker) if _publishes(service) else None,
            operations=self.operations(service),
        )


def _publishes(service: Service) -> bool:
    """Whether a service has a PUBSUB operation."""
    return any(operation.pattern is Pattern.PUBSUB for operation in service.operations)
