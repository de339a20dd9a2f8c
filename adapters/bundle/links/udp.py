"""`UdpNeighbour`: link over UDPCL (RFC 7122); also UDP sockets and address lookup for LTP."""

import asyncio
import logging
import socket
from abc import abstractmethod
from collections import deque
from collections.abc import Callable, Iterable
from typing import Final

from adapters.bundle.codec.errors import StoreError
from adapters.bundle.links.contact import ContactState
from adapters.bundle.links.link import Backoff, Endpoint, Link, LinkContext, Pacer
from adapters.bundle.node.settings import Address, Neighbour, UdpLink
from adapters.system import SocketAddress

_LOG: Final = logging.getLogger(__name__)
LOOKUP_RETRY_S: Final = 1.0
"""Minimum pause before a failed name lookup is repeated; it doubles up to 30 s."""
_AT_ONCE: Final = 16
_MAX_QUEUED_OCTETS: Final = 16 << 20
_BUFFER_OCTETS: Final = 4 << 20
_MAX_DATAGRAM_OCTETS: Final = 65_536
_BURST_S: Final = 0.02  # chosen, not measured


class AddressLookup:
    """Asynchronous lookup of a neighbour's address, repeated until it succeeds.

    `found` is called once the address is known; at once if the host is numeric.

    Attributes:
        where: numeric host, and port; None while unknown.
    """

    def __init__(
        self, name: str, address: Address, family: socket.AddressFamily, found: Callable[[], None]
    ) -> None:
        self._address, self._family, self._found = address, family, found
        self._backoff = Backoff(f"{name} at {address.host}", LOOKUP_RETRY_S)
        self._resolving: asyncio.Task[None] | None = None
        self.where: SocketAddress | None = None
        try:
            answer = socket.getaddrinfo(
                address.host, address.port, family, socket.SOCK_DGRAM, 0, socket.AI_NUMERICHOST
            )
        except OSError:
            self._resolving = asyncio.get_running_loop().create_task(self._resolve())
        else:
            self._on_resolved(answer[0][4])

    def close(self) -> None:
        """Cancel the lookup."""
        if self._resolving is not None:
            self._resolving.cancel()

    async def _resolve(self) -> None:
        loop, address = asyncio.get_running_loop(), self._address
        while self.where is None:
            try:
                answer = await loop.getaddrinfo(
                    address.host, address.port, family=self._family, type=socket.SOCK_DGRAM
                )
                self._on_resolved(answer[0][4])
            except OSError as error:
                await asyncio.sleep(self._backoff.next_pause_s(error))

    def _on_resolved(
        self, found: tuple[str, int] | tuple[str, int, int, int] | tuple[int, bytes]
    ) -> None:
        host, port = found[:2]
        self.where = str(host), int(port)
        self._found()


class DatagramEndpoint(Endpoint):
    """UDP socket for all neighbours over one protocol; port 0 selects a free port.

    Raises:
        OSError: the address cannot be bound.
    """

    def __init__(self, context: LinkContext, listen: Address) -> None:
        self._context = context
        self._lookups: list[AddressLookup] = []
        self._waiting: deque[tuple[bytes, SocketAddress]] = deque()
        self._waiting_octets = 0
        self._working: asyncio.Handle | None = None
        family, *_, where = socket.getaddrinfo(
            listen.host, listen.port, type=socket.SOCK_DGRAM, flags=socket.AI_PASSIVE
        )[0]
        self._family = family
        self._socket = context.system.datagrams(where, family, _BUFFER_OCTETS)
        self.address = Address(*self._socket.getsockname()[:2])

    @abstractmethod
    def _receive(self, datagram: bytes, sender: SocketAddress) -> None:
        """Process a datagram."""

    async def open(self) -> None:
        """Start listening."""
        asyncio.get_running_loop().add_reader(self._socket, self._readable)

    async def close(self) -> None:
        """Cancel the lookups, and close the socket."""
        for lookup in self._lookups:
            lookup.close()
        if self._working is not None:
            self._working.cancel()
        asyncio.get_running_loop().remove_reader(self._socket)
        self._socket.close()

    def _resolve(self, link: Link, address: Address) -> AddressLookup:
        """Look up the address of a link; the link is up once it is known."""

        def found() -> None:
            link.up = True
            self._context.wake()

        link.up = False
        lookup = AddressLookup(link.name, address, self._family, found)
        self._lookups.append(lookup)
        return lookup

    def _send(self, lookup: AddressLookup, datagrams: Iterable[bytes]) -> None:
        """Send datagrams; those that the socket does not accept now are lost."""
        if lookup.where is None:
            return
        for datagram in datagrams:
            try:
                self._socket.sendto(datagram, lookup.where)
            except OSError as error:
                _LOG.debug("datagram to %s not sent: %s", lookup.where, error)
                return

    def _readable(self) -> None:
        """Empty the socket before processing, because the kernel's buffer is small."""
        while self._waiting_octets < _MAX_QUEUED_OCTETS:
            try:
                datagram, sender = self._socket.recvfrom(_MAX_DATAGRAM_OCTETS)
            except BlockingIOError:
                break
            except OSError as error:
                # An ICMP error about a datagram of ours; the next read succeeds.
                _LOG.debug("UDP socket: %s", error)
                continue
            self._waiting.append((datagram, sender[:2]))
            self._waiting_octets += len(datagram)
        if self._working is None:
            self._process_datagrams()

    def _process_datagrams(self) -> None:
        """Process some datagrams, then yield to the event loop."""
        for _ in range(min(_AT_ONCE, len(self._waiting))):
            datagram, sender = self._waiting.popleft()
            self._waiting_octets -= len(datagram)
            self._receive(datagram, sender)
        self._working = (
            asyncio.get_running_loop().call_soon(self._process_datagrams) if self._waiting else None
        )
        self._context.wake()


class UdpNeighbour(Link):
    """Sends bundles without acknowledgement; reliability needs `confirm`, end to end."""

    def __init__(
        self,
        context: LinkContext,
        neighbour: Neighbour,
        settings: UdpLink,
        transmit: Callable[[list[bytes]], None],
    ) -> None:
        super().__init__(context, neighbour)
        self._settings, self._transmit = settings, transmit
        self._pacer = Pacer(context.now_s)
        self._pacer.rate_octets_s = settings.rate_octets_s

    @property
    def next_s(self) -> float:
        """Monotonic end of the pacer's pause."""
        return self._pacer.next_s

    def on_contact(self, state: ContactState) -> None:
        """Send only during contact, and at most at its rate."""
        super().on_contact(state)
        self._pacer.rate_octets_s = min(self._settings.rate_octets_s, state.rate_octets_s)

    def _send_waiting(self, expedited: bool) -> None:
        """Send waiting bundles at the rate of the link."""
        burst = max(1, int(_BURST_S * self._pacer.rate_octets_s))
        sending = self._node.sending
        while self.up and self._contact and (expedited or self._pacer.ready):
            batch = sending.outgoing(
                self.name, burst, self._settings.bundle_octets, expedited=expedited
            )
            if not batch:
                return
            self._transmit([outgoing.octets for outgoing in batch])
            sending.mark_forwarded(batch)
            self._pacer.add_sent(sum(len(outgoing.octets) for outgoing in batch))


class UdpEndpoint(DatagramEndpoint):
    """UDP socket for bundles in datagrams, shared by all UDPCL neighbours."""

    def __init__(self, context: LinkContext, listen: Address) -> None:
        super().__init__(context, listen)
        self._links: list[tuple[UdpNeighbour, AddressLookup]] = []

    def link(self, neighbour: Neighbour) -> UdpNeighbour:
        """Return the link to a neighbour."""
        settings = neighbour.link
        assert isinstance(settings, UdpLink)
        link = UdpNeighbour(
            self._context, neighbour, settings, lambda datagrams: self._send(lookup, datagrams)
        )
        lookup = self._resolve(link, settings.address)
        self._links.append((link, lookup))
        return link

    def _receive(self, datagram: bytes, sender: SocketAddress) -> None:
        """Process a bundle; it is lost if the store is full, so senders need `confirm`."""
        if (link := self._sender(sender)) is not None:
            link.note_received()
        try:
            self._context.node.receiving.receive(link.name if link else sender[0], datagram)
        except StoreError as error:
            _LOG.warning("bundle from %s lost: %s", sender[0], error)

    def _sender(self, sender: SocketAddress) -> UdpNeighbour | None:
        """Return the sender's link. NASA ION sends from any port: match a sole link of its host."""
        there = []
        for link, lookup in self._links:
            if lookup.where == sender:
                return link
            if lookup.where is not None and lookup.where[0] == sender[0]:
                there.append(link)
        return there[0] if len(there) == 1 else None
