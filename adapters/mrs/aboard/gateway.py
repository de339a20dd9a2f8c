"""`CoreGateway` passes commands and queries from the link's loop to the core's thread."""

import asyncio
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Final, TypeVar

from adapters.mal import StandardError
from adapters.mrs.spec import AreaError, duplicate_error, refusal_error, with_text
from executive.commands import Command, Stop
from executive.commands.lifecycle import Accepted, Duplicate, Rejected, SubmitResult
from executive.core.runner import Executive

T = TypeVar("T")
Reply = Callable[[Callable[[], T]], None]
"""Takes the function that returns an answer, or raises its error."""

ANSWER_TIMEOUT_S: Final = 5.0
"""Timeout of the core's answer to a query or command, then INTERNAL; chosen, not measured."""
MAX_PENDING: Final = 256
"""Maximum commands and queries queued for the core. A stop is always accepted, behind at most
these."""
TIMEOUT_ERROR: Final = (
    "no answer of the executive within {:g} s: whether it accepted this is unknown; resend the"
    " command under the same commandId"
)


class CoreGateway:
    """Submits commands and queries to an executive, each answered by a future.

    `submit` and `query` are called on the loop. Their callables run on the core's thread, which
    owns the core's data; the future completes on the loop.
    """

    def __init__(self, executive: Executive, loop: asyncio.AbstractEventLoop) -> None:
        self._executive = executive
        self._loop = loop
        self._pending = 0

    def submit(self, command: Command) -> asyncio.Future[None]:
        """Submit a command; the future completes when it is accepted, else with the error.

        The error is TOO_MANY if the queue is full and the command is no stop.
        """
        answer: asyncio.Future[None] = self._loop.create_future()
        if self._pending >= MAX_PENDING and not isinstance(command.request, Stop):
            return _queue_full_error(answer)
        self._executive.submit(command, partial(self._on_result, answer, command))
        return self._limit(answer)

    def query(self, question: Callable[[Executive], T]) -> asyncio.Future[T]:
        """Run a query on the core's thread; the error is TOO_MANY if the queue is full.

        A query whose future is cancelled stays in the queue until the core has run it.
        """
        return self.query_later(lambda executive, reply: reply(partial(question, executive)))

    def query_later(self, question: Callable[[Executive, Reply[T]], None]) -> asyncio.Future[T]:
        """Run a query that replies later, on the core's thread; otherwise as `query`.

        Args:
            question: called with a function that takes the function which returns the answer.
        """
        answer: asyncio.Future[T] = self._loop.create_future()
        if self._pending >= MAX_PENDING:
            return _queue_full_error(answer)
        self._executive.query(partial(self._run, answer, question))
        return _shielded(self._limit(answer))

    def call_on_loop(self, act: Callable[..., None], *arguments: object) -> None:
        """Call a function on the loop, from any thread; ignored if the loop is closed."""
        with suppress(RuntimeError):
            self._loop.call_soon_threadsafe(act, *arguments)

    def _limit(self, answer: asyncio.Future[T]) -> asyncio.Future[T]:
        """Count a future as pending, and fail it if the core does not answer in time."""
        silent = with_text(StandardError.INTERNAL, TIMEOUT_ERROR.format(ANSWER_TIMEOUT_S))
        timer = self._loop.call_later(ANSWER_TIMEOUT_S, _fail, answer, silent)
        self._pending += 1

        def on_done(_: asyncio.Future[T]) -> None:
            self._pending -= 1
            timer.cancel()

        answer.add_done_callback(on_done)
        return answer

    def _on_result(
        self, answer: asyncio.Future[None], command: Command, result: SubmitResult
    ) -> None:
        match result:
            case Accepted():
                self.call_on_loop(_succeed, answer, None)
            case Rejected(refusal) if isinstance(command.request, Stop):
                self.call_on_loop(_fail, answer, with_text(AreaError.REJECTED, refusal.text))
            case Rejected(refusal):
                self.call_on_loop(_fail, answer, refusal_error(refusal, command.identity))
            case Duplicate():
                self.call_on_loop(_fail, answer, duplicate_error(command.identity))

    def _run(
        self, answer: asyncio.Future[T], question: Callable[[Executive, Reply[T]], None]
    ) -> None:
        def reply(make: Callable[[], T]) -> None:
            try:
                self.call_on_loop(_succeed, answer, make())
            except Exception as error:  # an error of a query must not end the core
                self.call_on_loop(_fail, answer, error)

        try:
            question(self._executive, reply)
        except Exception as error:
            self.call_on_loop(_fail, answer, error)


def _queue_full_error(answer: asyncio.Future[T]) -> asyncio.Future[T]:
    answer.set_exception(with_text(StandardError.TOO_MANY, f"{MAX_PENDING} queued: try again"))
    return answer


def _shielded(answer: asyncio.Future[T]) -> asyncio.Future[T]:
    """Return a future with the result of an answer, which may be cancelled without the answer.

    `asyncio.shield` is not used: since Python 3.14 it logs errors of abandoned futures.
    """
    follower: asyncio.Future[T] = answer.get_loop().create_future()

    def follow(_: asyncio.Future[T]) -> None:
        error = answer.exception()
        if follower.done():
            return
        if error is None:
            follower.set_result(answer.result())
        else:
            follower.set_exception(error)

    answer.add_done_callback(follow)
    return follower


def _succeed(answer: asyncio.Future[T], result: T) -> None:
    if not answer.done():
        answer.set_result(result)


def _fail(answer: asyncio.Future[T], error: Exception) -> None:
    if not answer.done():
        answer.set_exception(error)
