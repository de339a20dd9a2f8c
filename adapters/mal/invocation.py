"""The consumer's side of an INVOKE or PROGRESS: acknowledgement, updates, response."""

import asyncio
from collections.abc import Callable
from typing import Final

from adapters.mal.connection import Connection
from adapters.mal.errors import MalError, StandardError
from adapters.mal.pending import Parts
from adapters.mal.specification import Operation, Stage

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
