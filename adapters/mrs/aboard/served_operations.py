"""What a provider of the MRS serves: registered here, so that the directory lists what works."""

import asyncio
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any, Final, TypeVar

from adapters.mal import (
    CallContext,
    Connection,
    Encoding,
    Handler,
    MalUri,
    Pattern,
    PeerLimits,
    Provider,
    Publisher,
    Service,
)
from adapters.mrs.aboard.gateway import CoreGateway
from adapters.mrs.spec import (
    NAME,
    AreaError,
    ServiceDescriptor,
    mrs_specification,
    service_id,
    with_text,
)
from adapters.system import OPERATING_SYSTEM, System

T = TypeVar("T")

MESSAGE_CAP: Final = 1 << 20
"""Octets of the longest message taken aboard.

The longest that anyone needs to send is a plan, of 256 KiB at most. What goes out, such as a file's
chunks, is not bounded by it.
"""
MOST_RECOGNISED: Final = 4
"""Connections that are kept for whoever showed last to hold the authority."""
LIMITS: Final = PeerLimits(
    message_octets=MESSAGE_CAP,
    unfinished_octets=8 * MESSAGE_CAP,
    unread_octets=32 << 20,
    elements=2048,
)
"""What everybody on the link together may take up. The longest lists that anyone needs to send are
1000 names; reading as many elements as are allowed takes less than a stop may be late."""

BETWEEN_ASSETS: Final = frozenset(
    {"ServiceLayer", "MonitoringClient", "NotificationClient", "Monitoring.publishParameters"}
)
"""What rovers call on each other, by itself: services, and an operation of another."""


class ServedOperations:
    """A provider, and the operations that work there.

    Args:
        encoding: of the bodies of messages.
        hear: called when an operation is called, unless other rovers may have done so.
        system: the time of messages, and where it listens.

    Attributes:
        provider: answers NotSupported to everything that is not registered here.
    """

    def __init__(
        self,
        encoding: Encoding = Encoding.FIXED,
        hear: Callable[[], None] = lambda: None,
        system: System = OPERATING_SYSTEM,
    ) -> None:
        self._hear = hear
        self._specification = mrs_specification()
        self.provider = Provider(
            self._specification,
            NAME,
            encoding,
            not_served=with_text(
                AreaError.NOT_SUPPORTED, "this asset does not serve this operation"
            ),
            limits=LIMITS,
            logged=(AreaError.INVALID.value,),
            system=system,
        )
        self._working: set[tuple[str, str]] = set()
        self._recognised: deque[Connection] = deque(maxlen=MOST_RECOGNISED)
        self.provider.keep(self._recognised.__contains__)

    def serve(self, service: str, operation: str, handler: Handler) -> None:
        """Let a handler answer an operation that is no PUBSUB."""

        def heard(call: CallContext, *parts: Any) -> Any:
            self._hear()
            return handler(call, *parts)

        between_assets = BETWEEN_ASSETS & {service, f"{service}.{operation}"}
        self.provider.serve(service, operation, handler if between_assets else heard)
        self._working.add((service, operation))

    def recognise(
        self,
        connection: Connection,
        answer: "asyncio.Future[T]",
        holds: Callable[[T], bool] = lambda _: True,
    ) -> None:
        """Keep a connection, however many others want one, once an answer shows the authority."""

        def answered(_: "asyncio.Future[T]") -> None:
            refused = answer.cancelled() or answer.exception() is not None
            if not refused and holds(answer.result()) and connection not in self._recognised:
                self._recognised.append(connection)

        answer.add_done_callback(answered)

    def ask(
        self, service: str, operation: str, gateway: CoreGateway, question: Callable[..., Any]
    ) -> None:
        """Let the core answer a REQUEST: by `question(executive, *parts)`, on its thread."""

        def handler(_: CallContext, *parts: Any) -> Any:
            return gateway.ask(lambda executive: (question(executive, *parts),))

        self.serve(service, operation, handler)

    def publisher(
        self, service: str, operation: str, on_subscribed: Callable[[], None] = lambda: None
    ) -> Publisher:
        """Open a PUBSUB operation whose updates are made only while somebody is subscribed."""
        self._working.add((service, operation))
        return self.provider.publisher(service, operation, on_subscribed)

    def broadcast(
        self,
        service: str,
        operation: str,
        asset: str,
        domain: tuple[str, ...],
        *,
        droppable: bool = False,
    ) -> Callable[..., None]:
        """Open a PUBSUB operation.

        Returns:
            `publish(*parts, keys)`, in the name of the asset unless told otherwise; see
            `adapters.mal.Publisher`.
        """
        publisher = self.publisher(service, operation)
        return partial(publisher.publish, source=asset, domain=domain, droppable=droppable)

    def services(self) -> tuple[Service, ...]:
        """Return the services of which at least one operation works."""
        names = {service for service, _ in self._working}
        return tuple(
            service
            for area in self._specification.areas
            for service in area.services
            if service.name in names
        )

    def describe(self, service: Service, uri: MalUri, name: str) -> ServiceDescriptor:
        """Return a service as a directory lists it, given where it is reached and as what."""
        publishes = any(each.pattern is Pattern.PUBSUB for each in service.operations)
        return ServiceDescriptor(
            name=name,
            service=service_id(service),
            providerURI=str(uri),
            brokerURI=str(uri.broker) if publishes else None,
            operations=tuple(
                each.number
                for each in service.operations
                if (service.name, each.name) in self._working
            ),
        )

    def descriptors(self, call: CallContext) -> tuple[ServiceDescriptor, ...]:
        """Return the services at the address by which a caller reached this provider."""
        uri = MalUri(*call.connection.local_address, NAME)
        return tuple(self.describe(each, uri, each.name) for each in self.services())
