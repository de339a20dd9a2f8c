"""One TCP connection that carries messages both ways, and the URIs of its ends."""

import asyncio
import logging
import socket
from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, cast
from urllib.parse import urlsplit

from adapters.mal.errors import DecodeError
from adapters.mal.message import MESSAGE_CAP, Framer, Header, decode_message

_LOG: Final = logging.getLogger(__name__)
_UNREAD_CAP: Final = 8 << 20
"""Octets written and not taken by the peer, beyond which another reply ends the connection."""
_UNSENT_CAP: Final = 128 << 10
"""Octets that the operating system may buffer for a slow peer. By default it takes megabytes, which
would be minutes of telemetry that can no longer be dropped."""
_GATHERED_CAP: Final = 16 << 10
"""Octets of notifications that are written at once."""
_GRACE_S: Final = 1.0
"""How long a peer may take what was written before the connection was closed."""

OnMessage = Callable[["Connection", Header, bytes], None]


class Connection(asyncio.BufferedProtocol):
    """Gives every message to its owner at once, and writes without waiting.

    Octets that are no message close the connection with one line in the log, and so does a peer
    that does not read its replies. Reading never waits for writing, so that a command gets in
    however slow the way back is.

    Attributes:
        lost: Done when the connection is gone, whichever end closed it.
        peer: The other end, for logs.
    """

    def __init__(
        self,
        on_message: OnMessage,
        message_cap: int = MESSAGE_CAP,
        on_open: Callable[["Connection"], None] = lambda _: None,
    ) -> None:
        self._on_message = on_message
        self._on_open = on_open
        self._framer = Framer(message_cap)
        self._transport: asyncio.Transport | None = None
        self._notifications = NotificationQueue(self._gather, self._abort)
        self._gathered: list[bytes] = []
        self._gathered_octets = 0
        self._writable = asyncio.Event()
        self._writable.set()
        self._holders: set[object] = set()
        self.lost: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self.peer = "nobody"

    @property
    def is_open(self) -> bool:
        """Whether messages can be sent."""
        return self._transport is not None and not self._transport.is_closing()

    @property
    def local_address(self) -> tuple[str, int]:
        """The host and port of this end, of an open connection."""
        assert self._transport is not None
        host, port, *_ = self._transport.get_extra_info("sockname")
        return host, port

    def send(self, message: bytes) -> None:
        """Write a message; nothing happens when the connection is gone."""
        self._write_gathered()
        self._write(message)

    def _write(self, message: bytes) -> None:
        if self._transport is None or self._transport.is_closing():
            return
        if self._transport.get_write_buffer_size() > _UNREAD_CAP:
            self._abort(f"more than {_UNREAD_CAP} octets wait to be read there")
            return
        self._transport.write(message)

    async def drain(self, patience_s: float | None = None) -> None:
        """Yield to the loop, and return when the peer has taken most of what was written.

        Returns at once on a connection that is lost.

        Raises:
            TimeoutError: The peer did not in so many seconds.
        """
        await asyncio.sleep(0)
        if not self._writable.is_set():
            async with asyncio.timeout(patience_s):
                while not self._writable.is_set():
                    await self._writable.wait()

    def pause_reading(self, holder: object) -> None:
        """Read nothing until each holder has resumed; the peer waits meanwhile."""
        self._holders.add(holder)
        if self._transport is not None:
            self._transport.pause_reading()

    def resume_reading(self, holder: object) -> None:
        """Read on if no other holder has paused reading."""
        if holder in self._holders:
            self._holders.remove(holder)
            if not self._holders and self._transport is not None:
                self._transport.resume_reading()

    def notify(self, message: bytes, droppable: bool) -> None:
        """Write a message that may wait, and be dropped meanwhile if it is `droppable`.

        Those of one turn of the loop are written together.
        """
        if self.is_open:
            self._notifications.put(message, droppable)

    def _gather(self, message: bytes) -> None:
        if not self._gathered:
            asyncio.get_running_loop().call_soon(self._write_gathered)
        self._gathered.append(message)
        self._gathered_octets += len(message)
        if self._gathered_octets > _GATHERED_CAP:
            self._write_gathered()

    def _write_gathered(self) -> None:
        if self._gathered:
            together = b"".join(self._gathered)
            self._gathered.clear()
            self._gathered_octets = 0
            self._write(together)

    def refuse(self, reason: str) -> None:
        """Close the connection because of what came over it, which the log will say."""
        if self._transport is not None and not self._transport.is_closing():
            _LOG.warning("connection with %s closed: %s", self.peer, reason)
            self._transport.close()

    async def close(self) -> None:
        """Close the connection and return when it is gone; a peer that takes nothing loses it."""
        self._write_gathered()
        if self._transport is not None:
            self._transport.close()
            await asyncio.wait([self.lost], timeout=_GRACE_S)
        if self._transport is not None:
            self._transport.abort()
            await self.lost

    def _abort(self, reason: str) -> None:
        if self._transport is not None and not self._transport.is_closing():
            _LOG.warning("connection with %s given up: %s", self.peer, reason)
            self._transport.abort()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Called by asyncio."""
        self._transport = cast(asyncio.Transport, transport)
        transport.get_extra_info("socket").setsockopt(
            socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, _UNSENT_CAP
        )
        host, port, *_ = transport.get_extra_info("peername")
        self.peer = f"{host}:{port}"
        self._on_open(self)

    def get_buffer(self, sizehint: int) -> memoryview:
        """Called by asyncio, for where to put what arrives."""
        return self._framer.buffer()

    def buffer_updated(self, nbytes: int) -> None:
        """Called by asyncio when octets have arrived there."""
        try:
            for message in self._framer.received(nbytes):
                header, body = decode_message(message)
                self._on_message(self, header, body)
                if not self.is_open:
                    return
        except DecodeError as fault:
            self.refuse(str(fault))

    def pause_writing(self) -> None:
        """Called by asyncio when the peer does not take what is written."""
        self._writable.clear()
        self._notifications.pause()

    def resume_writing(self) -> None:
        """Called by asyncio when the peer takes again."""
        self._writable.set()
        self._notifications.resume()

    def connection_lost(self, exc: Exception | None) -> None:
        """Called by asyncio, once."""
        self._transport = None
        self._writable.set()
        self.lost.set_result(None)


SCHEME: Final = "maltcp"
_BROKER: Final = "InternalBroker"


@dataclass(frozen=True, slots=True)
class MalUri:
    """Where a consumer, provider or broker is, and its name there."""

    host: str
    port: int
    name: str

    @classmethod
    def parse(cls, text: str) -> "MalUri":
        """Read `maltcp://host:port/name`.

        Raises:
            ValueError: It is not of this form.
        """
        parts = urlsplit(text)
        if (
            parts.scheme != SCHEME
            or not parts.hostname
            or parts.port is None
            or len(parts.path) < 2
        ):
            raise ValueError(f"{text!r} is not {SCHEME}://host:port/name")
        return cls(parts.hostname, parts.port, parts.path[1:])

    @property
    def broker(self) -> "MalUri":
        """The broker that belongs to a provider, named as ESA does."""
        return MalUri(self.host, self.port, self.name + _BROKER)

    def __str__(self) -> str:
        """The URI as text."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{SCHEME}://{host}:{self.port}/{self.name}"


DROPPABLE_CAP: Final = 256
"""Droppable messages that wait, at most; the oldest gives way to a new one."""
BACKLOG_CAP: Final = 4096
"""Messages that may not be dropped and wait, at most; one more and the subscriber is given up."""


class NotificationQueue:
    """Writes messages at once, or queues them in order while writing is paused; bounded."""

    def __init__(self, write: Callable[[bytes], None], give_up: Callable[[str], None]) -> None:
        self._write = write
        self._abort = give_up
        self._waiting: OrderedDict[int, bytes] = OrderedDict()
        self._droppable: deque[int] = deque()
        self._number = 0
        self._paused = False

    def put(self, message: bytes, droppable: bool) -> None:
        """Write a message now or later."""
        if not self._paused:
            self._write(message)
            return
        self._number += 1
        if droppable:
            if len(self._droppable) == DROPPABLE_CAP:
                del self._waiting[self._droppable.popleft()]
            self._droppable.append(self._number)
        elif len(self._waiting) - len(self._droppable) == BACKLOG_CAP:
            self._abort(f"{BACKLOG_CAP} messages wait that may not be dropped")
            return
        self._waiting[self._number] = message

    def pause(self) -> None:
        """Keep what comes from now on."""
        self._paused = True

    def resume(self) -> None:
        """Write what waits, until paused again."""
        self._paused = False
        while self._waiting and not self._paused:
            number, message = self._waiting.popitem(last=False)
            if self._droppable and self._droppable[0] == number:
                self._droppable.popleft()
            self._write(message)
