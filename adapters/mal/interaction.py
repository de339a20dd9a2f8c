"""The provider's side of an INVOKE or PROGRESS: an acknowledgement, updates, a response."""

import asyncio
from typing import Any

from adapters.mal.call import Call, Handler
from adapters.mal.errors import MalError, StandardError
from adapters.mal.header import Header
from adapters.mal.replies import Replies
from adapters.mal.specification import Operation, Pattern, Stage


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

    def __init__(self, call: Call, header: Header, operation: Operation, replies: Replies) -> None:
        """Begin with the message that initiates it."""
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
