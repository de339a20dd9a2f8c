"""The link to a neighbour over LTP: blocks of bundles, reported when they are on the disk."""

import asyncio
import logging
import socket
from collections.abc import Callable, Mapping
from math import inf
from typing import Final

from adapters.bundle.codec.errors import DecodeError, StoreError
from adapters.bundle.links.contact import ContactState
from adapters.bundle.links.link import AddressLookup
from adapters.bundle.links.ltp_engine import (
    Arrived,
    Cancelled,
    Completed,
    LtpSpan,
)
from adapters.bundle.links.ltp_segment import (
    Cancel,
    CancelAck,
    Data,
    Segment,
    decode_segment,
    encode_segment,
)
from adapters.bundle.node.node import Node
from adapters.bundle.node.sending import Outgoing
from adapters.bundle.node.settings import Address, LtpLink, Neighbour, engine_of

_LOG = logging.getLogger(__name__)
_REFUSED_PAUSE_S = 1.0


class LtpNeighbour:
    """Moves bundles between a node and an LTP span.

    Args:
        node: whose bundles.
        neighbour: to whom.
        link: sizes and times.
        next_number: gives session numbers, never one twice.
        now_s: monotonic time.
        transmit: takes segments for the neighbour.

    Attributes:
        span: the protocol.
    """

    def __init__(
        self,
        node: Node,
        neighbour: Neighbour,
        link: LtpLink,
        next_number: Callable[[], int],
        now_s: Callable[[], float],
        transmit: Callable[[list[Segment]], None],
    ) -> None:
        """Begin with contact."""
        own, other = engine_of(node.settings.node), engine_of(neighbour.node)
        self.last_heard_s: float | None = None
        self.up = True
        self.span = LtpSpan(own, other, link, next_number, now_s)
        self._node, self._name, self._link = node, neighbour.name, link
        self._now_s, self._transmit = now_s, transmit
        self._blocks: dict[int, list[Outgoing]] = {}
        self._contact = True
        self._refusing = False
        self._rate_octets_s = inf
        self._not_before_s = -inf

    def receive(self, segment: Segment) -> None:
        """Take a segment from the neighbour."""
        self.last_heard_s = self._now_s()
        self.span.receive(segment)
        for event in self.span.events:
            match event:
                case Completed():
                    self._node.sending.handed_on(self._blocks.pop(event.number))
                case Cancelled():
                    self._came_back(event.number)
                case Arrived():
                    self._store(event)
        self.span.events.clear()
        self._flush()

    @property
    def next_s(self) -> float | None:
        """When a timer of the protocol ends, or the link takes more."""
        span_s = self.span.next_s
        if self._not_before_s > self._now_s():
            return min(self._not_before_s, inf if span_s is None else span_s)
        return span_s

    def heed(self, outlook: ContactState) -> None:
        """Let protocol time pass only while there is contact."""
        self.span.light_time_s = outlook.light_time_s
        self._rate_octets_s = outlook.rate_octets_s
        if outlook.contact == self._contact:
            return
        self._contact = outlook.contact
        if outlook.contact:
            self._not_before_s = -inf
            self.span.resume()
        else:
            self.span.suspend()

    def pump(self) -> None:
        """Send blocks of what waits."""
        link = self._link
        while self.up and self.span.room > 0 and self._now_s() >= self._not_before_s:
            batch = self._node.sending.outgoing(self._name, link.block_octets, link.bundle_octets)
            if not batch:
                break
            block = b"".join(outgoing.octets for outgoing in batch)
            try:
                number = self.span.send(block)
            except StoreError:
                self._node.sending.came_back(self._name, batch)
                raise
            self._blocks[number] = batch
            if self._rate_octets_s < inf:
                begin_s = max(self._now_s(), self._not_before_s)
                self._not_before_s = begin_s + len(block) / self._rate_octets_s
        self._flush()

    def tick(self) -> None:
        """Repeat what was not answered."""
        self.span.tick()
        self._flush()

    def close(self) -> None:
        """End; blocks on their way wait again."""
        for number in list(self._blocks):
            self._came_back(number)

    def _came_back(self, number: int) -> None:
        self._node.sending.came_back(self._name, self._blocks.pop(number))
        self._not_before_s = self._now_s() + _REFUSED_PAUSE_S

    def _store(self, arrived: Arrived) -> None:
        """Have a block stored, and report it when it is."""
        try:
            self._node.receiving.arrived(self._name, arrived.block)
        except StoreError as error:
            if not self._refusing:
                _LOG.warning("what comes from %s is refused: %s", self._name, error)
            self._refusing = True
            self.span.refuse(arrived.number)
            return
        self._refusing = False

        def tell(failure: StoreError | None) -> None:
            if failure is None:
                self.span.stored(arrived.number)
            else:
                self.span.refuse(arrived.number)
            self._flush()

        self._node.transaction.then(tell)

    def _flush(self) -> None:
        if self.span.segments:
            segments, self.span.segments[:] = list(self.span.segments), []
            self._transmit(segments)


_SOCKET_LOG = logging.getLogger(__name__)
_MOST_AT_ONCE: Final = 64
_BUFFER_OCTETS: Final = 4 << 20
_MOST_DATAGRAM: Final = 65_536


class LtpEndpoint:
    """Brings segments from the socket to the neighbours and back.

    Args:
        listen: where to listen; port 0 takes a free one.
        wake: is called when something has come.

    Attributes:
        malformed: how many datagrams were no segments.
        address: where it listens.
        family: of its socket.
    """

    def __init__(self, listen: Address, wake: Callable[[], None]) -> None:
        """Open the socket.

        Raises:
            OSError: the address cannot be had.
        """
        self.malformed = 0
        self._wake = wake
        self._neighbours: Mapping[int, LtpNeighbour] = {}
        family, *_, where = socket.getaddrinfo(
            listen.host, listen.port, type=socket.SOCK_DGRAM, flags=socket.AI_PASSIVE
        )[0]
        self.family = family
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_OCTETS)
            self._socket.setblocking(False)
            self._socket.bind(where)
        except OSError:
            self._socket.close()
            raise
        host, port = self._socket.getsockname()[:2]
        self.address = Address(host, port)

    def start(self, neighbours: Mapping[int, LtpNeighbour]) -> None:
        """Begin to listen, for neighbours by the numbers of their engines."""
        self._neighbours = neighbours
        asyncio.get_running_loop().add_reader(self._socket, self._readable)

    def transmit(self, target: AddressLookup, segments: list[Segment]) -> None:
        """Send segments; what the socket does not take now is lost, and LTP sends it again."""
        if target.where is None:
            return
        for segment in segments:
            try:
                self._socket.sendto(encode_segment(segment), target.where)
            except OSError as error:
                _SOCKET_LOG.debug("segment to %s not sent: %s", target.where, error)
                return

    def close(self) -> None:
        """Close the socket."""
        asyncio.get_running_loop().remove_reader(self._socket)
        self._socket.close()

    def _readable(self) -> None:
        for _ in range(_MOST_AT_ONCE):
            try:
                datagram = self._socket.recv(_MOST_DATAGRAM)
            except BlockingIOError:
                break
            except OSError as error:
                # An ICMP message about a datagram of ours; the next read goes on.
                _SOCKET_LOG.debug("LTP socket: %s", error)
                continue
            self._receive(datagram)
        self._wake()

    def _receive(self, datagram: bytes) -> None:
        try:
            segment = decode_segment(datagram)
        except DecodeError as error:
            self.malformed += 1
            _SOCKET_LOG.debug("malformed segment dropped: %s", error)
            return
        if (neighbour := self._neighbour(segment)) is not None:
            neighbour.receive(segment)

    def _neighbour(self, segment: Segment) -> LtpNeighbour | None:
        """Find whose segment this is: by its engine if it sends the block, else by the session."""
        session = segment.session
        by_sender = (
            isinstance(segment, Data)
            or (isinstance(segment, Cancel) and segment.by_sender)
            or (isinstance(segment, CancelAck) and not segment.of_sender)
        )
        if by_sender:
            return self._neighbours.get(session.originator)
        for engine, neighbour in self._neighbours.items():
            if session.originator != engine and neighbour.span.owns(session):
                return neighbour
        return None
