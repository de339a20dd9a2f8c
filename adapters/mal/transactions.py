"""The transactions of a consumer: what it waits for, and who gets each message that comes."""

import asyncio
import itertools
import logging
import secrets
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, Protocol, TypeVar

from adapters.mal.codec import Codec
from adapters.mal.connection import Connection, MalUri
from adapters.mal.errors import DecodeError, MalError, StandardError
from adapters.mal.mal_area import NamedValue, Subscription
from adapters.mal.message import Header, encode_message
from adapters.mal.specification import REPLY, Operation, Pattern, Specification, Stage
from adapters.mal.values import AttributeType, Typed

_EPOCH_MS: Final = 1_283_299_200_000
"""2010-09-01, where the count of ESA's transaction ids begins, in ms since 1970 UTC."""


def transaction_ids() -> Iterator[int]:
    """Signed 64-bit numbers unlike any other consumer's: 40 bits ms, 8 random, 16 counter."""
    salt = secrets.randbits(8)
    for counter in itertools.count(1):
        milliseconds = time.time_ns() // 1_000_000 - _EPOCH_MS
        number = (milliseconds & 0xFFFFFFFFFF) << 24 | salt << 16 | counter & 0xFFFF
        yield number - (1 << 64) if number >> 63 else number


Parts = tuple[Any, ...]


class Pending(Protocol):
    """What is told of the messages of a transaction."""

    @property
    def operation(self) -> Operation:
        """The operation of the transaction."""

    def expects(self, stage: Stage) -> bool:
        """Whether this message, or an error in its place, may come now."""

    def take(self, stage: Stage, parts: Parts, octets: int) -> None:
        """A message came, with a body of so many octets."""

    def fail(self, error: MalError) -> None:
        """An error came, or nothing will come any more."""


@dataclass(frozen=True, slots=True)
class SingleReply:
    """Waits for the one reply of a SUBMIT, a REQUEST, or a registration."""

    operation: Operation
    stage: Stage
    reply: asyncio.Future[Parts]

    def expects(self, stage: Stage) -> bool:
        """Whether it is the reply, and the first."""
        return stage is self.stage and not self.reply.done()

    def take(self, _stage: Stage, parts: Parts, _octets: int) -> None:
        """Complete the reply."""
        self.reply.set_result(parts)

    def fail(self, error: MalError) -> None:
        """Fail the reply."""
        if not self.reply.done():
            self.reply.set_exception(error)


HELD_CAP: Final = 4 << 20
"""Octets of updates that wait to be taken, beyond which nothing more is read."""
_OVERHEAD: Final = 512
"""What a waiting update counts beside its body, in octets."""
_ACKNOWLEDGEMENTS: Final = (Stage.INVOKE_ACK, Stage.PROGRESS_ACK)
_AFTERWARDS: Final = (Stage.INVOKE_RESPONSE, Stage.PROGRESS_UPDATE, Stage.PROGRESS_RESPONSE)

_Arrived = tuple[Stage, Parts, int] | MalError
"""A message's stage, parts and weight in octets, or what ends it all."""


class Invocation:
    """An INVOKE that is acknowledged.

    Attributes:
        operation: The operation invoked.
        acknowledgement: The parts of the acknowledgement.
    """

    def __init__(
        self,
        operation: Operation,
        connection: Connection,
        timeout_s: float,
        forget: Callable[[], None],
    ) -> None:
        """Not to be called; see `Consumer.invoke` and `Consumer.progress`."""
        self.operation = operation
        self.acknowledgement: Parts = ()
        self._connection = connection
        self._timeout_s = timeout_s
        self._forget = forget
        self._expected: tuple[Stage, ...] = _ACKNOWLEDGEMENTS
        self._arrived: asyncio.Queue[_Arrived] = asyncio.Queue()
        self._octets = 0
        self._response: Parts | None = None
        self._error: MalError | None = None

    async def response(self) -> Parts:
        """Wait for the response and return its parts; updates that come before it are let go.

        Raises:
            MalError: The provider's error, TRANSACTION_TIMEOUT, or DESTINATION_LOST.
        """
        while self._response is None:
            await self._step()
        return self._response

    async def begin(self, timeout_s: float) -> None:
        """Wait for the acknowledgement; to be called once."""
        try:
            _, self.acknowledgement = await self._next(timeout_s, StandardError.DELIVERY_TIMEDOUT)
        except BaseException:
            self.end()
            raise

    def end(self) -> None:
        """Let go of whatever else will come."""
        self._expected = ()
        self._forget()
        self._connection.let_go(self)

    def expects(self, stage: Stage) -> bool:
        """Whether this message may come now: acknowledgement first, then the others."""
        return stage in self._expected

    def take(self, stage: Stage, parts: Parts, octets: int) -> None:
        """Keep a message until it is asked for."""
        self._expected = _AFTERWARDS
        if stage in (Stage.INVOKE_RESPONSE, Stage.PROGRESS_RESPONSE):
            self._expected = ()
            self._forget()
        self._octets += octets + _OVERHEAD
        if self._octets > HELD_CAP:
            self._connection.hold(self)
        self._arrived.put_nowait((stage, parts, octets + _OVERHEAD))

    def fail(self, error: MalError) -> None:
        """Keep an error until what came before it has been asked for."""
        self._expected = ()
        self._forget()
        self._arrived.put_nowait(error)

    async def _step(self) -> Parts | None:
        """The parts of the next update, or None when the response is there."""
        if self._response is not None:
            return None
        stage, parts = await self._next(self._timeout_s, StandardError.TRANSACTION_TIMEOUT)
        if stage is Stage.PROGRESS_UPDATE:
            return parts
        self._response = parts
        return None

    async def _next(self, timeout_s: float, too_late: StandardError) -> tuple[Stage, Parts]:
        if self._error is not None:
            raise self._error
        if self._arrived.empty():
            arrived = await self._wait(timeout_s, too_late)
        else:
            arrived = self._arrived.get_nowait()
        if isinstance(arrived, MalError):
            self._error = arrived
            raise arrived
        stage, parts, octets = arrived
        self._octets -= octets
        if self._octets <= HELD_CAP // 2:
            self._connection.let_go(self)
        return stage, parts

    async def _wait(self, timeout_s: float, too_late: StandardError) -> _Arrived:
        timer = asyncio.get_running_loop().call_later(timeout_s, self._give_up, too_late)
        try:
            return await self._arrived.get()
        finally:
            timer.cancel()

    def _give_up(self, too_late: StandardError) -> None:
        self.end()
        self._arrived.put_nowait(MalError(too_late))


class Progress(Invocation):
    """A PROGRESS that is acknowledged; iterating gives the parts of each update until the response.

    An error, of an update or of the response, is raised by the iteration and by `response` alike.
    While more updates wait than `HELD_CAP` allows, nothing is read from the connection: whoever
    does not take them gets no other reply either.
    """

    def __aiter__(self) -> "Progress":
        """Itself."""
        return self

    async def __anext__(self) -> Parts:
        """Wait for the next update; raises as `response` does."""
        parts = await self._step()
        if parts is None:
            raise StopAsyncIteration
        return parts


_LOG: Final = logging.getLogger(__name__)

OnUpdate = Callable[..., None]
"""Called as `on_update(update_header, *parts)` on the loop."""


class Subscriptions:
    """The subscriptions of one consumer, by the names of service and operation and their own id."""

    def __init__(self, specification: Specification, codec: Codec) -> None:
        self._specification = specification
        self._codec = codec
        self._on_update: dict[tuple[str, str, str], OnUpdate] = {}

    @contextmanager
    def added(
        self, service: str, operation: str, subscription: Subscription, on_update: OnUpdate
    ) -> Iterator[None]:
        """Add a subscription that is about to be registered; if that fails, all is as before."""
        key = (service, operation, subscription.subscriptionId)
        before = self._on_update.get(key)
        self._on_update[key] = on_update
        try:
            yield
        except BaseException:
            self._on_update.pop(key)
            if before is not None:
                self._on_update[key] = before
            raise

    def remove(self, service: str, operation: str, subscription_id: str) -> None:
        """Forget a subscription."""
        self._on_update.pop((service, operation, subscription_id), None)

    def notified(self, header: Header, body: bytes) -> None:
        """Hand an update to whom it is for; one that cannot be read is logged and dropped."""
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
        on_update = self._on_update.get(key)
        if on_update is None:
            return
        try:
            on_update(update, *parts)
        except Exception:
            _LOG.exception("update of %s.%s, subscription %s", *key)


_Kind = TypeVar("_Kind", bound=Invocation)
Supplements = tuple[NamedValue, ...]


class Transactions:
    """Sends the messages that begin transactions, and takes all that come back.

    Attributes:
        specification: What the provider may serve.
        connection: The way to the provider.
        own_uri: What the consumer calls itself.
        subscriptions: Where notifications go.
        timeout_s: How long to wait for a reply.
    """

    def __init__(
        self,
        specification: Specification,
        codec: Codec,
        provider: MalUri,
        broker: MalUri,
        timeout_s: float,
    ) -> None:
        self.specification = specification
        self._codec = codec
        self._provider = provider
        self._broker = broker
        self.timeout_s = timeout_s
        self.own_uri = ""
        self.connection = Connection(self._receive)
        self.connection.lost.add_done_callback(self._lose)
        self.subscriptions = Subscriptions(specification, codec)
        self._transactions = transaction_ids()
        self._pending: dict[int, Pending] = {}

    def message(
        self,
        service: str,
        name: str,
        stage: Stage,
        parts: Parts,
        supplements: Supplements = (),
        number: int | None = None,
    ) -> tuple[Operation, int, bytes]:
        """The operation, a new transaction id, and the message that begins the transaction.

        Raises:
            EncodeError: A part does not fit the specification.
            KeyError: There is no such operation.
            MalError: DESTINATION_LOST.
            ValueError: The operation is of another pattern.
        """
        operation = self.specification.operation(service, name)
        if stage not in operation.parts:
            raise ValueError(f"{service}.{name} is a {operation.pattern.name}, not a {stage.name}")
        body = self._codec.encode(operation.parts[stage], parts)
        if not self.connection.is_open:
            raise MalError(StandardError.DESTINATION_LOST)
        if number is None:
            number = next(self._transactions)
        header = Header.of(
            operation,
            stage,
            number,
            from_uri=self.own_uri,
            to_uri=str(self._provider if operation.pattern is not Pattern.PUBSUB else self._broker),
            timestamp_ns=time.time_ns(),
            supplements=supplements,
        )
        return operation, number, encode_message(header, body)

    async def single(
        self,
        service: str,
        name: str,
        stage: Stage,
        parts: Parts,
        supplements: Supplements = (),
        number: int | None = None,
    ) -> Parts:
        """Do what has one reply, and return its parts; raises as `message` does.

        Raises:
            MalError: The provider's answer, or DELIVERY_TIMEDOUT.
        """
        operation, number, message = self.message(service, name, stage, parts, supplements, number)
        loop = asyncio.get_running_loop()
        reply: asyncio.Future[Parts] = loop.create_future()
        self._pending[number] = SingleReply(operation, REPLY[stage], reply)
        late = MalError(StandardError.DELIVERY_TIMEDOUT)
        timer = loop.call_later(self.timeout_s, self._pending[number].fail, late)
        try:
            self.connection.send(message)
            return await reply
        finally:
            timer.cancel()
            del self._pending[number]

    def new_number(self) -> int:
        """The number of a transaction that is to last."""
        return next(self._transactions)

    def keep(self, number: int, pending: Pending) -> None:
        """Tell of whatever else comes in a transaction."""
        self._pending[number] = pending

    def forget(self, number: int) -> None:
        """Let go of a transaction."""
        self._pending.pop(number, None)

    def begin(
        self,
        kind: type[_Kind],
        service: str,
        name: str,
        stage: Stage,
        parts: Parts,
        supplements: Supplements,
        timeout_s: float | None,
    ) -> _Kind:
        """Begin an INVOKE or PROGRESS; raises as `message` does."""
        operation, number, message = self.message(service, name, stage, parts, supplements)
        silence_s = self.timeout_s if timeout_s is None else timeout_s
        pending = kind(operation, self.connection, silence_s, partial(self.forget, number))
        self._pending[number] = pending
        self.connection.send(message)
        return pending

    def _lose(self, _lost: asyncio.Future[None]) -> None:
        for pending in list(self._pending.values()):
            pending.fail(MalError(StandardError.DESTINATION_LOST))

    def _receive(self, connection: Connection, header: Header, body: bytes) -> None:
        if header.stage is Stage.NOTIFY:
            self.subscriptions.notified(header, body)
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
