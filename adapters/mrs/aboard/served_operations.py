"""`ServedOperations` registers an MRS provider's operations, also in its directory; rate limits."""

import asyncio
from collections import deque
from collections.abc import Callable
from functools import partial
from math import inf
from typing import Any, Final, TypeVar
from weakref import WeakKeyDictionary

from adapters.mal import (
    CallContext,
    Connection,
    Encoding,
    Handler,
    Interaction,
    MalUri,
    Pattern,
    PeerLimits,
    Provider,
    Publisher,
    Service,
    StandardError,
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
"""Maximum octets of a message accepted aboard.

A useful message, such as a plan, has at most 256 KiB. Outgoing messages, such as chunks of a
file, are not bounded by it.
"""
MAX_PRIORITY_CONNECTIONS: Final = 4
"""Maximum priority connections: those that last proved to hold the authority."""
MAX_PEERS: Final = 1024
"""Maximum peers with a stored token bucket: the last ones."""
LIMITS: Final = PeerLimits(
    message_octets=MESSAGE_CAP,
    unfinished_octets=8 * MESSAGE_CAP,
    unread_octets=32 << 20,
    elements=2048,
)
"""Bounds of all clients of the link together. Useful lists have at most 1000 names; decoding
`elements` elements takes less time than a stop may be late."""

HELD_S: Final = 2.0
"""Delay of held messages beyond the usual one, s; chosen, above usual jitter."""
SEPARATE_S: Final = 0.5
"""Time between arrivals that are no burst, s: half of a client's heartbeat period."""
BETWEEN_ASSETS: Final = frozenset(
    {"ServiceLayer", "MonitoringClient", "NotificationClient", "Monitoring.publishParameters"}
)
"""Services, and one operation, that rovers call without an operator: no contact with the ground."""


class PeerRateLimiter:
    """Limits the events a second of each peer, with a burst of the same number (token bucket).

    Args:
        max_hz: maximum events a second.
        now_s: a monotonic clock.
    """

    def __init__(self, max_hz: int, now_s: Callable[[], float]) -> None:
        self._max_hz = max_hz
        self._now_s = now_s
        self._spent_until_s: dict[str, float] = {}

    def admit(self, peer: str) -> None:
        """Count an event of a peer; raises TOO_MANY."""
        now_s = self._now_s()
        at_s = max(now_s, self._spent_until_s.pop(peer, now_s))
        full = at_s - now_s > 1.0 - 0.5 / self._max_hz
        self._spent_until_s[peer] = at_s if full else at_s + 1.0 / self._max_hz
        if len(self._spent_until_s) > MAX_PEERS:
            del self._spent_until_s[next(iter(self._spent_until_s))]
        if full:
            text = f"at most {self._max_hz} a second of {peer}"
            raise with_text(StandardError.TOO_MANY, text)


class HeldMessages:
    """Finds messages of one connection that the link held, e.g. between two contacts.

    They arrive in a burst and prove no present contact. The clocks of both ends may differ, so
    that the delays of messages are compared, and the minimum counts as light time. A longer
    delay that does not change between two separate messages replaces it: a clock was set.
    """

    def __init__(self) -> None:
        self._usual_s = self._compared_s = self._arrived_s = inf

    def is_held(self, sent_utc_s: float, now_s: float) -> bool:
        """Whether a message was held; `now_s` is its arrival by a monotonic clock."""
        delay_s = now_s - sent_utc_s
        if abs(now_s - self._arrived_s) > SEPARATE_S:
            if abs(delay_s - self._compared_s) < SEPARATE_S:
                self._usual_s = delay_s
            self._compared_s, self._arrived_s = delay_s, now_s
        self._usual_s = min(self._usual_s, delay_s)
        return delay_s - self._usual_s > HELD_S


class ServedOperations:
    """A provider and its supported operations.

    Args:
        encoding: encoding of message bodies.
        on_contact: called at each operation call, except held ones and `BETWEEN_ASSETS`.
        system: clock of messages, and sockets.

    Attributes:
        provider: answers NotSupported to every operation that is not registered here.
    """

    def __init__(
        self,
        encoding: Encoding = Encoding.FIXED,
        on_contact: Callable[[], None] = lambda: None,
        system: System = OPERATING_SYSTEM,
    ) -> None:
        self._on_contact, self._now_s = on_contact, system.now_s
        self._held: WeakKeyDictionary[Connection, HeldMessages] = WeakKeyDictionary()
        self._specification = mrs_specification()
        self.provider = Provider(
            self._specification,
            NAME,
            encoding,
            not_served=with_text(
                AreaError.NOT_SUPPORTED, "this asset does not support this operation"
            ),
            limits=LIMITS,
            logged=(AreaError.INVALID.value,),
            system=system,
        )
        self._working: set[tuple[str, str]] = set()
        self._recognised: deque[Connection] = deque(maxlen=MAX_PRIORITY_CONNECTIONS)
        self.provider.set_priority_check(self._recognised.__contains__)

    def serve(self, service: str, operation: str, handler: Handler) -> None:
        """Register a handler of an operation that is no PUBSUB."""

        def with_contact(call: CallContext | Interaction, *parts: Any) -> Any:
            self._record_contact(call.call if isinstance(call, Interaction) else call)
            return handler(call, *parts)

        between_assets = BETWEEN_ASSETS & {service, f"{service}.{operation}"}
        self.provider.serve(service, operation, handler if between_assets else with_contact)
        self._working.add((service, operation))

    def _record_contact(self, call: CallContext) -> None:
        held = self._held.setdefault(call.connection, HeldMessages())
        sent_utc_s = (call.timestamp_ns or 0) / 1e9  # 0 is that of a sender without a clock
        if not sent_utc_s or not held.is_held(sent_utc_s, self._now_s()):
            self._on_contact()

    def prioritize(
        self,
        connection: Connection,
        answer: "asyncio.Future[T]",
        holds: Callable[[T], bool] = lambda _: True,
    ) -> None:
        """Give a connection priority over all others once an answer proves the authority."""

        def answered(_: "asyncio.Future[T]") -> None:
            refused = answer.cancelled() or answer.exception() is not None
            if not refused and holds(answer.result()) and connection not in self._recognised:
                self._recognised.append(connection)

        answer.add_done_callback(answered)

    def serve_query(
        self, service: str, operation: str, gateway: CoreGateway, question: Callable[..., Any]
    ) -> None:
        """Register a REQUEST that `question(executive, *parts)` answers on the core's thread."""

        def handler(_: CallContext, *parts: Any) -> Any:
            return gateway.query(lambda executive: (question(executive, *parts),))

        self.serve(service, operation, handler)

    def publisher(
        self, service: str, operation: str, on_subscribed: Callable[[], None] = lambda: None
    ) -> Publisher:
        """Open a PUBSUB operation whose updates are made only while it has subscribers."""
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
            `publish(*parts, keys)`, with the asset as source by default; see
            `adapters.mal.Publisher`.
        """
        publisher = self.publisher(service, operation)
        return partial(publisher.publish, source=asset, domain=domain, droppable=droppable)

    def services(self) -> tuple[Service, ...]:
        """Return the services with at least one supported operation."""
        names = {service for service, _ in self._working}
        return tuple(
            service
            for area in self._specification.areas
            for service in area.services
            if service.name in names
        )

    def describe(self, service: Service, uri: MalUri, name: str) -> ServiceDescriptor:
        """Return a service as a directory lists it, given its address and name."""
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
