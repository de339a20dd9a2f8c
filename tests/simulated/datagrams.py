"""UDP sockets of simulated processes."""

import asyncio
import errno
import os
import socket
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from tests.simulated.loop import SimLoop
    from tests.simulated.network import Network
    from tests.simulated.process import Incarnation

SocketAddress = tuple[str, int]
_MAX_OCTETS: Final = 65_507
_OVERHEAD: Final = 256
"""What a waiting datagram takes of the buffer beside its octets."""


class DatagramSocket:
    """A bound UDP socket, as far as `add_reader`, `recvfrom` and `sendto` go.

    Args:
        network: on which.
        incarnation: of the process that has it.
        address: where it is bound.
        buffer_octets: what waits to be read at most; what comes then is lost.
    """

    def __init__(
        self,
        network: "Network",
        incarnation: "Incarnation",
        address: SocketAddress,
        buffer_octets: int,
    ) -> None:
        self._network, self._world, self._incarnation = network, network.world, incarnation
        self._address, self._buffer_octets = address, buffer_octets
        self._waiting: deque[tuple[bytes, SocketAddress]] = deque()
        self._waiting_octets = 0
        self._reader: tuple[SimLoop, Callable[..., object], tuple[Any, ...]] | None = None
        self._granted = False
        self._closed = False
        self.family = socket.AF_INET

    def sendto(self, datagram: bytes, address: SocketAddress) -> int:
        """Send a datagram; what a dead process sends goes nowhere."""
        if not self._incarnation.alive:
            return len(datagram)
        if self._closed:
            raise OSError(errno.EBADF, os.strerror(errno.EBADF))
        if len(datagram) > _MAX_OCTETS:
            raise OSError(errno.EMSGSIZE, os.strerror(errno.EMSGSIZE))
        network, world = self._network, self._world
        target = network.target(self._incarnation, address[0])
        channel, chance = network.channel(self._address[0], target), network.datagram_chance
        if channel.passes(world.now_s, chance):
            where, octets = (target, address[1]), bytes(datagram)
            twice = channel.duplicate and chance.random() < channel.duplicate
            for _ in range(2 if twice else 1):
                world.after(channel.takes_s(chance), _arrive, network, where, octets, self._address)
        return len(datagram)

    def recvfrom(self, maximum: int) -> tuple[bytes, SocketAddress]:
        """Return the next datagram, and who sent it."""
        if self._closed:
            raise OSError(errno.EBADF, os.strerror(errno.EBADF))
        if not self._waiting:
            raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))
        datagram, sender = self._waiting.popleft()
        self._waiting_octets -= len(datagram) + _OVERHEAD
        return datagram[:maximum], sender

    def getsockname(self) -> SocketAddress:
        """Return where it is bound."""
        return self._address

    def fileno(self) -> int:
        """Return that it has none."""
        return -1

    def close(self) -> None:
        """Close it; nothing if that was done."""
        if not self._closed:
            self.drop(silent=False)
            if self in self._incarnation.resources:
                self._incarnation.resources.remove(self)

    def drop(self, *, silent: bool) -> None:
        """Let go of its address."""
        self._closed = True
        self._reader = None
        self._waiting.clear()
        self._network.sockets.pop(self._address, None)

    def watch(
        self, loop: "SimLoop", callback: Callable[..., object], args: tuple[Any, ...]
    ) -> None:
        """Have a callback called whenever there is something to read."""
        self._reader = loop, callback, args
        self._notify()

    def unwatch(self) -> bool:
        """Call nobody any more; return whether somebody was to be called."""
        had, self._reader = self._reader is not None, None
        return had

    def take(self, datagram: bytes, sender: SocketAddress) -> None:
        """Keep a datagram that has arrived until it is read."""
        octets = len(datagram) + _OVERHEAD
        if self._waiting_octets + octets <= self._buffer_octets:
            self._waiting.append((datagram, sender))
            self._waiting_octets += octets
            self._notify()

    def _notify(self) -> None:
        if self._waiting and self._reader is not None and not self._granted:
            self._granted = True
            loop = self._reader[0]
            self._incarnation.push(0.0, loop, asyncio.Handle(self._read, (), loop))

    def _read(self) -> None:
        self._granted = False
        if self._reader is not None and self._waiting:
            _, callback, args = self._reader
            try:
                callback(*args)
            finally:
                self._notify()


def _arrive(
    network: "Network", where: SocketAddress, datagram: bytes, sender: SocketAddress
) -> None:
    if (bound := network.sockets.get(where)) is not None:
        bound.take(datagram, sender)
