"""One TCP connection that carries messages both ways."""

import asyncio
import logging
from collections.abc import Callable
from typing import Final, cast

from adapters.mal.errors import DecodeError
from adapters.mal.framing import MESSAGE_CAP, Framer
from adapters.mal.header import Header, decode_message
from adapters.mal.outbox import Outbox

_LOG: Final = logging.getLogger(__name__)
_UNREAD_CAP: Final = 8 << 20
"""Octets written and not taken by the peer, beyond which another reply ends the connection."""

OnMessage = Callable[["Connection", Header, bytes], None]
OnLost = Callable[["Connection"], None]


class Connection(asyncio.Protocol):
    """Hands every message to its owner at once, and writes without waiting.

    What cannot be a message ends the connection with one line in the log, and so does a peer that
    does not take its replies. Reading never waits for writing: a command gets through however slow
    the way back is.
    """

    def __init__(
        self, on_message: OnMessage, on_lost: OnLost, message_cap: int = MESSAGE_CAP
    ) -> None:
        """Take what to call for each message, and once when the connection is gone."""
        self._on_message = on_message
        self._on_lost = on_lost
        self._framer = Framer(message_cap)
        self._transport: asyncio.Transport | None = None
        self._outbox = Outbox(self.send, self.close)
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
        if self._transport is None or self._transport.is_closing():
            return
        if self._transport.get_write_buffer_size() > _UNREAD_CAP:
            self.close(f"more than {_UNREAD_CAP} octets wait to be read there")
            return
        self._transport.write(message)

    def notify(self, message: bytes, droppable: bool) -> None:
        """Write a message that may wait, and be dropped meanwhile if it is `droppable`."""
        if self.is_open:
            self._outbox.put(message, droppable)

    def close(self, reason: str | None = None) -> None:
        """Close the connection, at once if there is a reason to log."""
        transport = self._transport
        if transport is None or transport.is_closing():
            return
        if reason is None:
            transport.close()
        else:
            _LOG.warning("connection with %s closed: %s", self.peer, reason)
            transport.abort()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Called by asyncio."""
        self._transport = cast(asyncio.Transport, transport)
        peer = transport.get_extra_info("peername")
        self.peer = f"{peer[0]}:{peer[1]}" if peer else "nobody"

    def data_received(self, data: bytes) -> None:
        """Called by asyncio."""
        try:
            for message in self._framer.feed(data):
                header, body = decode_message(message)
                self._on_message(self, header, body)
                if not self.is_open:
                    return
        except DecodeError as fault:
            self.close(str(fault))

    def pause_writing(self) -> None:
        """Called by asyncio when the peer does not take what is written."""
        self._outbox.pause()

    def resume_writing(self) -> None:
        """Called by asyncio when the peer takes again."""
        self._outbox.resume()

    def connection_lost(self, exc: Exception | None) -> None:
        """Called by asyncio, once."""
        self._transport = None
        self._on_lost(self)
