"""`BlockingClient` for scripts and notebooks: an `MrsClient` with its session on a thread."""

import asyncio
from collections.abc import Callable, Coroutine
from threading import Thread
from typing import Any, TypeVar

from adapters.mrs.ground.client import MrsClient
from adapters.mrs.ground.outcome import CommandOutcome, OnReport
from adapters.mrs.transport import CLEAR, TransportSettings
from executive.commands import Request

T = TypeVar("T")


class BlockingClient:
    """An `MrsClient` with its session on a separate thread; each call waits for its result.

    Args:
        to: `maltcp://host:port/MRS`, `host:port` or `host`.
        source: as in `MrsClient.connect`; the same errors are raised.
        terms: encoding and certificates, the same as the rover's.
    """

    def __init__(
        self, to: str, source: str | None = None, terms: TransportSettings = CLEAR
    ) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = Thread(target=self._loop.run_forever, name="mrs session", daemon=True)
        self._thread.start()
        try:
            self._client = self._wait(MrsClient.connect(to, source, terms=terms))
        except BaseException:
            self._end_thread()
            raise

    def __enter__(self) -> "BlockingClient":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the session."""
        try:
            self._wait(self._client.close())
        finally:
            self._end_thread()

    def run(self, request: Request, on_report: OnReport = lambda _: None) -> CommandOutcome:
        """Send a command and wait until it ends.

        Args:
            request: the request to command.
            on_report: called with each report of its life cycle on reception, on the thread of
                the session.
        """
        return self.call(lambda client: client.run(client.command(request), on_report))

    def call(self, method: Callable[[MrsClient], Coroutine[Any, Any, T]]) -> T:
        """Return the result of a client's method, e.g. `call(MrsClient.get_pose)`."""
        return self._wait(method(self._client))

    def _wait(self, work: Coroutine[Any, Any, T]) -> T:
        future = asyncio.run_coroutine_threadsafe(work, self._loop)
        try:
            return future.result()
        except BaseException:  # such as KeyboardInterrupt
            future.cancel()
            raise

    def _end_thread(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()
