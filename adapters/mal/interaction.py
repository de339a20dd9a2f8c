"""What a handler gets and gives: calls, replies, and the INVOKE and PROGRESS under way."""

import asyncio
import logging
import time
from collections import Counter
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any, Final

from adapters.mal.codec import Codec
from adapters.mal.connection import Connection
from adapters.mal.errors import EncodeError, MalError, StandardError
from adapters.mal.mal_area import NamedValue
from adapters.mal.message import Header, encode_message
from adapters.mal.specification import REPLY, Operation, Pattern, Stage

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


class ReplySender:
    """Encodes and sends what answers a message, in any of the stages that follow it."""

    def __init__(self, codec: Codec) -> None:
        self._codec = codec

    def send(
        self,
        connection: Connection,
        header: Header,
        operation: Operation,
        stage: Stage,
        parts: tuple[Any, ...] | None,
    ) -> None:
        """Send a reply.

        Raises:
            EncodeError: The parts are not those of the stage.
        """
        body = self._codec.encode(operation.parts[stage], parts or ())
        connection.send(encode_message(_turned(header, stage, is_error=False), body))

    def refuse(
        self, connection: Connection, header: Header, error: MalError, stage: Stage | None = None
    ) -> None:
        """Send an error in place of the reply of a stage, the first if none is given."""
        if header.stage is Stage.SEND:
            _LOG.info("SEND from %s dropped: %s", header.from_uri, error)
            return
        try:
            body = self._codec.encode_error(error)
        except EncodeError:
            _LOG.exception("error %d with extra information that does not fit", error.number)
            body = self._codec.encode_error(MalError(error.number))
        turned = _turned(header, stage or REPLY[header.stage], is_error=True)
        connection.send(encode_message(turned, body))

    def fault(self, connection: Connection, header: Header, stage: Stage | None = None) -> None:
        """Log the exception being handled, and answer INTERNAL."""
        _LOG.exception("no answer to operation %d of service %d", header.operation, header.service)
        self.refuse(connection, header, MalError(StandardError.INTERNAL), stage)


def _turned(header: Header, stage: Stage, is_error: bool) -> Header:
    """The header of a reply to a message."""
    return Header(
        stage,
        header.area,
        header.service,
        header.operation,
        header.area_version,
        header.transaction_id,
        is_error,
        from_uri=header.to_uri,
        to_uri=header.from_uri,
        timestamp_ns=time.time_ns(),
    )


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

    def __init__(
        self, call: Call, header: Header, operation: Operation, replies: ReplySender
    ) -> None:
        self.call = call
        self._header = header
        self._operation = operation
        self._replies = replies
        self._acknowledged = False

    def acknowledge(self, *parts: Any) -> None:
        """Send the acknowledgement.

        Raises:
            EncodeError: The parts are not those of the acknowledgement.
            RuntimeError: It is sent already.
        """
        if self._acknowledged:
            raise RuntimeError("acknowledged already")
        self._send(self._stages[0], parts)
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
        await self.call.connection.drained(patience_s)
        self._send(Stage.PROGRESS_UPDATE, parts)

    async def run(self, handler: Handler, parts: tuple[Any, ...]) -> None:
        """Let a handler serve it, and send what ends it."""
        acknowledgement, response = self._stages
        try:
            answer = handler(self, *parts)
            if not asyncio.iscoroutine(answer):
                raise TypeError(f"{handler!r} is not async")
            result = await answer
            if not self._acknowledged:
                raise RuntimeError("no acknowledgement before the response")
            self._send(response, result or ())
        except asyncio.CancelledError:
            self._refuse(MalError(StandardError.SHUTDOWN))
        except MalError as error:
            self._refuse(error)
        except Exception:
            stage = response if self._acknowledged else acknowledgement
            self._replies.fault(self.call.connection, self._header, stage)

    @property
    def _stages(self) -> tuple[Stage, Stage]:
        if self._operation.pattern is Pattern.PROGRESS:
            return Stage.PROGRESS_ACK, Stage.PROGRESS_RESPONSE
        return Stage.INVOKE_ACK, Stage.INVOKE_RESPONSE

    def _send(self, stage: Stage, parts: tuple[Any, ...]) -> None:
        self._replies.send(self.call.connection, self._header, self._operation, stage, parts)

    def _refuse(self, error: MalError) -> None:
        acknowledgement, stage = self._stages
        if not self._acknowledged:
            stage = acknowledgement
        elif isinstance(error, UpdateError) and self._operation.pattern is Pattern.PROGRESS:
            stage = Stage.PROGRESS_UPDATE
        self._replies.refuse(self.call.connection, self._header, error, stage)


INTERACTION_CAP: Final = 256
"""Interactions under way over one connection, at most."""


class RunningInteractions:
    """Runs a handler for each, until it ends or the consumer's connection does."""

    def __init__(self) -> None:
        self._tasks: set[asyncio.Task[None]] = set()
        self._running: Counter[Connection] = Counter()

    def begin(self, interaction: Interaction, handler: Handler, parts: Parts) -> None:
        """Let a handler serve an interaction.

        Raises:
            MalError: TOO_MANY over its connection.
        """
        connection = interaction.call.connection
        if self._running[connection] == INTERACTION_CAP:
            raise MalError(StandardError.TOO_MANY)
        self._running[connection] += 1
        task = asyncio.ensure_future(interaction.run(handler, parts))

        def cancel(_lost: asyncio.Future[None]) -> None:
            task.cancel()

        def end(_ended: asyncio.Future[None]) -> None:
            connection.lost.remove_done_callback(cancel)
            self._tasks.discard(task)
            self._running[connection] -= 1
            if not self._running[connection]:
                del self._running[connection]

        connection.lost.add_done_callback(cancel)
        task.add_done_callback(end)
        self._tasks.add(task)

    async def close(self) -> None:
        """Cancel all, each of which is answered for."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
