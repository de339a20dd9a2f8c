"""Messages that a consumer receives: replies of a `Transaction`, updates of its `Subscriptions`."""

import asyncio
import itertools
import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final

from adapters.mal.codec import Codec, Header
from adapters.mal.connection import Connection
from adapters.mal.errors import DecodeError, MalError, StandardError
from adapters.mal.specification import InteractionStage, Operation, Specification
from adapters.mal.values import Subscription
from adapters.system import System, utc_ns

_EPOCH_MS: Final = 1_283_299_200_000
"""Epoch of mo-services-java's transaction ids: 2010-09-01, in ms since 1970 UTC."""


def transaction_ids(system: System) -> Iterator[int]:
    """Yield signed 64-bit numbers, unique among consumers: 40 bits ms, 8 random, 16 counter."""
    (salt,) = system.random_octets(1)
    for counter in itertools.count(1):
        milliseconds = utc_ns(system) // 1_000_000 - _EPOCH_MS
        number = (milliseconds & 0xFFFFFFFFFF) << 24 | salt << 16 | counter & 0xFFFF
        yield number - (1 << 64) if number >> 63 else number


Parts = tuple[Any, ...]


MAX_BUFFERED_OCTETS: Final = 4 << 20
"""Maximum octets of buffered updates; beyond it reading pauses. Chosen, not measured."""
_OVERHEAD: Final = 512
"""Octets that a buffered message counts in addition to its body."""
_FOLLOWERS: Final = {
    InteractionStage.INVOKE_ACK: (InteractionStage.INVOKE_RESPONSE,),
    InteractionStage.PROGRESS_ACK: (
        InteractionStage.PROGRESS_UPDATE,
        InteractionStage.PROGRESS_RESPONSE,
    ),
    InteractionStage.PROGRESS_UPDATE: (
        InteractionStage.PROGRESS_UPDATE,
        InteractionStage.PROGRESS_RESPONSE,
    ),
}
"""Messages that a provider may send after a message; none after all others."""

_Arrived = tuple[InteractionStage, Parts, int] | MalError
"""Stage, parts and octets of a message, or the final error."""


class Transaction:
    """The replies to a message, buffered in order."""

    def __init__(
        self,
        operation: Operation,
        first: InteractionStage,
        connection: Connection,
        forget: Callable[[], object],
    ) -> None:
        self.operation = operation
        self._expected: tuple[InteractionStage, ...] = (first,)
        self._connection = connection
        self._forget = forget
        self._arrived: asyncio.Queue[_Arrived] = asyncio.Queue()
        self._octets = 0
        self._error: MalError | None = None

    def expects(self, stage: InteractionStage) -> bool:
        """Whether this message, or an error in its place, is expected now."""
        return stage in self._expected

    def on_message(self, stage: InteractionStage, parts: Parts, octets: int) -> None:
        """Buffer a message; `octets` is the size of its body."""
        self._expect(_FOLLOWERS.get(stage, ()))
        self._octets += octets + _OVERHEAD
        if self._octets > MAX_BUFFERED_OCTETS:
            self._connection.pause_reading(self)
        self._arrived.put_nowait((stage, parts, octets + _OVERHEAD))

    def fail(self, error: MalError) -> None:
        """Buffer an error, the last message."""
        self._expect(())
        self._arrived.put_nowait(error)

    def end(self) -> None:
        """Drop all further messages."""
        self._expect(())
        self._connection.resume_reading(self)

    async def next(
        self, timeout_s: float, too_late: StandardError
    ) -> tuple[InteractionStage, Parts]:
        """Wait for the next message.

        Raises:
            MalError: The provider's error, DESTINATION_LOST, or `too_late`.
        """
        if self._error is not None:
            raise self._error
        if self._arrived.empty():
            timer = asyncio.get_running_loop().call_later(timeout_s, self._abort, too_late)
            try:
                arrived = await self._arrived.get()
            finally:
                timer.cancel()
        else:
            arrived = self._arrived.get_nowait()
        if isinstance(arrived, MalError):
            self._error = arrived
            raise arrived
        stage, parts, octets = arrived
        self._octets -= octets
        if self._octets <= MAX_BUFFERED_OCTETS // 2:
            self._connection.resume_reading(self)
        return stage, parts

    def _expect(self, stages: tuple[InteractionStage, ...]) -> None:
        self._expected = stages
        if not stages:
            self._forget()

    def _abort(self, too_late: StandardError) -> None:
        self.end()
        self._arrived.put_nowait(MalError(too_late))


class Invocation:
    """An INVOKE that is acknowledged."""

    def __init__(self, transaction: Transaction, timeout_s: float) -> None:
        """Use `Consumer.invoke` or `Consumer.progress` instead."""
        self.acknowledgement: Parts = ()
        self._transaction = transaction
        self._timeout_s = timeout_s
        self._response: Parts | None = None

    async def response(self) -> Parts:
        """Wait for the response and return its parts; earlier updates are dropped.

        Raises:
            MalError: The provider's error, TRANSACTION_TIMEOUT, or DESTINATION_LOST.
        """
        while self._response is None:
            await self._step()
        return self._response

    async def begin(self, timeout_s: float) -> None:
        """Wait for the acknowledgement; call it once."""
        try:
            _, self.acknowledgement = await self._transaction.next(
                timeout_s, StandardError.DELIVERY_TIMEDOUT
            )
        except BaseException:
            self._transaction.end()
            raise

    def end(self) -> None:
        """Drop all further messages."""
        self._transaction.end()

    async def _step(self) -> Parts | None:
        """Return the parts of the next update, or None after the response."""
        if self._response is not None:
            return None
        stage, parts = await self._transaction.next(
            self._timeout_s, StandardError.TRANSACTION_TIMEOUT
        )
        if stage is InteractionStage.PROGRESS_UPDATE:
            return parts
        self._response = parts
        return None


class ProgressStream(Invocation):
    """An acknowledged PROGRESS; iteration yields the parts of each update until the response.

    Iteration and `response` both raise an error of an update or of the response. While more than
    `MAX_BUFFERED_OCTETS` octets of updates are buffered, the connection is not read: a consumer
    that does not consume them receives no other reply either.
    """

    def __aiter__(self) -> "ProgressStream":
        """Return itself."""
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
    """Subscriptions of one consumer, by names of service and operation and by subscription id."""

    def __init__(self, specification: Specification, codec: Codec) -> None:
        self._specification = specification
        self._codec = codec
        self._on_update: dict[tuple[str, str, str], OnUpdate] = {}

    @contextmanager
    def adding(
        self, service: str, operation: str, subscription: Subscription, on_update: OnUpdate
    ) -> Iterator[None]:
        """Add a subscription during its registration; restored if the registration fails."""
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
        """Remove a subscription."""
        self._on_update.pop((service, operation, subscription_id), None)

    def ids(self) -> dict[tuple[str, str], tuple[str, ...]]:
        """Return the ids of all subscriptions by the names of service and operation."""
        found: dict[tuple[str, str], tuple[str, ...]] = {}
        for service, operation, subscription_id in self._on_update:
            ids = found.get((service, operation), ())
            found[service, operation] = (*ids, subscription_id)
        return found

    def on_update(self, header: Header, body: bytes) -> None:
        """Pass an update to its callback; an invalid one is logged and dropped."""
        try:
            if header.is_error:
                raise self._codec.decode_error(body)
            operation = header.addressed(self._specification)
            subscription_id, update, *parts = self._codec.decode(
                operation.parts[header.stage], body
            )
        except (DecodeError, MalError) as fault:
            _LOG.warning("notification from %s dropped: %s", header.from_uri, fault)
            return
        key = (*operation.names, subscription_id)
        on_update = self._on_update.get(key)
        if on_update is None:
            return
        try:
            on_update(update, *parts)
        except Exception:
            _LOG.exception("update of %s.%s, subscription %s", *key)
