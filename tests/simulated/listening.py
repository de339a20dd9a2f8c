"""Listening for TCP connections, and what `create_server` returns."""

import asyncio
import errno
import os
import socket
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

from tests.simulated.streams import SocketAddress, StreamSocket
from tests.simulated.transport import SimTransport

if TYPE_CHECKING:
    from tests.simulated.loop import SimLoop
    from tests.simulated.network import Network
    from tests.simulated.process import Incarnation

_BACKLOG: Final = 128


class Listener:
    """A listening TCP socket.

    Args:
        network: on which.
        incarnation: of the process that has it.
        address: where it listens.
    """

    def __init__(
        self, network: "Network", incarnation: "Incarnation", address: SocketAddress
    ) -> None:
        self._network, self.incarnation, self._address = network, incarnation, address
        self._accepted: deque[StreamSocket] = deque()
        self._requested: deque[asyncio.Future[StreamSocket]] = deque()
        self._on_connection: Callable[[StreamSocket], object] | None = None
        self._loop: SimLoop | None = None
        self._closed = False
        self.family, self.type, self.proto = socket.AF_INET, socket.SOCK_STREAM, 0

    def getsockname(self) -> SocketAddress:
        """Return where it listens."""
        return self._address

    def setblocking(self, _: bool) -> None:
        """Never block."""

    def fileno(self) -> int:
        """Return that it has none."""
        return -1

    def close(self) -> None:
        """Listen no more; who was not accepted yet is turned away."""
        if not self._closed:
            self.drop(silent=False)
            if self in self.incarnation.resources:
                self.incarnation.resources.remove(self)
            for each in list(self._accepted):
                each.drop(silent=False)
            self._accepted.clear()

    def drop(self, *, silent: bool) -> None:
        """Let go of the address."""
        self._closed = True
        self._network.listeners.pop(self._address, None)

    @property
    def crowded(self) -> bool:
        """Whether so many wait to be accepted that others are not heard."""
        return len(self._accepted) >= _BACKLOG

    async def accept(self, loop: "SimLoop") -> StreamSocket:
        """Return the next connection."""
        if self._closed:
            raise OSError(errno.EBADF, os.strerror(errno.EBADF))
        if self._accepted:
            return self._accepted.popleft()
        requested: asyncio.Future[StreamSocket] = loop.create_future()
        self._requested.append(requested)
        return await requested

    def serve(self, loop: "SimLoop", on_connection: Callable[[StreamSocket], object]) -> None:
        """Have a callback called with each connection."""
        self._loop, self._on_connection = loop, on_connection
        while self._accepted:
            loop.call_soon(on_connection, self._accepted.popleft())

    def complete(self, accepted: StreamSocket) -> bool:
        """Take a connection that is set up; return whether it still listens."""
        if self._closed:
            return False
        if self._on_connection is not None and self._loop is not None:
            self._loop.call_soon(self._on_connection, accepted)
            return True
        while self._requested:
            requested = self._requested.popleft()
            if not requested.done():
                requested.set_result(accepted)
                return True
        self._accepted.append(accepted)
        return True


class Server(asyncio.AbstractServer):
    """What `create_server` returns."""

    def __init__(
        self,
        loop: "SimLoop",
        protocol_factory: Callable[[], asyncio.BaseProtocol],
        listener: Listener,
    ) -> None:
        self._loop, self._factory, self._listener = loop, protocol_factory, listener
        self._serving = False

    @property
    def sockets(self) -> tuple[Any, ...]:
        """The listening socket, until it is closed."""
        return () if self._listener._closed else (self._listener,)

    def close(self) -> None:
        """Listen no more."""
        self._serving = False
        self._listener.close()

    def get_loop(self) -> asyncio.AbstractEventLoop:
        """Return whose it is."""
        return self._loop

    def is_serving(self) -> bool:
        """Whether it accepts connections."""
        return self._serving

    async def start_serving(self) -> None:
        """Accept connections."""
        self._serving = True
        self._listener.serve(self._loop, self._begin)

    async def serve_forever(self) -> None:
        """Accept connections until this is cancelled."""
        await self.start_serving()
        try:
            await self._loop.create_future()
        finally:
            self.close()

    async def wait_closed(self) -> None:
        """Return at once."""

    def _begin(self, accepted: StreamSocket) -> None:
        SimTransport(self._loop, accepted, self._factory())
