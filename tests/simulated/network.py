"""The network between simulated processes: ways from one computer to another, and addresses."""

import errno
import os
from collections.abc import Callable
from dataclasses import dataclass
from random import Random
from typing import TYPE_CHECKING, Final

from tests.simulated.datagrams import DatagramSocket
from tests.simulated.listening import Listener
from tests.simulated.streams import StreamSocket

if TYPE_CHECKING:
    from tests.simulated.process import Incarnation, Process
    from tests.simulated.world import World

SocketAddress = tuple[str, int]
_OWN: Final = frozenset({"", "0.0.0.0", "127.0.0.1", "localhost", "::", "::1"})
_FIRST_FREE_PORT: Final = 49_152
_LAST_PORT: Final = 65_535


def always(_now_s: float) -> bool:
    """Return that a way is open."""
    return True


@dataclass(frozen=True, slots=True)
class Channel:
    """How what is sent from one computer comes to another.

    Over TCP, what is lost or does not get through is sent again until it does.

    Attributes:
        delay_s: how long it takes at least, such as the time of light.
        jitter_s: how much longer it takes at most; datagrams may overtake each other then.
        loss: the part that is lost.
        duplicate: the part of datagrams that comes twice.
        open: whether what is sent at a time gets through: windows of contact.
    """

    delay_s: float = 0.0005
    jitter_s: float = 0.0
    loss: float = 0.0
    duplicate: float = 0.0
    open: Callable[[float], bool] = always

    def passes(self, now_s: float, chance: Random) -> bool:
        """Return whether what is sent now gets through."""
        return self.open(now_s) and not (self.loss and chance.random() < self.loss)

    def takes_s(self, chance: Random) -> float:
        """Return how long it takes."""
        return self.delay_s + self.jitter_s * chance.random() if self.jitter_s else self.delay_s


class Network:
    """Ways, listeners and sockets by address.

    Args:
        world: whose.

    Attributes:
        hosts: the process at an IP address.
        default: the way between two computers of which nothing else is said.
        own: the way from a process to itself.
        window_octets: of each direction of a TCP connection, sent and not read yet.
        split: the part of arrivals over TCP that is read in two pieces.
        listeners: by address.
        sockets: of datagrams, by address.
    """

    def __init__(self, world: "World") -> None:
        self.world = world
        self.hosts: dict[str, Process] = {}
        self.default, self.own = Channel(), Channel(0.00005)
        self.window_octets = 256 << 10
        self.split = 0.0
        self.listeners: dict[SocketAddress, Listener] = {}
        self.sockets: dict[SocketAddress, DatagramSocket] = {}
        self.stream_chance = world.random("network/tcp")
        self.datagram_chance = world.random("network/udp")
        self._channels: dict[tuple[str, str], Channel] = {}
        self._last_port: dict[str, int] = {}

    def set_channel(
        self, source: str, target: str, channel: Channel, back: Channel | None = None
    ) -> None:
        """Say how it is from one IP address to another from now on, and back: the same if None."""
        self._channels[source, target] = channel
        self._channels[target, source] = channel if back is None else back

    def channel(self, source: str, target: str) -> Channel:
        """Return how it is from one IP address to another."""
        channel = self._channels.get((source, target))
        return channel or (self.own if source == target else self.default)

    def listen(self, incarnation: "Incarnation", address: SocketAddress) -> Listener:
        """Return a listening socket of a process; raises OSError."""
        incarnation.require()
        where = self._bind(incarnation, address, self.listeners)
        listener = self.listeners[where] = Listener(self, incarnation, where)
        incarnation.resources.append(listener)
        return listener

    def unconnected(self, incarnation: "Incarnation") -> StreamSocket:
        """Return a TCP socket of a process for the loop's `sock_connect`."""
        incarnation.require()
        host = incarnation.process.host
        stream = StreamSocket(self, incarnation, (host, 0), ("", 0))
        stream.closed = True
        return stream

    def datagrams(
        self, incarnation: "Incarnation", address: SocketAddress, buffer_octets: int
    ) -> DatagramSocket:
        """Return a bound socket of a process for datagrams; raises OSError."""
        incarnation.require()
        where = self._bind(incarnation, address, self.sockets)
        bound = self.sockets[where] = DatagramSocket(self, incarnation, where, buffer_octets)
        incarnation.resources.append(bound)
        return bound

    def target(self, incarnation: "Incarnation", host: str) -> str:
        """Return the IP address that a process means."""
        return incarnation.process.host if host in _OWN else host

    def free_port(self, host: str) -> int:
        """Return a port that was not used lately."""
        last = self._last_port.get(host, _LAST_PORT)
        port = self._last_port[host] = _FIRST_FREE_PORT if last == _LAST_PORT else last + 1
        return port

    def _bind(
        self,
        incarnation: "Incarnation",
        address: SocketAddress,
        taken: "dict[SocketAddress, Listener] | dict[SocketAddress, DatagramSocket]",
    ) -> SocketAddress:
        host = self.target(incarnation, address[0])
        if host != incarnation.process.host:
            raise error(errno.EADDRNOTAVAIL)
        where = host, address[1] or self.free_port(host)
        if where in taken:
            raise error(errno.EADDRINUSE)
        return where


def error(number: int) -> OSError:
    """Return the exception of an error number; its class follows from that."""
    return OSError(number, os.strerror(number))
