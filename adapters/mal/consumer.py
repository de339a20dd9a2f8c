"""The consumer's side: sends messages and waits for what comes back; publishes at a broker."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from ssl import SSLContext, SSLError
from typing import Any

from adapters.mal.attribute_codec import Encoding
from adapters.mal.binding import ATTRIBUTES
from adapters.mal.codec import Codec
from adapters.mal.connection import MalUri
from adapters.mal.errors import MalError, StandardError
from adapters.mal.mal_area import NamedValue, NullableAttribute, Subscription, UpdateHeader
from adapters.mal.specification import Operation, Specification, Stage
from adapters.mal.transactions import Invocation, OnUpdate, Parts, Progress, Transactions
from adapters.mal.values import AttributeType, Typed


class Publication:
    """A publisher of one operation, registered with a broker.

    The broker answers a publication only if it refuses it: the next call then raises its error.
    """

    def __init__(self, exchange: Transactions, operation: Operation) -> None:
        """Not to be called; see `Consumer.publication`."""
        self.operation = operation
        self._exchange = exchange
        self._names = (operation.service_name, operation.name)
        self._kinds = [ATTRIBUTES[key.type] for key in operation.keys]
        self._number = exchange.new_number()
        self._error: MalError | None = None

    async def publish(
        self,
        *parts: Any,
        keys: tuple[Any, ...],
        domain: tuple[str, ...],
        source: str | None = None,
    ) -> None:
        """Publish an update, and return when the connection takes more.

        Args:
            parts: The parts of the update, without the update header.
            keys: A plain value or None for each subscription key of the operation, in order.
            domain: The domain of the update, outermost part first.
            source: Who publishes.

        Raises:
            EncodeError: A value does not fit the specification.
            MalError: The broker refused an earlier update; this one is not sent.
                DESTINATION_LOST: the connection is gone.
            ValueError: There are more or fewer keys than the operation has.
        """
        if self._error is not None:
            error, self._error = self._error, None
            raise error
        update = UpdateHeader(
            source=source,
            domain=domain,
            keyValues=tuple(
                NullableAttribute(value=None if value is None else Typed(kind, value))
                for kind, value in zip(self._kinds, keys, strict=True)
            ),
        )
        _, _, message = self._exchange.message(
            *self._names, Stage.PUBLISH, (update, *parts), number=self._number
        )
        self._exchange.connection.send(message)
        await self._exchange.connection.drained()

    async def register(self) -> None:
        """Tell the broker; to be called once."""
        types = tuple(self._kinds)
        names = tuple(key.name for key in self.operation.keys)
        await self._exchange.single(
            *self._names, Stage.PUBLISH_REGISTER, (names, types), number=self._number
        )
        self._exchange.keep(self._number, self)

    async def close(self) -> None:
        """Deregister.

        Raises:
            MalError: The broker's answer, DELIVERY_TIMEDOUT, or DESTINATION_LOST.
        """
        self._exchange.forget(self._number)
        await self._exchange.single(*self._names, Stage.PUBLISH_DEREGISTER, ())

    def expects(self, stage: Stage) -> bool:
        """Whether it is about an update."""
        return stage is Stage.PUBLISH

    def take(self, _stage: Stage, _parts: Parts, _octets: int) -> None:
        """Nobody publishes to a publisher."""

    def fail(self, error: MalError) -> None:
        """Keep an error for the next call."""
        self._error = error


class Consumer:
    """A client of one provider over one connection, which is not opened again once it is lost."""

    def __init__(self, exchange: Transactions) -> None:
        """Not to be called; see `connect`."""
        self._exchange = exchange

    @classmethod
    async def connect(
        cls,
        specification: Specification,
        uri: str | MalUri,
        name: str = "consumer",
        encoding: Encoding = Encoding.FIXED,
        timeout_s: float = 5.0,
        is_broker: bool = False,
        tls: SSLContext | None = None,
    ) -> "Consumer":
        """Connect to a provider.

        Args:
            specification: What the provider may serve.
            uri: The provider's URI.
            name: The last part of the consumer's own URI.
            encoding: The body encoding agreed with the provider.
            timeout_s: How long to wait for the connection, and later for each reply.
            is_broker: Whether the URI is that of a broker itself, and not of a provider that has
                one of its own.
            tls: How to encrypt, and whom to believe; see `Certificates.for_consumer`.

        Raises:
            MalError: DESTINATION_TRANSIENT, nobody answers there; AUTHENTICATION_FAILED, TLS could
                not be agreed on. A provider that does not believe this certificate hangs up after
                that: the first interaction is DESTINATION_LOST.
            ValueError: The URI is none.
        """
        target = uri if isinstance(uri, MalUri) else MalUri.parse(uri)
        broker = target if is_broker else target.broker
        codec = Codec(specification, encoding)
        exchange = Transactions(specification, codec, target, broker, timeout_s)
        loop = asyncio.get_running_loop()
        try:
            async with asyncio.timeout(timeout_s):
                await loop.create_connection(
                    lambda: exchange.connection, target.host, target.port, ssl=tls
                )
        except OSError as fault:
            number = StandardError.DESTINATION_TRANSIENT
            if isinstance(fault, SSLError):
                number = StandardError.AUTHENTICATION_FAILED
            text = f"{target}: {str(fault) or 'no answer'}"
            raise MalError(number, Typed(AttributeType.STRING, text)) from fault
        exchange.own_uri = str(MalUri(*exchange.connection.local_address, name))
        return cls(exchange)

    async def send(
        self, service: str, operation: str, *parts: Any, supplements: tuple[NamedValue, ...] = ()
    ) -> None:
        """Do a SEND, and return when the connection takes more; nobody says whether it arrived.

        Raises:
            EncodeError: A part does not fit the specification.
            KeyError: There is no such operation.
            MalError: DESTINATION_LOST.
        """
        _, _, message = self._exchange.message(service, operation, Stage.SEND, parts, supplements)
        self._exchange.connection.send(message)
        await self._exchange.connection.drained()

    async def submit(
        self, service: str, operation: str, *parts: Any, supplements: tuple[NamedValue, ...] = ()
    ) -> None:
        """Do a SUBMIT, and return when it is acknowledged.

        Raises:
            EncodeError: A part does not fit the specification.
            KeyError: There is no such operation.
            MalError: The provider's answer, DELIVERY_TIMEDOUT, or DESTINATION_LOST.
        """
        await self._exchange.single(service, operation, Stage.SUBMIT, parts, supplements)

    async def request(
        self, service: str, operation: str, *parts: Any, supplements: tuple[NamedValue, ...] = ()
    ) -> tuple[Any, ...]:
        """Do a REQUEST, and return the parts of the response; raises as `submit` does."""
        return await self._exchange.single(service, operation, Stage.REQUEST, parts, supplements)

    async def invoke(
        self,
        service: str,
        operation: str,
        *parts: Any,
        supplements: tuple[NamedValue, ...] = (),
        timeout_s: float | None = None,
    ) -> Invocation:
        """Do an INVOKE, and return when it is acknowledged; raises as `submit` does.

        Args:
            service: Name of the service.
            operation: Name of the operation.
            parts: The parts of the message.
            supplements: Named attributes for the header.
            timeout_s: How long to wait for the response; None for as long as for any reply.
        """
        invocation = self._exchange.begin(
            Invocation, service, operation, Stage.INVOKE, parts, supplements, timeout_s
        )
        await invocation.begin(self._exchange.timeout_s)
        return invocation

    @asynccontextmanager
    async def progress(
        self,
        service: str,
        operation: str,
        *parts: Any,
        supplements: tuple[NamedValue, ...] = (),
        timeout_s: float | None = None,
    ) -> AsyncIterator[Progress]:
        """Do a PROGRESS, which is entered when it is acknowledged; raises as `submit` does.

        What still comes after it is left goes nowhere. The MAL has no message that stops the
        provider; closing the connection does.

        Args:
            service: Name of the service.
            operation: Name of the operation.
            parts: The parts of the message.
            supplements: Named attributes for the header.
            timeout_s: How long to wait for each update and the response; None for as long as for
                any reply.
        """
        progress = self._exchange.begin(
            Progress, service, operation, Stage.PROGRESS, parts, supplements, timeout_s
        )
        await progress.begin(self._exchange.timeout_s)
        try:
            yield progress
        finally:
            progress.end()

    async def subscribe(
        self, service: str, operation: str, subscription: Subscription, on_update: OnUpdate
    ) -> None:
        """Register a subscription; raises as `submit` does.

        The provider forgets it when the connection is lost.
        """
        with self._exchange.subscriptions.added(service, operation, subscription, on_update):
            await self._exchange.single(service, operation, Stage.REGISTER, (subscription,))

    async def unsubscribe(self, service: str, operation: str, subscription_id: str) -> None:
        """Deregister a subscription; raises as `submit` does."""
        await self._exchange.single(service, operation, Stage.DEREGISTER, ((subscription_id,),))
        self._exchange.subscriptions.remove(service, operation, subscription_id)

    async def publication(self, service: str, operation: str) -> Publication:
        """Register as a publisher of a PUBSUB operation; raises as `submit` does.

        The broker forgets it when the connection is lost.
        """
        publication = Publication(
            self._exchange, self._exchange.specification.operation(service, operation)
        )
        await publication.register()
        return publication

    @property
    def local_address(self) -> tuple[str, int]:
        """The host and port of this end, while the connection is open."""
        return self._exchange.connection.local_address

    async def lost(self) -> None:
        """Return when the connection is gone, by whichever end."""
        await asyncio.shield(self._exchange.connection.lost)

    async def close(self) -> None:
        """Close the connection."""
        await self._exchange.connection.close()
