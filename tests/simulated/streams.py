"""One end of a TCP connection: octets in order, flow control, retransmission, resets."""

import errno
import os
import socket
from collections import deque
from enum import Enum
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from tests.simulated.listening import Listener
    from tests.simulated.network import Network
    from tests.simulated.process import Incarnation
    from tests.simulated.transport import SimTransport

SocketAddress = tuple[str, int]
_RETRANSMIT_S: Final = 0.2
"""Until the first retransmission, beyond a way there and back; it doubles each time."""
_MAX_PAUSE_S: Final = 120.0
_TIMEOUT_S: Final = 924.6
"""How long Linux retransmits (tcp_retries2)."""


class Segment(Enum):
    """What one end sends to the other."""

    OPEN = "open"
    OCTETS = "octets"
    END = "end"
    RESET = "reset"


class StreamSocket:
    """One end of a TCP connection, as the operating system sees it.

    Args:
        network: on which.
        incarnation: of the process that has it.
        address: its own.
        peer_address: of the other end.

    Attributes:
        peer: the other end.
        transport: what reads and writes for asyncio; None before there is one.
        closed: whether there is no connection any more, or not yet.
    """

    def __init__(
        self,
        network: "Network",
        incarnation: "Incarnation",
        address: SocketAddress,
        peer_address: SocketAddress,
    ) -> None:
        self._network, self._world, self.incarnation = network, network.world, incarnation
        self._address, self._peer_address = address, peer_address
        self.peer: StreamSocket
        self.transport: SimTransport | None = None
        self.family, self.type, self.proto = socket.AF_INET, socket.SOCK_STREAM, 0
        self.fault: OSError | None = None
        self.ended = False
        self._listener: Listener | None = None
        self._closed = False
        self.closed = False
        self._requesting = False
        self._received: deque[bytes] = deque()
        self._in_flight = 0
        self._credits: deque[tuple[float, int]] = deque()
        self._credit_due = False
        self._unsent: deque[tuple[Segment, list[bytes]]] = deque()
        self._batch: list[bytes] = []
        self._batch_s = -1.0
        self._last_arrival_s = 0.0
        self._first_failed_s: float | None = None
        incarnation.resources.append(self)

    # What the product and asyncio call.

    def getsockname(self) -> SocketAddress:
        """Return its own address."""
        return self._address

    def getpeername(self) -> SocketAddress:
        """Return the address of the other end."""
        return self._peer_address

    def setsockopt(self, *_: object) -> None:
        """Take any option, and do nothing about it."""

    def setblocking(self, _: bool) -> None:
        """Never block."""

    def fileno(self) -> int:
        """Return that it has none."""
        return -1

    def close(self) -> None:
        """Close it: what was sent before still arrives; the peer is told of octets not read."""
        if self._closed:
            return
        self._closed = True
        unread = bool(self._received)
        self._received.clear()
        if not self.closed:
            self.send_segment(Segment.RESET if unread else Segment.END)
        self._forget()

    # What the transport calls.

    @property
    def capacity(self) -> int:
        """How many octets may be sent now."""
        credits, now_s = self._credits, self._world.now_s
        while credits and credits[0][0] <= now_s:
            self._in_flight -= credits.popleft()[1]
        return self._network.window_octets - self._in_flight

    def send(self, octets: bytes) -> None:
        """Send octets, no more than there is room for."""
        self._in_flight += len(octets)
        if self._batch_s == self._world.now_s:
            self._batch.append(octets)
            return
        batch = [octets]
        if self.send_segment(Segment.OCTETS, batch):
            self._batch, self._batch_s = batch, self._world.now_s

    def finish(self) -> None:
        """Tell the peer that nothing comes any more; read on."""
        self.send_segment(Segment.END)

    def await_space(self) -> None:
        """Have the transport told as soon as there is more room."""
        if self._credits and not self._credit_due:
            self._credit_due = True
            self._world.at(self._credits[0][0], self._credited)

    def take(self, maximum: int) -> bytes:
        """Return the next octets that have arrived, which makes room for the peer."""
        received = self._received
        if not received:
            return b""
        octets = received.popleft()
        if received and len(octets) < maximum:
            parts, count = [octets], len(octets)
            while received and count + len(received[0]) <= maximum:
                parts.append(received.popleft())
                count += len(parts[-1])
            octets = b"".join(parts)
        if len(octets) > maximum:
            received.appendleft(octets[maximum:])
            octets = octets[:maximum]
        split, chance = self._network.split, self._network.stream_chance
        if split and len(octets) > 1 and chance.random() < split:
            cut = chance.randrange(1, len(octets))
            received.appendleft(octets[cut:])
            octets = octets[:cut]
        self._read(len(octets))
        return octets

    @property
    def readable(self) -> bool:
        """Whether there is something to read, be it the end."""
        return bool(self._received) or self.ended or self.fault is not None

    # What the network does.

    def become(self, other: "StreamSocket") -> None:
        """Be the end of a connection that was set up for it."""
        resources = self.incarnation.resources
        if self in resources:
            resources.remove(self)
        self.__dict__.update(other.__dict__)
        other.peer.peer = self
        self.incarnation.resources[self.incarnation.resources.index(other)] = self

    def opened_by(self, listener: "Listener") -> None:
        """Know which listener takes it as soon as the other end confirms."""
        self._listener = listener

    def drop(self, *, silent: bool) -> None:
        """Have the process gone: the peer gets a reset, or nothing ever."""
        if not silent and not self.closed:
            self.send_segment(Segment.RESET)
        self._closed = self.closed = True
        self._received.clear()
        self._unsent.clear()

    def send_segment(self, segment: Segment, octets: list[bytes] | None = None) -> bool:
        """Send a segment, now or behind those that are sent again; return whether now.

        A reset is sent once: if it gets lost, the peer has a connection that is half open.
        """
        self._batch_s = -1.0
        if segment is Segment.RESET:
            self._unsent.clear()
            return self._transmit(segment, [])
        if self._unsent:
            self._unsent.append((segment, octets or []))
            return False
        if self._transmit(segment, octets or []):
            return True
        self._unsent.append((segment, octets or []))
        self._first_failed_s = self._world.now_s
        self._retry_after(_RETRANSMIT_S)
        return False

    def _transmit(self, segment: Segment, octets: list[bytes]) -> bool:
        network, world = self._network, self._world
        channel = network.channel(self._address[0], self._peer_address[0])
        if not channel.passes(world.now_s, network.stream_chance):
            return False
        arrival_s = max(self._last_arrival_s, world.now_s + channel.takes_s(network.stream_chance))
        self._last_arrival_s = arrival_s
        world.at(arrival_s, self.peer.arrive, segment, octets)
        return True

    def _retry_after(self, pause_s: float) -> None:
        network = self._network
        round_trip_s = 2 * network.channel(self._address[0], self._peer_address[0]).delay_s
        self._world.after(round_trip_s + pause_s, self._retry, pause_s)

    def _retry(self, pause_s: float) -> None:
        """Send again what did not get through, and what waits behind it as one segment."""
        while self._unsent:
            self._gather()
            if not self._transmit(*self._unsent[0]):
                assert self._first_failed_s is not None
                if self._world.now_s - self._first_failed_s > _TIMEOUT_S:
                    self._fail(errno.ETIMEDOUT)
                else:
                    self._retry_after(min(2 * pause_s, _MAX_PAUSE_S))
                return
            self._unsent.popleft()
            pause_s = _RETRANSMIT_S
            self._first_failed_s = self._world.now_s
        self._first_failed_s = None

    def _gather(self) -> None:
        unsent = self._unsent
        segment, octets = unsent[0]
        while segment is Segment.OCTETS and len(unsent) > 1 and unsent[1][0] is segment:
            octets.extend(unsent[1][1])
            del unsent[1]

    def arrive(self, segment: Segment, octets: list[bytes]) -> None:
        """Handle what the peer sent."""
        if self.closed or self._closed:
            if not self._network.hosts[self._address[0]].powered:
                if not self.peer._requesting:
                    self.peer.retransmit(_RETRANSMIT_S, self._world.now_s)
            elif segment is not Segment.RESET and not (segment is Segment.END and not self.closed):
                self._refuse()
            return
        match segment:
            case Segment.OPEN:
                listener = self._listener
                if listener is None or not listener.complete(self):
                    self.closed = True
                    self._refuse()
                    self._forget()
            case Segment.OCTETS:
                self._received.extend(octets)
                self._notify()
            case Segment.END:
                self.ended = True
                self._notify()
            case Segment.RESET:
                self._fail(errno.ECONNRESET)

    def retransmit(self, pause_s: float, since_s: float) -> None:
        """Send again to a computer that is off, until it is on and knows of no connection."""
        self._requesting = True
        if self.closed:
            return
        if self._world.now_s - since_s > _TIMEOUT_S:
            self._fail(errno.ETIMEDOUT)
        elif self._network.hosts[self._peer_address[0]].powered:
            self.peer._refuse()
            self._requesting = False
        else:
            longer_s = min(2 * pause_s, _MAX_PAUSE_S)
            self._world.after(pause_s, self.retransmit, longer_s, since_s)

    def _refuse(self) -> None:
        """Answer a segment for which there is no connection."""
        network, world = self._network, self._world
        channel = network.channel(self._address[0], self._peer_address[0])
        if channel.passes(world.now_s, network.stream_chance):
            delay_s = channel.takes_s(network.stream_chance)
            world.after(delay_s, self.peer.arrive, Segment.RESET, [])

    def _fail(self, number: int) -> None:
        if self.closed:
            return
        self.closed = True
        self.fault = OSError(number, os.strerror(number))
        self._received.clear()
        self._unsent.clear()
        self._notify()

    def _notify(self) -> None:
        if self.transport is not None:
            self.transport.readable()

    def _read(self, count: int) -> None:
        """Let the peer know that so many octets were read, after the way."""
        peer, world = self.peer, self._world
        channel = self._network.channel(self._address[0], self._peer_address[0])
        peer._credits.append((world.now_s + channel.delay_s, count))
        if peer.transport is not None and peer.transport.waits_for_space:
            peer.await_space()

    def _credited(self) -> None:
        self._credit_due = False
        if self.transport is not None and not self.closed:
            self.transport.flush()

    def _forget(self) -> None:
        if self in self.incarnation.resources:
            self.incarnation.resources.remove(self)
