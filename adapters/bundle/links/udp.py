"""UDP sockets with the lookup of addresses, and the link over UDPCL (RFC 7122)."""

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
LOOKUP_AGAIN_S: Final = 1.0
"""The shortest pause before a name that is not found is looked up again; it doubles up to 30 s."""
_AT_ONCE: Final = 16
_MOST_WAITING_OCTETS: Final = 16 << 20
_BUFFER_OCTETS: Final = 4 << 20
_LONGEST_DATAGRAM: Final = 65_536
_BURST_S: Final = 0.02


class AddressLookup:
    """The lookup of a neighbour's address, off the loop, repeated until it succeeds.

    `found` is called as soon as it is known, at once where the address is in numbers.

    Attributes:
        where: its host in numbers, and its port; None while that is not known.
    """

    def __init__(
        self, name: str, address: Address, family: socket.AddressFamily, found: Callable[[], None]
    ) -> None:
        self._address, self._family, self._found = address, family, found
        self._backoff = Backoff(f"{name} at {address.host}", LOOKUP_AGAIN_S)
        self._looking: asyncio.Task[None] | None = None
        self.where: SocketAddress | None = None
        try:
            answer = socket.getaddrinfo(
                address.host, address.port, family, socket.SOCK_DGRAM, 0, socket.AI_NUMERICHOST
            )
        except OSError:
            self._looking = asyncio.get_running_loop().create_task(self._look())
        else:
            self._know(answer[0][4])

    def close(self) -> None:
        """Cancel the lookup."""
        if self._looking is not None:
            self._looking.cancel()

    async def _look(self) -> None:
        loop, address = asyncio.get_running_loop(), self._address
        while self.where is None:
            try:
                answer = await loop.getaddrinfo(
                    address.host, address.port, family=self._family, type=socket.SOCK_DGRAM
                )
                self._know(answer[0][4])
            except OSError as error:
                await asyncio.sleep(self._backoff.failed(error))

    def _know(self, found: tuple[str, int] | tuple[str, int, int, int] | tuple[int, bytes]) -> None:
        host, port = found[:2]
        self.where = str(host), int(port)
        self._found()


class DatagramEndpoint(Endpoint):
    """A UDP socket for all neighbours over one protocol; port 0 takes a free one.

    Raises:
        OSError: the address cannot be had.
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
        """Handle a datagram."""

    async def open(self) -> None:
        """Begin to listen."""
        asyncio.get_running_loop().add_reader(self._socket, self._readable)

    async def close(self) -> None:
        """Cancel the lookups, and close the socket."""
        for lookup in self._lookups:
            lookup.close()
        if self._working is not None:
            self._working.cancel()
        asyncio.get_running_loop().remove_reader(self._socket)
        self._socket.close()

    def _look_up(self, link: Link, address: Address) -> AddressLookup:
        """Look up the address of a link, which is up from when it is known."""

        def found() -> None:
            link.up = True
            self._context.wake()

        link.up = False
        lookup = AddressLookup(link.name, address, self._family, found)
        self._lookups.append(lookup)
        return lookup

    def _send(self, lookup: AddressLookup, datagrams: Iterable[bytes]) -> None:
        """Send datagrams; what the socket does not take now is lost."""
        if lookup.where is None:
            return
        for datagram in datagrams:
            try:
                self._socket.sendto(datagram, lookup.where)
            except OSError as error:
                _LOG.debug("datagram to %s not sent: %s", lookup.where, error)
                return

    def _readable(self) -> None:
        """Empty the socket, whose buffer the system keeps short, before anything is handled."""
        while self._waiting_octets < _MOST_WAITING_OCTETS:
            try:
                datagram, sender = self._socket.recvfrom(_LONGEST_DATAGRAM)
            except BlockingIOError:
                break
            except OSError as error:
                # An ICMP message about a datagram of ours; the next read goes on.
                _LOG.debug("UDP socket: %s", error)
                continue
            self._waiting.append((datagram, sender[:2]))
            self._waiting_octets += len(datagram)
        if self._working is None:
            self._work()

    def _work(self) -> None:
        """Handle some datagrams, and let others have the loop before the next."""
        for _ in range(min(_AT_ONCE, len(self._waiting))):
            datagram, sender = self._waiting.popleft()
            self._waiting_octets -= len(datagram)
            self._receive(datagram, sender)
        self._working = asyncio.get_running_loop().call_soon(self._work) if self._waiting else None
        self._context.wake()


class UdpNeighbour(Link):
    """Sends bundles without acknowledgement: reliability needs `confirm`, end to end."""

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
        """When the link takes more."""
        return self._pacer.next_s

    def on_contact(self, state: ContactState) -> None:
        """Send only while there is contact, and no more than it takes."""
        super().on_contact(state)
        self._pacer.rate_octets_s = min(self._settings.rate_octets_s, state.rate_octets_s)

    def _send_waiting(self, expedited: bool) -> None:
        """Send what waits, as fast as the link takes it."""
        burst = max(1, int(_BURST_S * self._pacer.rate_octets_s))
        sending = self._node.sending
        while self.up and self._contact and (expedited or self._pacer.ready):
            batch = sending.outgoing(
                self.name, burst, self._settings.bundle_octets, expedited=expedited
            )
            if not batch:
                return
            self._transmit([outgoing.octets for outgoing in batch])
            sending.handed_on(batch)
            self._pacer.sent(sum(len(outgoing.octets) for outgoing in batch))


class UdpEndpoint(DatagramEndpoint):
    """The socket for bundles in datagrams, of whichever neighbour."""

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
        lookup = self._look_up(link, settings.address)
        self._links.append((link, lookup))
        return link

    def _receive(self, datagram: bytes, sender: SocketAddress) -> None:
        """Take a bundle in; it is lost if there is no room, so the sender has to use `confirm`."""
        if (link := self._sender(sender)) is not None:
            link.heard()
        try:
            self._context.node.receiving.arrived(link.name if link else sender[0], datagram)
        except StoreError as error:
            _LOG.warning("bundle from %s lost: %s", sender[0], error)

    def _sender(self, sender: SocketAddress) -> UdpNeighbour | None:
        """Find the sender; NASA ION, which sends from any port, has to be alone on its host."""
        there = []
        for link, lookup in self._links:
            if lookup.where == sender:
                return link
            if lookup.where is not None and lookup.where[0] == sender[0]:
                there.append(link)
        return there[0] if len(there) == 1 else None
