"""What a handler gets and gives: calls, replies, and the INVOKE and PROGRESS under way."""

import asyncio
import logging
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any, Final

from adapters.mal.codec import Codec
from adapters.mal.connection import Connection
from adapters.mal.errors import EncodeError, MalError, StandardError
from adapters.mal.message import Header, encode_message
from adapters.mal.specification import REPLY, Operation, Pattern, Stage
from adapters.mal.values import NamedValue

Parts = tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class Call:
    """What a handler is told beside the parts of the message.

    Attributes:
        service: Name of the service.
        operation: Name of the operation.
        from_uri: Who calls.
        transaction_id: The interaction, as the caller numbered it.
        supplements: Named attributes that came with the header.
        connection: The connection it came on.
    """

    service: str
    operation: str
    from_uri: str | None
    transaction_id: int
    supplements: tuple[NamedValue, ...]
    connection: Connection


Handler = Callable[..., Awaitable[Parts | None] | Parts | None]
"""Called as `handler(call, *parts)`, or `handler(interaction, *parts)` for INVOKE and PROGRESS;
returns None, a tuple of parts, or an awaitable of either."""


_LOG: Final = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class ReplyPath:
    """The way back to who sent a message: replies and errors, in any stage that follows it."""

    connection: Connection
    header: Header
    codec: Codec

    def send(self, operation: Operation, stage: Stage, parts: Parts | None) -> None:
        """Send a reply.

        Raises:
            EncodeError: The parts are not those of the stage.
        """
        body = self.codec.encode(operation.parts[stage], parts or ())
        self.connection.send(encode_message(self.header.reply(stage), body))

    def refuse(self, error: MalError, stage: Stage | None = None) -> None:
        """Send an error in place of the reply of a stage, the first if none is given."""
        if self.header.stage is Stage.SEND:
            _LOG.info("SEND from %s dropped: %s", self.header.from_uri, error)
            return
        try:
            body = self.codec.encode_error(error)
        except EncodeError:
            _LOG.exception("error %d with extra information that does not fit", error.number)
            body = self.codec.encode_error(MalError(error.number))
        header = self.header.reply(stage or REPLY[self.header.stage], is_error=True)
        self.connection.send(encode_message(header, body))

    def fault(self, stage: Stage | None = None) -> None:
        """Log the exception being handled, and answer INTERNAL."""
        header = self.header
        _LOG.exception("no answer to operation %d of service %d", header.operation, header.service)
        self.refuse(MalError(StandardError.INTERNAL), stage)


class UpdateError(MalError):
    """Ends a PROGRESS with an error of the UPDATE; any other is the error of ACK or RESPONSE."""


class Interaction:
    """One INVOKE or PROGRESS, as its handler sees it.

    The handler is `async def`, calls `acknowledge` once, `update` as often as it likes (PROGRESS
    only), and returns the parts of the response. It raises MalError to end the interaction with an
    error in place of the message that would come next. It is cancelled when the consumer's
    connection is lost and when the provider closes.

    Attributes:
        call: Who calls, and what.
    """

    def __init__(self, call: Call, operation: Operation, back: ReplyPath) -> None:
        self.call = call
        self._operation = operation
        self._back = back
        self._acknowledged = False
        self._stages = (Stage.INVOKE_ACK, Stage.INVOKE_RESPONSE)
        if operation.pattern is Pattern.PROGRESS:
            self._stages = (Stage.PROGRESS_ACK, Stage.PROGRESS_RESPONSE)

    def acknowledge(self, *parts: Any) -> None:
        """Send the acknowledgement.

        Raises:
            EncodeError: The parts are not those of the acknowledgement.
            RuntimeError: It is sent already.
        """
        if self._acknowledged:
            raise RuntimeError("acknowledged already")
        self._back.send(self._operation, self._stages[0], parts)
        self._acknowledged = True

    async def update(self, *parts: Any, patience_s: float | None = None) -> None:
        """Send an update, once the consumer has taken most of what was sent before.

        Everybody else on the loop has a turn first, however fast the consumer is.

        Args:
            parts: The parts of the update.
            patience_s: How long to wait for the consumer; None for ever.

        Raises:
            TimeoutError: The consumer did not take it in time.
            EncodeError: The parts are not those of an update.
            RuntimeError: It is not acknowledged yet, or no PROGRESS.
        """
        if not self._acknowledged or self._operation.pattern is not Pattern.PROGRESS:
            raise RuntimeError("updates are for a PROGRESS that is acknowledged")
        await self.call.connection.drain(patience_s)
        self._back.send(self._operation, Stage.PROGRESS_UPDATE, parts)

    async def run(self, handler: Handler, parts: tuple[Any, ...]) -> None:
        """Let a handler serve it, and send what ends it."""
        try:
            answer = handler(self, *parts)
            if not asyncio.iscoroutine(answer):
                raise TypeError(f"{handler!r} is not async")
            result = await answer
            if not self._acknowledged:
                raise RuntimeError("no acknowledgement before the response")
            self._back.send(self._operation, self._stages[1], result)
        except asyncio.CancelledError:
            self._refuse(MalError(StandardError.SHUTDOWN))
        except MalError as error:
            self._refuse(error)
        except Exception:
            self._back.fault(self._stages[self._acknowledged])

    def _refuse(self, error: MalError) -> None:
        stage = self._stages[self._acknowledged]
        if stage is Stage.PROGRESS_RESPONSE and isinstance(error, UpdateError):
            stage = Stage.PROGRESS_UPDATE
        self._back.refuse(error, stage)
