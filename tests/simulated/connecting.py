"""Setting up a TCP connection, from the asking process's side."""

import asyncio
import errno
import os
from typing import TYPE_CHECKING, Final

from tests.simulated.listening import Listener
from tests.simulated.streams import Segment, SocketAddress, StreamSocket
from tests.simulated.transport import SimTransport

if TYPE_CHECKING:
    from tests.simulated.loop import SimLoop

_ATTEMPTS: Final = 7
"""How often Linux asks for a connection (tcp_syn_retries): for some two minutes."""


class _Attempt:
    """A process that asks for a connection."""

    def __init__(self, loop: "SimLoop", target: SocketAddress) -> None:
        self._loop, self._incarnation = loop, loop.incarnation
        self._network = network = loop.incarnation.world.network
        self._world = network.world
        self._own = (
            self._incarnation.process.host,
            network.free_port(self._incarnation.process.host),
        )
        self._target = network.target(self._incarnation, target[0]), target[1]
        self._tries = 0
        self.done: asyncio.Future[StreamSocket] = loop.create_future()
        self.request()

    def request(self) -> None:
        """Ask for it, and again if nothing comes back."""
        if self.done.done() or not self._incarnation.alive:
            return
        self._tries += 1
        if self._tries > _ATTEMPTS:
            self._refuse(errno.ETIMEDOUT)
            return
        network, world = self._network, self._world
        there = network.channel(self._own[0], self._target[0])
        back = network.channel(self._target[0], self._own[0])
        pause_s = there.delay_s + back.delay_s + 2.0 ** (self._tries - 1)
        if there.passes(world.now_s, network.stream_chance):
            world.after(there.takes_s(network.stream_chance), self._requested)
        world.after(pause_s, self.request)

    def _requested(self) -> None:
        """Be heard at the other computer, if there is one that is on, and be answered."""
        network, world = self._network, self._world
        process = network.hosts.get(self._target[0])
        if process is None or not process.powered:
            return
        listener = network.listeners.get(self._target)
        if listener is not None and listener.crowded:
            return
        back = network.channel(self._target[0], self._own[0])
        if not back.passes(world.now_s, network.stream_chance):
            return
        delay_s = back.takes_s(network.stream_chance)
        if listener is None:
            world.after(delay_s, self._refuse, errno.ECONNREFUSED)
        else:
            world.after(delay_s, self._answered, listener)

    def _answered(self, listener: Listener) -> None:
        if self.done.done() or not self._incarnation.alive:
            return
        network = self._network
        own = StreamSocket(network, self._incarnation, self._own, self._target)
        other = StreamSocket(network, listener.incarnation, self._target, self._own)
        own.peer, other.peer = other, own
        if not listener.incarnation.alive:
            other.closed = True
        other.opened_by(listener)
        own.send_segment(Segment.OPEN)
        self.done.set_result(own)

    def _refuse(self, number: int) -> None:
        if not self.done.done():
            self.done.set_exception(OSError(number, os.strerror(number)))


async def connect(loop: "SimLoop", target: SocketAddress) -> StreamSocket:
    """Set up a connection.

    Raises:
        OSError: nobody listens there, or nothing comes back.
    """
    loop.incarnation.require()
    attempt = _Attempt(loop, target)
    try:
        return await attempt.done
    except asyncio.CancelledError:
        if not attempt.done.cancelled() and not attempt.done.exception():
            attempt.done.result().close()
        raise


async def transport_of(
    loop: "SimLoop", protocol: asyncio.BaseProtocol, stream: StreamSocket
) -> tuple[SimTransport, asyncio.BaseProtocol]:
    """Return a transport for a connection as soon as its protocol knows of it."""
    begun: asyncio.Future[None] = loop.create_future()
    transport = SimTransport(loop, stream, protocol, begun)
    try:
        await begun
    except BaseException:
        transport.close()
        raise
    return transport, protocol
