"""The UDP socket at which the LTP engine of a node listens, for all its LTP neighbours."""

import asyncio
import logging
import socket
from collections.abc import Callable, Mapping
from typing import Final

from adapters.bundle.errors import DecodeError
from adapters.bundle.ltp_link import LtpNeighbour
from adapters.bundle.ltp_segment import (
    Cancel,
    CancelAck,
    Data,
    Segment,
    decode_segment,
    encode_segment,
)
from adapters.bundle.settings import Address
from adapters.bundle.target import Target

_LOG = logging.getLogger(__name__)
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

    def transmit(self, target: Target, segments: list[Segment]) -> None:
        """Send segments; what the socket does not take now is lost, and LTP sends it again."""
        if target.where is None:
            return
        for segment in segments:
            try:
                self._socket.sendto(encode_segment(segment), target.where)
            except OSError as error:
                _LOG.debug("segment to %s not sent: %s", target.where, error)
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
                _LOG.debug("LTP socket: %s", error)
                continue
            self._receive(datagram)
        self._wake()

    def _receive(self, datagram: bytes) -> None:
        try:
            segment = decode_segment(datagram)
        except DecodeError as error:
            self.malformed += 1
            _LOG.debug("malformed segment dropped: %s", error)
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
