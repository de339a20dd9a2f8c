"""`Consumer`, a client: sends messages and waits for the replies; publishes at a broker."""

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
"""Timeout of deregistration before the connection is closed; chosen, not measured."""
Supplements = tuple[NamedValue, ...]


class _Refusals(Transaction):
    """Answers of a broker to publications: none, or errors; the last error is stored."""

    newest: MalError | None = None

    def on_message(self, _stage: InteractionStage, _parts: Parts, _octets: int) -> None:
        """Ignore a PUBLISH: a publisher receives none."""

    def fail(self, error: MalError) -> None:
        """Store an error for the next publication."""
        self.newest = error


class Publication:
    """A publisher of one operation, registered with a broker.

    The broker answers a publication only if it rejects it; the next call then raises the error.
    """

    def __init__(self, consumer: "Consumer", operation: Operation) -> None:
        """Use `Consumer.publication` instead."""
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
        """Publish an update, and return when the connection accepts more.

        Args:
            parts: The parts of the update, without the update header.
            keys: A plain value or None for each subscription key of the operation, in order.
            domain: The domain of the update, outermost part first.
            source: The publisher.

        Raises:
            EncodeError: A value does not match the specification.
            MalError: The broker rejected an earlier update; this one is not sent.
                DESTINATION_LOST: the connection is closed.
            ValueError: The number of keys differs from the operation's.
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
        """Register with the broker; call it once."""
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
    """A client of one provider over one connection; it does not reconnect after a loss."""

    def __init__(
        self,
        specification: Specification,
        codec: Codec,
        provider: MalUri,
        broker: MalUri,
        timeout_s: float,
        system: System,
    ) -> None:
        """Use `connect` instead."""
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
            specification: The services of the provider.
            uri: The provider's URI.
            name: The last part of the consumer's own URI.
            encoding: The body encoding, the same as the provider's.
            timeout_s: Timeout of the connection attempt, and later of each reply.
            is_broker: Whether the URI is that of a separate broker, not of a provider with its own.
            tls: TLS context with the trusted authorities; see `Certificates.for_consumer`.
            system: Clock and random numbers of messages.

        Raises:
            MalError: DESTINATION_TRANSIENT, no answer; AUTHENTICATION_FAILED, the TLS handshake
                failed. A provider that does not trust this certificate closes the connection
                after that: the first interaction is DESTINATION_LOST.
            ValueError: The URI is not valid.
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
        """Send a SEND, and return when the connection accepts more; a SEND has no reply.

        Raises:
            EncodeError: A part does not match the specification.
            KeyError: The operation does not exist.
            MalError: DESTINATION_LOST.
        """
        self._send(service, operation, InteractionStage.SEND, parts, supplements)
        await self._connection.drain()

    async def submit(
        self, service: str, operation: str, *parts: Any, supplements: Supplements = ()
    ) -> None:
        """Send a SUBMIT, and return when it is acknowledged.

        Raises:
            EncodeError: A part does not match the specification.
            KeyError: The operation does not exist.
            MalError: The provider's answer, DELIVERY_TIMEDOUT, or DESTINATION_LOST.
        """
        await self._single(service, operation, InteractionStage.SUBMIT, parts, supplements)

    async def request(
        self,
        service: str,
        operation: str,
        *parts: Any,
        supplements: Supplements = (),
        timeout_s: float | None = None,
    ) -> tuple[Any, ...]:
        """Send a REQUEST, and return the parts of the response; raises as `submit` does.

        `timeout_s` is the timeout of the response; None for that of all replies.
        """
        stage = InteractionStage.REQUEST
        transaction = self._begin(service, operation, stage, parts, supplements)
        return await self._reply(transaction, timeout_s)

    async def invoke(
        self,
        service: str,
        operation: str,
        *parts: Any,
        supplements: Supplements = (),
        timeout_s: float | None = None,
    ) -> Invocation:
        """Send an INVOKE, and return when it is acknowledged; raises as `submit` does.

        `timeout_s` is the timeout of the response; None for that of all replies.
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
        """Start a PROGRESS, entered at its acknowledgement; raises as `submit` does.

        `timeout_s` is the timeout of each update and the response; None for that of all replies.
        Messages after the exit are dropped. The MAL has no message to stop the provider; closing
        the connection does.
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

        The provider removes it when the connection is lost.
        """
        with self._subscriptions.adding(service, operation, subscription, on_update):
            await self._single(service, operation, InteractionStage.REGISTER, (subscription,))

    async def unsubscribe(self, service: str, operation: str, subscription_id: str) -> None:
        """Deregister a subscription; raises as `submit` does."""
        await self._single(service, operation, InteractionStage.DEREGISTER, ((subscription_id,),))
        self._subscriptions.remove(service, operation, subscription_id)

    async def publication(self, service: str, operation: str) -> Publication:
        """Register as a publisher of a PUBSUB operation; raises as `submit` does.

        The broker removes it when the connection is lost.
        """
        publication = Publication(self, self._specification.operation(service, operation))
        await publication.register()
        return publication

    @property
    def local_address(self) -> tuple[str, int]:
        """Host and port of this end, while the connection is open."""
        return self._connection.local_address

    async def wait_lost(self) -> None:
        """Wait until the connection is closed, by either end."""
        await asyncio.shield(self._connection.lost)

    async def close(self) -> None:
        """Deregister subscriptions, and close the connection, even if this is cancelled.

        Without deregistration the broker of mo-services-java would connect back to a lost client.
        """
        try:
            if self._connection.is_open:
                farewells = [
                    self._single(service, operation, InteractionStage.DEREGISTER, (ids,))
                    for (service, operation), ids in self._subscriptions.ids().items()
                ]
                with suppress(TimeoutError):
                    async with asyncio.timeout(_GOODBYE_S):
                        await asyncio.gather(*farewells, return_exceptions=True)
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
        """Send the initiating message of a transaction; return operation and transaction id."""
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
        """Run an interaction with one reply, and return its parts."""
        return await self._reply(self._begin(service, name, stage, parts, supplements, number))

    async def _reply(self, transaction: Transaction, timeout_s: float | None = None) -> Parts:
        timeout_s = self._timeout_s if timeout_s is None else timeout_s
        try:
            _, reply = await transaction.next(timeout_s, StandardError.DELIVERY_TIMEDOUT)
            return reply
        finally:
            transaction.end()

    def _lose(self, _lost: asyncio.Future[None]) -> None:
        for transaction in list(self._pending.values()):
            transaction.fail(MalError(StandardError.DESTINATION_LOST, self._connection.refusal))

    def _receive(self, connection: Connection, header: Header, body: bytes) -> None:
        if header.stage is InteractionStage.NOTIFY:
            self._subscriptions.on_update(header, body)
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
                transaction.on_message(header.stage, parts, len(body))
        except DecodeError as fault:
            transaction.fail(MalError(StandardError.BAD_ENCODING, f"reply: {fault}"))
