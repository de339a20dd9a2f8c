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
    from tests.simulated.process import Life, Process
    from tests.simulated.world import World

SocketAddress = tuple[str, int]
_OWN: Final = frozenset({"", "0.0.0.0", "127.0.0.1", "localhost", "::", "::1"})
_FIRST_FREE_PORT: Final = 49_152
_LAST_PORT: Final = 65_535


def always(_now_s: float) -> bool:
    """Return that a way is open."""
    return True


@dataclass(frozen=True, slots=True)
class Way:
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
        self.default, self.own = Way(), Way(0.00005)
        self.window_octets = 256 << 10
        self.split = 0.0
        self.listeners: dict[SocketAddress, Listener] = {}
        self.sockets: dict[SocketAddress, DatagramSocket] = {}
        self.stream_chance = world.random("network/tcp")
        self.datagram_chance = world.random("network/udp")
        self._ways: dict[tuple[str, str], Way] = {}
        self._last_port: dict[str, int] = {}

    def set_way(self, source: str, target: str, way: Way, back: Way | None = None) -> None:
        """Say how it is from one IP address to another from now on, and back: the same if None."""
        self._ways[source, target] = way
        self._ways[target, source] = way if back is None else back

    def way(self, source: str, target: str) -> Way:
        """Return how it is from one IP address to another."""
        way = self._ways.get((source, target))
        return way or (self.own if source == target else self.default)

    def listen(self, life: "Life", address: SocketAddress) -> Listener:
        """Return a listening socket of a process; raises OSError."""
        life.require()
        where = self._bind(life, address, self.listeners)
        listener = self.listeners[where] = Listener(self, life, where)
        life.resources.append(listener)
        return listener

    def unconnected(self, life: "Life") -> StreamSocket:
        """Return a TCP socket of a process for the loop's `sock_connect`."""
        life.require()
        host = life.process.host
        stream = StreamSocket(self, life, (host, 0), ("", 0))
        stream.gone = True
        return stream

    def datagrams(self, life: "Life", address: SocketAddress, buffer_octets: int) -> DatagramSocket:
        """Return a bound socket of a process for datagrams; raises OSError."""
        life.require()
        where = self._bind(life, address, self.sockets)
        bound = self.sockets[where] = DatagramSocket(self, life, where, buffer_octets)
        life.resources.append(bound)
        return bound

    def target(self, life: "Life", host: str) -> str:
        """Return the IP address that a process means."""
        return life.process.host if host in _OWN else host

    def free_port(self, host: str) -> int:
        """Return a port that was not used lately."""
        last = self._last_port.get(host, _LAST_PORT)
        port = self._last_port[host] = _FIRST_FREE_PORT if last == _LAST_PORT else last + 1
        return port

    def _bind(
        self,
        life: "Life",
        address: SocketAddress,
        taken: "dict[SocketAddress, Listener] | dict[SocketAddress, DatagramSocket]",
    ) -> SocketAddress:
        host = self.target(life, address[0])
        if host != life.process.host:
            raise error(errno.EADDRNOTAVAIL)
        where = host, address[1] or self.free_port(host)
        if where in taken:
            raise error(errno.EADDRINUSE)
        return where


def error(number: int) -> OSError:
    """Return the exception of an error number; its class follows from that."""
    return OSError(number, os.strerror(number))
