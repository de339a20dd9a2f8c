"""Attached to a uD3TN daemon: one connection to receive, one to send, both dialled for ever."""

import asyncio
import logging
import secrets
from collections import deque
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Final

from adapters.bundle.aap2.connection import BROKEN, Connection, dial
from adapters.bundle.codec.eid import Eid
from adapters.bundle.codec.errors import BundleError
from adapters.bundle.daemons.link import (
    Inbound,
    OnInbound,
    OnResult,
    Outbound,
)
from adapters.bundle.links.link import Backoff, text_of
from adapters.bundle.node.settings import Aap2Settings

_LOG: Final = logging.getLogger(__name__)
_END_S: Final = 5.0


class _NotKept(Exception):  # noqa: N818 - the daemon keeps it, and brings it again
    """What came could not be stored, and is not acknowledged."""


class Aap2Daemon:
    """The client of a uD3TN daemon; see `Daemon`.

    Args:
        settings: where it is.
        own: the endpoint.
        most_octets: the longest application data that is taken.
        redial_s: the shortest pause before dialling again; it doubles up to 30 s.
    """

    def __init__(
        self, settings: Aap2Settings, own: Eid, most_octets: int, redial_s: float = 0.5
    ) -> None:
        """Be ready to be opened."""
        self._settings, self._own, self._most_octets = settings, own, most_octets
        self._to_receive = Backoff(f"receiving from uD3TN at {settings.where}", redial_s)
        self._to_send = Backoff(f"sending to uD3TN at {settings.where}", redial_s)
        self._secret = settings.secret or secrets.token_hex(16)
        self._hear: OnInbound = _deaf
        self._wake: Callable[[], None] = _nobody
        self._posted: deque[tuple[Outbound, OnResult]] = deque()
        self._filled = asyncio.Event()
        self._idle = asyncio.Event()
        self._idle.set()
        self._up = self._closing = False
        self._tasks: list[asyncio.Task[None]] = []

    @property
    def up(self) -> bool:
        """Whether the daemon takes what is sent."""
        return self._up and not self._closing

    async def open(self, hear: OnInbound, wake: Callable[[], None]) -> None:
        """Dial, once waiting for it and then for ever; see `Daemon`."""
        self._hear, self._wake = hear, wake
        with suppress(*BROKEN):
            async with dial(self._settings, self._own, self._secret, subscribe=True):
                pass
        self._tasks = [
            asyncio.create_task(self._for_ever(self._to_receive, self._receive)),
            asyncio.create_task(self._for_ever(self._to_send, self._send)),
        ]

    def post(self, data: Outbound, told: OnResult) -> None:
        """Send it in its turn."""
        self._posted.append((data, told))
        self._idle.clear()
        self._filled.set()

    async def close(self) -> None:
        """Wait for the answer to what was sent last, and hang up."""
        self._closing = True
        self._give_back("the relay ends")
        if self._up:
            try:
                async with asyncio.timeout(min(_END_S, self._settings.answer_s)):
                    await self._idle.wait()
            except TimeoutError:
                _LOG.warning("uD3TN does not answer: what was under way is sent again")
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self._tasks = []

    async def _for_ever(
        self, backoff: Backoff, work: Callable[[Connection], Awaitable[None]]
    ) -> None:
        subscribe = backoff is self._to_receive
        while True:
            try:
                async with dial(
                    self._settings, self._own, self._secret, subscribe=subscribe
                ) as connection:
                    await work(connection)
            except (*BROKEN, BundleError, _NotKept) as error:
                await asyncio.sleep(backoff.failed(error))

    async def _receive(self, connection: Connection) -> None:
        """Acknowledge each once it is on the disk, and not before."""
        while True:
            inbound = await connection.receive(self._most_octets)
            if inbound is not None:
                await self._keep(inbound)
                await connection.taken()
            self._to_receive.went_well()

    async def _keep(self, inbound: Inbound) -> None:
        kept: asyncio.Future[str | None] = asyncio.get_running_loop().create_future()

        def tell(failure: str | None) -> None:
            if not kept.done():
                kept.set_result(failure)

        self._hear(inbound, tell)
        if (failure := await kept) is not None:
            raise _NotKept(f"not taken: {failure}")

    async def _send(self, connection: Connection) -> None:
        self._change(up=True)
        try:
            while True:
                await self._send_next(connection)
        finally:
            self._change(up=False)
            self._give_back("the connection to uD3TN is lost")

    async def _send_next(self, connection: Connection) -> None:
        """Send what waits, or say after a while that this side is still there."""
        try:
            async with asyncio.timeout(self._settings.keepalive_s):
                await self._filled.wait()
        except TimeoutError:
            await connection.stay_alive()
            self._to_send.went_well()
            return
        if not self._posted:
            self._filled.clear()
            self._idle.set()
            return
        data, told = self._posted.popleft()
        try:
            failure = await connection.send(data)
        except BaseException as error:
            told(f"uD3TN did not answer: {text_of(error)}")
            raise
        self._to_send.went_well()
        told(failure)

    def _change(self, *, up: bool) -> None:
        self._up = up
        self._wake()

    def _give_back(self, why: str) -> None:
        posted, self._posted = self._posted, deque()
        for _, told in posted:
            told(why)
        self._filled.set()


def _deaf(_: Inbound, told: OnResult) -> None:
    told("not open")


def _nobody() -> None:
    """Nobody waits."""
