"""The link to a neighbour over plain UDP (RFC 7122, UDPCL): a bundle in each datagram."""

import asyncio
import logging
from collections.abc import Callable, Mapping
from math import inf
from typing import Final

from adapters.bundle.codec.errors import StoreError
from adapters.bundle.links.contact import ContactState
from adapters.bundle.links.link import SocketAddress
from adapters.bundle.node.node import Node
from adapters.bundle.node.settings import Neighbour, UdpLink

_LOG = logging.getLogger(__name__)
_BURST_S: Final = 0.02


class UdpNeighbour:
    """Sends bundles and hopes: what is to arrive for sure has to be confirmed end to end.

    Args:
        node: whose bundles.
        neighbour: to whom.
        link: sizes.
        now_s: monotonic time.
        transmit: takes datagrams for the neighbour.

    Attributes:
        name: of the neighbour.
    """

    def __init__(
        self,
        node: Node,
        neighbour: Neighbour,
        link: UdpLink,
        now_s: Callable[[], float],
        transmit: Callable[[bytes], None],
    ) -> None:
        """Begin with contact."""
        self.last_heard_s: float | None = None
        self.up = True
        self._node, self.name, self._link = node, neighbour.name, link
        self._now_s, self._transmit = now_s, transmit
        self._contact = True
        self._rate_octets_s = float(link.rate_octets_s)
        self._not_before_s = -inf

    @property
    def next_s(self) -> float | None:
        """When the link takes more."""
        return self._not_before_s if self._not_before_s > self._now_s() else None

    def heed(self, outlook: ContactState) -> None:
        """Send only while there is contact, and no more than it takes."""
        self._contact = outlook.contact
        self._rate_octets_s = min(self._link.rate_octets_s, outlook.rate_octets_s)

    def pump(self) -> None:
        """Send what waits, as fast as the link takes it."""
        burst = max(1, int(_BURST_S * self._rate_octets_s))
        while self.up and self._contact and self._now_s() >= self._not_before_s:
            batch = self._node.sending.outgoing(self.name, burst, self._link.bundle_octets)
            if not batch:
                return
            for outgoing in batch:
                self._transmit(outgoing.octets)
            self._node.sending.handed_on(batch)
            octets = sum(len(outgoing.octets) for outgoing in batch)
            begin_s = max(self._now_s(), self._not_before_s)
            self._not_before_s = begin_s + octets / self._rate_octets_s

    def tick(self) -> None:
        """Nothing is repeated."""

    def close(self) -> None:
        """Nothing is on its way."""


class UdpEndpoint(asyncio.DatagramProtocol):
    """The socket for bundles in datagrams, of whichever neighbour.

    Args:
        node: whose bundles.
        neighbours: those it hears, by where they listen, and so send from.
        wake: is called when something has come.
    """

    def __init__(
        self, node: Node, neighbours: Mapping[SocketAddress, UdpNeighbour], wake: Callable[[], None]
    ) -> None:
        """Wait for the socket."""
        self._node, self._neighbours, self._wake = node, neighbours, wake

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        """Take a bundle in; if there is no room it is lost, and the sender has to confirm."""
        neighbour = self._neighbour(addr)
        name = addr[0]
        if neighbour is not None:
            name = neighbour.name
            neighbour.last_heard_s = asyncio.get_running_loop().time()
        try:
            self._node.receiving.arrived(name, data)
        except StoreError as error:
            _LOG.warning("bundle from %s lost: %s", addr[0], error)
        self._wake()

    def _neighbour(self, addr: tuple[str, int]) -> UdpNeighbour | None:
        """Find who sent it; NASA ION, which sends from any port, has to be alone on its host."""
        if (neighbour := self._neighbours.get(addr[:2])) is not None:
            return neighbour
        there = [each for (host, _), each in self._neighbours.items() if host == addr[0]]
        return there[0] if len(there) == 1 else None

    def error_received(self, exc: Exception) -> None:
        """An ICMP message about a datagram of ours: UDP promises nothing."""
        _LOG.debug("UDPCL: %s", exc)
