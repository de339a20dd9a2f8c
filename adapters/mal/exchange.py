"""The transactions of a consumer: every message that comes is handed to whoever waits for it."""

import asyncio
import logging
import time
from functools import partial
from typing import Final, TypeVar

from adapters.mal.codec import Codec
from adapters.mal.connection import Connection
from adapters.mal.errors import DecodeError, MalError, StandardError
from adapters.mal.header import Header, encode_message
from adapters.mal.invocation import Invocation
from adapters.mal.mal_area import NamedValue
from adapters.mal.pending import Parts, Pending, SingleReply
from adapters.mal.specification import Operation, Pattern, Specification, Stage
from adapters.mal.stages import REPLY
from adapters.mal.subscriptions import Subscriptions
from adapters.mal.transactions import transaction_ids
from adapters.mal.uri import MalUri
from adapters.mal.values import AttributeType, Typed

_LOG: Final = logging.getLogger(__name__)

_Kind = TypeVar("_Kind", bound=Invocation)
Supplements = tuple[NamedValue, ...]


class Exchange:
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
        """Prepare; the connection is not open yet."""
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
