"""The consumer's side: sends messages and waits for what comes back; publishes at a broker."""

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from functools import partial
from ssl import SSLContext, SSLError
from typing import Any, Final

from adapters.mal.attribute_codec import Encoding
from adapters.mal.codec import Codec, Header, encode_message
from adapters.mal.connection import Connection, MalUri
from adapters.mal.errors import DecodeError, MalError, StandardError
from adapters.mal.specification import (
    ATTRIBUTES,
    REPLY,
    InteractionStage,
    Operation,
    Pattern,
    Specification,
)
from adapters.mal.transactions import (
    Invocation,
    OnUpdate,
    Parts,
    ProgressStream,
    Subscriptions,
    Transaction,
    transaction_ids,
)
from adapters.mal.values import (
    NamedValue,
    NullableAttribute,
    Subscription,
    TypedAttribute,
    UpdateHeader,
)
from adapters.system import OPERATING_SYSTEM, System, utc_ns

_LOG: Final = logging.getLogger(__name__)
_GOODBYE_S: Final = 1.0
"""How long a broker may take to forget subscriptions before the connection is closed."""
Supplements = tuple[NamedValue, ...]


class _Refusals(Transaction):
    """What a broker answers to publications: nothing, or an error, of which the newest is kept."""

    newest: MalError | None = None

    def take(self, _stage: InteractionStage, _parts: Parts, _octets: int) -> None:
        """Nobody publishes to a publisher."""

    def fail(self, error: MalError) -> None:
        """Keep an error for the next publication."""
        self.newest = error


class Publication:
    """A publisher of one operation, registered with a broker.

    The broker answers a publication only if it refuses it: the next call then raises its error.
    """

    def __init__(self, consumer: "Consumer", operation: Operation) -> None:
        """Not to be called; see `Consumer.publication`."""
        self._consumer = consumer
        self._names = operation.names
        self._kinds = {key.name: ATTRIBUTES[key.type] for key in operation.keys}
        self._number = next(consumer._numbers)
        self._refusals = _Refusals(
            operation, InteractionStage.PUBLISH, consumer._connection, lambda: None
        )

    async def publish(
        self, *parts: Any, keys: tuple[Any, ...], domain: tuple[str, ...], source: str | None = None
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
        if self._refusals.newest is not None:
            error, self._refusals.newest = self._refusals.newest, None
            raise error
        update = UpdateHeader(
            source=source,
            domain=domain,
            keyValues=tuple(
                NullableAttribute(value=None if value is None else TypedAttribute(kind, value))
                for kind, value in zip(self._kinds.values(), keys, strict=True)
            ),
        )
        self._consumer._send(
            *self._names, InteractionStage.PUBLISH, (update, *parts), number=self._number
        )
        await self._consumer._connection.drain()

    async def register(self) -> None:
        """Tell the broker; to be called once."""
        keys = (tuple(self._kinds), tuple(self._kinds.values()))
        await self._consumer._single(
            *self._names, InteractionStage.PUBLISH_REGISTER, keys, number=self._number
        )
        self._consumer._pending[self._number] = self._refusals

    async def close(self) -> None:
        """Deregister.

        Raises:
            MalError: The broker's answer, DELIVERY_TIMEDOUT, or DESTINATION_LOST.
        """
        self._consumer._pending.pop(self._number, None)
        await self._consumer._single(*self._names, InteractionStage.PUBLISH_DEREGISTER, ())


class Consumer:
    """A client of one provider over one connection, which is not opened again once it is lost."""

    def __init__(
        self,
        specification: Specification,
        codec: Codec,
        provider: MalUri,
        broker: MalUri,
        timeout_s: float,
        system: System,
    ) -> None:
        """Not to be called; see `connect`."""
        self._specification = specification
        self._codec = codec
        self._provider_uri, self._broker_uri = str(provider), str(broker)
        self._timeout_s = timeout_s
        self._system = system
        self._own_uri = ""
        self._connection = Connection(self._receive)
        self._connection.lost.add_done_callback(self._lose)
        self._subscriptions = Subscriptions(specification, codec)
        self._numbers = transaction_ids(system)
        self._pending: dict[int, Transaction] = {}

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
        system: System = OPERATING_SYSTEM,
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
            system: The time and the numbers of messages.

        Raises:
            MalError: DESTINATION_TRANSIENT, no answer; AUTHENTICATION_FAILED, TLS could
                not be agreed on. A provider that does not believe this certificate hangs up after
                that: the first interaction is DESTINATION_LOST.
            ValueError: The URI is none.
        """
        target = uri if isinstance(uri, MalUri) else MalUri.parse(uri)
        broker = target if is_broker else target.broker
        codec = Codec(specification, encoding)
        consumer = cls(specification, codec, target, broker, timeout_s, system)
        loop = asyncio.get_running_loop()
        try:
            async with asyncio.timeout(timeout_s):
                await loop.create_connection(
                    lambda: consumer._connection, target.host, target.port, ssl=tls
                )
        except OSError as fault:
            number = StandardError.DESTINATION_TRANSIENT
            if isinstance(fault, SSLError):
                number = StandardError.AUTHENTICATION_FAILED
            raise MalError(number, f"{target}: {str(fault) or 'no answer'}") from fault
        consumer._own_uri = str(MalUri(*consumer.local_address, name))
        return consumer

    async def send(
        self, service: str, operation: str, *parts: Any, supplements: Supplements = ()
    ) -> None:
        """Do a SEND, and return when the connection takes more; a SEND has no reply.

        Raises:
            EncodeError: A part does not fit the specification.
            KeyError: There is no such operation.
            MalError: DESTINATION_LOST.
        """
        self._send(service, operation, InteractionStage.SEND, parts, supplements)
        await self._connection.drain()

    async def submit(
        self, service: str, operation: str, *parts: Any, supplements: Supplements = ()
    ) -> None:
        """Do a SUBMIT, and return when it is acknowledged.

        Raises:
            EncodeError: A part does not fit the specification.
            KeyError: There is no such operation.
            MalError: The provider's answer, DELIVERY_TIMEDOUT, or DESTINATION_LOST.
        """
        await self._single(service, operation, InteractionStage.SUBMIT, parts, supplements)

    async def request(
        self, service: str, operation: str, *parts: Any, supplements: Supplements = ()
    ) -> tuple[Any, ...]:
        """Do a REQUEST, and return the parts of the response; raises as `submit` does."""
        return await self._single(service, operation, InteractionStage.REQUEST, parts, supplements)

    async def invoke(
        self,
        service: str,
        operation: str,
        *parts: Any,
        supplements: Supplements = (),
        timeout_s: float | None = None,
    ) -> Invocation:
        """Do an INVOKE, and return when it is acknowledged; raises as `submit` does.

        The response is waited for for `timeout_s`; None for as long as any reply.
        """
        transaction = self._begin(service, operation, InteractionStage.INVOKE, parts, supplements)
        invocation = Invocation(transaction, self._timeout_s if timeout_s is None else timeout_s)
        await invocation.begin(self._timeout_s)
        return invocation

    @asynccontextmanager
    async def progress(
        self,
        service: str,
        operation: str,
        *parts: Any,
        supplements: Supplements = (),
        timeout_s: float | None = None,
    ) -> AsyncIterator[ProgressStream]:
        """Do a PROGRESS, which is entered when it is acknowledged; raises as `submit` does.

        Each update and the response are waited for for `timeout_s`; None for as long as any reply.
        What still comes after it is left goes nowhere. The MAL has no message that stops the
        provider; closing the connection does.
        """
        transaction = self._begin(service, operation, InteractionStage.PROGRESS, parts, supplements)
        progress = ProgressStream(transaction, self._timeout_s if timeout_s is None else timeout_s)
        await progress.begin(self._timeout_s)
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
        with self._subscriptions.added(service, operation, subscription, on_update):
            await self._single(service, operation, InteractionStage.REGISTER, (subscription,))

    async def unsubscribe(self, service: str, operation: str, subscription_id: str) -> None:
        """Deregister a subscription; raises as `submit` does."""
        await self._single(service, operation, InteractionStage.DEREGISTER, ((subscription_id,),))
        self._subscriptions.remove(service, operation, subscription_id)

    async def publication(self, service: str, operation: str) -> Publication:
        """Register as a publisher of a PUBSUB operation; raises as `submit` does.

        The broker forgets it when the connection is lost.
        """
        publication = Publication(self, self._specification.operation(service, operation))
        await publication.register()
        return publication

    @property
    def local_address(self) -> tuple[str, int]:
        """The host and port of this end, while the connection is open."""
        return self._connection.local_address

    async def lost(self) -> None:
        """Return when the connection is gone, by whichever end."""
        await asyncio.shield(self._connection.lost)

    async def close(self) -> None:
        """Deregister what is subscribed, and close the connection, even if this is cancelled.

        A broker that dials back to who hung up, as that of mo-services-java does, is told so.
        """
        try:
            if self._connection.is_open:
                over = [
                    self._single(service, operation, InteractionStage.DEREGISTER, (ids,))
                    for (service, operation), ids in self._subscriptions.ids().items()
                ]
                with suppress(TimeoutError):
                    async with asyncio.timeout(_GOODBYE_S):
                        await asyncio.gather(*over, return_exceptions=True)
        finally:
            await self._connection.close()

    def _send(
        self,
        service: str,
        name: str,
        stage: InteractionStage,
        parts: Parts,
        supplements: Supplements = (),
        number: int | None = None,
    ) -> tuple[Operation, int]:
        """Send what begins a transaction; return the operation and the transaction id."""
        operation = self._specification.operation(service, name)
        if stage not in operation.parts:
            raise ValueError(f"{service}.{name} is a {operation.pattern.name}, not a {stage.name}")
        body = self._codec.encode(operation.parts[stage], parts)
        if not self._connection.is_open:
            raise MalError(StandardError.DESTINATION_LOST)
        if number is None:
            number = next(self._numbers)
        header = Header.of(
            operation,
            stage,
            number,
            from_uri=self._own_uri,
            to_uri=self._broker_uri if operation.pattern is Pattern.PUBSUB else self._provider_uri,
            timestamp_ns=utc_ns(self._system),
            supplements=supplements,
        )
        self._connection.send(encode_message(header, body))
        return operation, number

    def _begin(
        self,
        service: str,
        name: str,
        stage: InteractionStage,
        parts: Parts,
        supplements: Supplements = (),
        number: int | None = None,
    ) -> Transaction:
        operation, number = self._send(service, name, stage, parts, supplements, number)
        forget = partial(self._pending.pop, number, None)
        transaction = Transaction(operation, REPLY[stage], self._connection, forget)
        self._pending[number] = transaction
        return transaction

    async def _single(
        self,
        service: str,
        name: str,
        stage: InteractionStage,
        parts: Parts,
        supplements: Supplements = (),
        number: int | None = None,
    ) -> Parts:
        """Do what has one reply, and return its parts."""
        transaction = self._begin(service, name, stage, parts, supplements, number)
        try:
            _, reply = await transaction.next(self._timeout_s, StandardError.DELIVERY_TIMEDOUT)
            return reply
        finally:
            transaction.end()

    def _lose(self, _lost: asyncio.Future[None]) -> None:
        for transaction in list(self._pending.values()):
            transaction.fail(MalError(StandardError.DESTINATION_LOST))

    def _receive(self, connection: Connection, header: Header, body: bytes) -> None:
        if header.stage is InteractionStage.NOTIFY:
            self._subscriptions.notified(header, body)
            return
        transaction = self._pending.get(header.transaction_id)
        if transaction is None or not transaction.expects(header.stage):
            _LOG.info("%s from %s without a transaction", header.stage.name, connection.peer)
            return
        try:
            if header.is_error:
                transaction.fail(self._codec.decode_error(body))
            else:
                parts = self._codec.decode(transaction.operation.parts[header.stage], body)
                transaction.take(header.stage, parts, len(body))
        except DecodeError as fault:
            transaction.fail(MalError(StandardError.BAD_ENCODING, f"reply: {fault}"))
