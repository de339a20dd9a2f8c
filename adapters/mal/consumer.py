"""The consumer's side: sends messages and waits for what comes back."""

import asyncio
import logging
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any, Final, TypeVar

from adapters.mal.codec import Codec
from adapters.mal.connection import Connection
from adapters.mal.encoding import Encoding
from adapters.mal.errors import DecodeError, MalError, StandardError
from adapters.mal.header import Header, encode_message
from adapters.mal.invocation import Invocation, Progress
from adapters.mal.mal_area import NamedValue, Subscription
from adapters.mal.pending import Pending, SingleReply
from adapters.mal.specification import Operation, Specification, Stage
from adapters.mal.stages import REPLY
from adapters.mal.subscriptions import OnUpdate, Subscriptions
from adapters.mal.transactions import transaction_ids
from adapters.mal.uri import MalUri
from adapters.mal.values import AttributeType, Typed

__all__ = ["Consumer", "OnUpdate"]

_LOG: Final = logging.getLogger(__name__)

_Kind = TypeVar("_Kind", bound=Invocation)


class Consumer:
    """A client of one provider over one connection, which is not opened again once it is lost."""

    def __init__(
        self,
        specification: Specification,
        uri: MalUri,
        name: str,
        encoding: Encoding,
        timeout_s: float,
    ) -> None:
        """Not to be called; see `connect`."""
        self._specification = specification
        self._provider = uri
        self._name = name
        self._own_uri = ""
        self._timeout_s = timeout_s
        self._codec = Codec(specification, encoding)
        self._connection = Connection(self._receive)
        self._connection.lost.add_done_callback(self._lose)
        self._transactions = transaction_ids()
        self._pending: dict[int, Pending] = {}
        self._subscriptions = Subscriptions(specification, self._codec)

    @classmethod
    async def connect(
        cls,
        specification: Specification,
        uri: str | MalUri,
        name: str = "consumer",
        encoding: Encoding = Encoding.FIXED,
        timeout_s: float = 5.0,
    ) -> "Consumer":
        """Connect to a provider.

        Args:
            specification: What the provider may serve.
            uri: The provider's URI.
            name: The last part of the consumer's own URI.
            encoding: The body encoding agreed with the provider.
            timeout_s: How long to wait for the connection, and later for each reply.

        Raises:
            MalError: DESTINATION_TRANSIENT, nobody answers there.
            ValueError: The URI is none.
        """
        target = uri if isinstance(uri, MalUri) else MalUri.parse(uri)
        consumer = cls(specification, target, name, encoding, timeout_s)
        loop = asyncio.get_running_loop()
        try:
            async with asyncio.timeout(timeout_s):
                await loop.create_connection(lambda: consumer._connection, target.host, target.port)
        except OSError as fault:
            text = f"{target}: {str(fault) or 'no answer'}"
            raise MalError(
                StandardError.DESTINATION_TRANSIENT, Typed(AttributeType.STRING, text)
            ) from fault
        consumer._own_uri = str(MalUri(*consumer._connection.local_address, name))
        return consumer

    async def send(
        self, service: str, operation: str, *parts: Any, supplements: tuple[NamedValue, ...] = ()
    ) -> None:
        """Do a SEND, and return when the connection takes more; nobody says whether it arrived.

        Raises:
            EncodeError: A part does not fit the specification.
            KeyError: There is no such operation.
            MalError: DESTINATION_LOST.
        """
        _, _, message = self._message(service, operation, Stage.SEND, parts, supplements)
        self._connection.send(message)
        await self._connection.drained()

    async def submit(
        self, service: str, operation: str, *parts: Any, supplements: tuple[NamedValue, ...] = ()
    ) -> None:
        """Do a SUBMIT, and return when it is acknowledged.

        Raises:
            EncodeError: A part does not fit the specification.
            KeyError: There is no such operation.
            MalError: The provider's answer, DELIVERY_TIMEDOUT, or DESTINATION_LOST.
        """
        await self._interact(service, operation, Stage.SUBMIT, parts, supplements)

    async def request(
        self, service: str, operation: str, *parts: Any, supplements: tuple[NamedValue, ...] = ()
    ) -> tuple[Any, ...]:
        """Do a REQUEST, and return the parts of the response; raises as `submit` does."""
        return await self._interact(service, operation, Stage.REQUEST, parts, supplements)

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
        invocation = self._begin(
            Invocation, service, operation, Stage.INVOKE, parts, supplements, timeout_s
        )
        await invocation.begin(self._timeout_s)
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
        progress = self._begin(
            Progress, service, operation, Stage.PROGRESS, parts, supplements, timeout_s
        )
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
            await self._interact(service, operation, Stage.REGISTER, (subscription,), ())

    async def unsubscribe(self, service: str, operation: str, subscription_id: str) -> None:
        """Deregister a subscription; raises as `submit` does."""
        await self._interact(service, operation, Stage.DEREGISTER, ((subscription_id,),), ())
        self._subscriptions.remove(service, operation, subscription_id)

    async def lost(self) -> None:
        """Return when the connection is gone, by whichever end."""
        await asyncio.shield(self._connection.lost)

    async def close(self) -> None:
        """Close the connection."""
        await self._connection.close()

    def _message(
        self,
        service: str,
        name: str,
        stage: Stage,
        parts: tuple[Any, ...],
        supplements: tuple[NamedValue, ...],
    ) -> tuple[Operation, int, bytes]:
        """The operation, a new transaction id, and the message that begins the transaction."""
        operation = self._specification.operation(service, name)
        if stage not in operation.parts:
            raise ValueError(f"{service}.{name} is a {operation.pattern.name}, not a {stage.name}")
        body = self._codec.encode(operation.parts[stage], parts)
        if not self._connection.is_open:
            raise MalError(StandardError.DESTINATION_LOST)
        to_broker = stage in (Stage.REGISTER, Stage.DEREGISTER)
        number = next(self._transactions)
        header = Header.of(
            operation,
            stage,
            number,
            from_uri=self._own_uri,
            to_uri=str(self._provider.broker if to_broker else self._provider),
            timestamp_ns=time.time_ns(),
            supplements=supplements,
        )
        return operation, number, encode_message(header, body)

    async def _interact(
        self,
        service: str,
        name: str,
        stage: Stage,
        parts: tuple[Any, ...],
        supplements: tuple[NamedValue, ...],
    ) -> tuple[Any, ...]:
        operation, number, message = self._message(service, name, stage, parts, supplements)
        reply: asyncio.Future[tuple[Any, ...]] = asyncio.get_running_loop().create_future()
        self._pending[number] = SingleReply(operation, REPLY[stage], reply)
        try:
            self._connection.send(message)
            async with asyncio.timeout(self._timeout_s):
                return await reply
        except TimeoutError:
            raise MalError(StandardError.DELIVERY_TIMEDOUT) from None
        finally:
            del self._pending[number]

    def _begin(
        self,
        kind: type[_Kind],
        service: str,
        name: str,
        stage: Stage,
        parts: tuple[Any, ...],
        supplements: tuple[NamedValue, ...],
        timeout_s: float | None,
    ) -> _Kind:
        operation, number, message = self._message(service, name, stage, parts, supplements)

        def forget() -> None:
            self._pending.pop(number, None)

        silence_s = self._timeout_s if timeout_s is None else timeout_s
        pending = self._pending[number] = kind(operation, self._connection, silence_s, forget)
        self._connection.send(message)
        return pending

    def _lose(self, _lost: asyncio.Future[None]) -> None:
        for pending in list(self._pending.values()):
            pending.fail(MalError(StandardError.DESTINATION_LOST))

    def _receive(self, connection: Connection, header: Header, body: bytes) -> None:
        if header.stage is Stage.NOTIFY:
            self._subscriptions.notified(header, body)
            return
        pending = self._pending.get(header.transaction_id)
        if pending is None or not pending.expects(header.stage):
            _LOG.info("%s from %s that nobody waits for", header.stage.name, connection.peer)
            return
        try:
            if header.is_error:
                pending.fail(self._codec.decode_error(body))
            else:
                parts = self._codec.decode(pending.operation.parts[header.stage], body)
                pending.take(header.stage, parts, len(body))
        except DecodeError as fault:
            text = Typed(AttributeType.STRING, f"reply: {fault}")
            pending.fail(MalError(StandardError.BAD_ENCODING, text))
