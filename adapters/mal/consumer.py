"""The consumer's side: sends messages and waits for what comes back."""

import asyncio
import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from adapters.mal.codec import Codec
from adapters.mal.connection import Connection
from adapters.mal.encoding import Encoding
from adapters.mal.errors import DecodeError, MalError, StandardError
from adapters.mal.header import Header, encode_message
from adapters.mal.mal_area import NamedValue, Subscription
from adapters.mal.specification import Operation, Specification, Stage
from adapters.mal.stages import REPLY
from adapters.mal.transactions import transaction_ids
from adapters.mal.uri import MalUri
from adapters.mal.values import AttributeType, Typed

_LOG: Final = logging.getLogger(__name__)

OnUpdate = Callable[..., None]
"""Called as `on_update(update_header, *parts)` on the loop."""


@dataclass(frozen=True, slots=True)
class _Pending:
    operation: Operation
    stage: Stage
    reply: asyncio.Future[tuple[Any, ...]]


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
        self._pending: dict[int, _Pending] = {}
        self._subscriptions: dict[tuple[str, str, str], OnUpdate] = {}

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

    async def subscribe(
        self, service: str, operation: str, subscription: Subscription, on_update: OnUpdate
    ) -> None:
        """Register a subscription; raises as `submit` does.

        The provider forgets it when the connection is lost.
        """
        key = (service, operation, subscription.subscriptionId)
        before = self._subscriptions.get(key)
        self._subscriptions[key] = on_update
        try:
            await self._interact(service, operation, Stage.REGISTER, (subscription,), ())
        except BaseException:
            self._subscriptions.pop(key)
            if before is not None:
                self._subscriptions[key] = before
            raise

    async def unsubscribe(self, service: str, operation: str, subscription_id: str) -> None:
        """Deregister a subscription; raises as `submit` does."""
        await self._interact(service, operation, Stage.DEREGISTER, ((subscription_id,),), ())
        self._subscriptions.pop((service, operation, subscription_id), None)

    async def lost(self) -> None:
        """Return when the connection is gone, by whichever end."""
        await asyncio.shield(self._connection.lost)

    async def close(self) -> None:
        """Close the connection."""
        await self._connection.close()

    async def _interact(
        self,
        service: str,
        name: str,
        stage: Stage,
        parts: tuple[Any, ...],
        supplements: tuple[NamedValue, ...],
    ) -> tuple[Any, ...]:
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
        reply: asyncio.Future[tuple[Any, ...]] = asyncio.get_running_loop().create_future()
        self._pending[number] = _Pending(operation, REPLY[stage], reply)
        try:
            self._connection.send(encode_message(header, body))
            async with asyncio.timeout(self._timeout_s):
                return await reply
        except TimeoutError:
            raise MalError(StandardError.DELIVERY_TIMEDOUT) from None
        finally:
            del self._pending[number]

    def _lose(self, _lost: asyncio.Future[None]) -> None:
        for pending in self._pending.values():
            if not pending.reply.done():
                pending.reply.set_exception(MalError(StandardError.DESTINATION_LOST))

    def _receive(self, connection: Connection, header: Header, body: bytes) -> None:
        if header.stage is Stage.NOTIFY:
            self._notified(header, body)
            return
        pending = self._pending.get(header.transaction_id)
        if pending is None or pending.stage is not header.stage or pending.reply.done():
            _LOG.info("%s from %s that nobody waits for", header.stage.name, connection.peer)
            return
        try:
            if header.is_error:
                pending.reply.set_exception(self._codec.decode_error(body))
            else:
                parts = pending.operation.parts[header.stage]
                pending.reply.set_result(self._codec.decode(parts, body))
        except DecodeError as fault:
            text = Typed(AttributeType.STRING, f"reply: {fault}")
            pending.reply.set_exception(MalError(StandardError.BAD_ENCODING, text))

    def _notified(self, header: Header, body: bytes) -> None:
        try:
            if header.is_error:
                raise self._codec.decode_error(body)
            operation = self._specification.resolve(
                header.area, header.area_version, header.service, header.operation
            )
            if header.stage not in operation.parts:
                raise MalError(StandardError.UNSUPPORTED_OPERATION)
            subscription_id, update, *parts = self._codec.decode(
                operation.parts[header.stage], body
            )
        except (DecodeError, MalError) as fault:
            _LOG.warning("notification from %s dropped: %s", header.from_uri, fault)
            return
        key = (operation.service_name, operation.name, subscription_id)
        on_update = self._subscriptions.get(key)
        if on_update is None:
            return
        try:
            on_update(update, *parts)
        except Exception:
            _LOG.exception("update of %s.%s, subscription %s", *key)
