"""The links of an agent and the sockets they share."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final, Self, assert_never

from adapters.bundle.attached.daemon import Daemon
from adapters.bundle.attached.link import Attachment, DaemonNeighbour
from adapters.bundle.eid import Eid
from adapters.bundle.errors import BundleError
from adapters.bundle.link import Link
from adapters.bundle.ltp_endpoint import LtpEndpoint
from adapters.bundle.ltp_link import LtpNeighbour
from adapters.bundle.node import Node
from adapters.bundle.settings import (
    Address,
    DaemonLink,
    LtpLink,
    Neighbour,
    TcpclLink,
    UdpLink,
    engine_of,
)
from adapters.bundle.target import Target, Where
from adapters.bundle.tcpcl_link import TcpclNeighbour, connection_factory
from adapters.bundle.udp_link import UdpEndpoint, UdpNeighbour

_SESSIONS: Final = "last LTP session"
_SESSIONS_AT_ONCE: Final = 1 << 16


@dataclass(frozen=True, slots=True)
class Listen:
    """Where an agent listens for each protocol; None for not at all.

    LTP and UDP send from where they listen, so that their neighbours need an address here.
    """

    ltp: Address | None = None
    tcpcl: Address | None = None
    udp: Address | None = None


NOWHERE: Final = Listen()


class Links:
    """All links of an agent.

    Attributes:
        by_name: the links by the names of their neighbours.
        listens: where they listen, with the ports that were free.
    """

    def __init__(
        self, node: Node, listen: Listen, wake: Callable[[], None], daemon: Daemon | None
    ) -> None:
        """Make nothing yet; see `open`."""
        self.by_name: dict[str, Link] = {}
        self.listens = listen
        self._node, self._wake, self._daemon = node, wake, daemon
        self._ltp: LtpEndpoint | None = None
        self._engines: dict[int, LtpNeighbour] = {}
        self._callers: dict[Eid, TcpclNeighbour] = {}
        self._server: asyncio.Server | None = None
        self._udp: asyncio.DatagramTransport | None = None
        self._udp_neighbours: dict[Where, UdpNeighbour] = {}
        self._targets: list[Target] = []
        self._numbers = _Numbers(node)

    @classmethod
    async def open(
        cls, node: Node, listen: Listen, wake: Callable[[], None], daemon: Daemon | None = None
    ) -> Self:
        """Open the sockets and the links to all neighbours of a node.

        Raises:
            OSError: a socket cannot be had.
            BundleError: a neighbour speaks a protocol for which the agent does not listen, or the
                daemon cannot be used.
        """
        links = cls(node, listen, wake, daemon)
        try:
            await links._open_sockets(listen)
            for neighbour in node.settings.neighbours:
                links.by_name[neighbour.name] = links._link(neighbour)
            await links._attach()
        except BaseException:
            await links.close()
            raise
        if links._ltp is not None:
            links._ltp.start(links._engines)
        return links

    @property
    def malformed(self) -> int:
        """How many datagrams were no LTP segments."""
        return 0 if self._ltp is None else self._ltp.malformed

    async def close(self) -> None:
        """End all links and close the sockets; a daemon may say first what it has taken."""
        if self._daemon is not None:
            await self._daemon.close()
        for target in self._targets:
            target.close()
        for link in self.by_name.values():
            link.close()
        if self._ltp is not None:
            self._ltp.close()
        if self._server is not None:
            self._server.close()
        if self._udp is not None:
            self._udp.close()

    async def _open_sockets(self, listen: Listen) -> None:
        loop = asyncio.get_running_loop()
        ltp, tcpcl, udp = listen.ltp, listen.tcpcl, listen.udp
        if ltp is not None:
            self._ltp = LtpEndpoint(ltp, self._wake)
            ltp = self._ltp.address
        if tcpcl is not None:
            connect = connection_factory(self._node, self._callers, loop.time, self._wake)
            self._server = await loop.create_server(connect, tcpcl.host, tcpcl.port)
            tcpcl = Address(*self._server.sockets[0].getsockname()[:2])
        if udp is not None:
            endpoint = UdpEndpoint(self._node, self._udp_neighbours, self._wake)
            self._udp, _ = await loop.create_datagram_endpoint(
                lambda: endpoint, local_addr=(udp.host, udp.port)
            )
            udp = Address(*self._udp.get_extra_info("sockname")[:2])
        self.listens = Listen(ltp, tcpcl, udp)

    async def _attach(self) -> None:
        if (daemon := self._daemon) is None:
            return
        neighbours = {
            name: link for name, link in self.by_name.items() if isinstance(link, DaemonNeighbour)
        }
        now_s = asyncio.get_running_loop().time
        attachment = Attachment(self._node, neighbours, now_s, self._wake)
        await daemon.open(attachment.hear, self._wake)

    def _link(self, neighbour: Neighbour) -> Link:
        link, now_s = neighbour.link, asyncio.get_running_loop().time
        match link:
            case LtpLink():
                if (endpoint := self._ltp) is None:
                    raise BundleError(f"{neighbour.name} is reached by LTP: listen for it")
                target = Target(neighbour.name, link.address, endpoint.family)
                ltp = LtpNeighbour(
                    self._node, neighbour, link, self._numbers.next, now_s,
                    partial(endpoint.transmit, target),
                )  # fmt: skip
                self._engines[engine_of(neighbour.node)] = ltp
                self._find(target, ltp, lambda _: None)
                return ltp
            case TcpclLink():
                connect = connection_factory(self._node, self._callers, now_s, self._wake)
                tcpcl = TcpclNeighbour(self._node, neighbour, link, now_s, connect)
                self._callers[neighbour.node] = tcpcl
                return tcpcl
            case UdpLink():
                if (transport := self._udp) is None:
                    raise BundleError(f"{neighbour.name} is reached by UDP: listen for it")
                family = transport.get_extra_info("socket").family
                target = Target(neighbour.name, link.address, family)
                udp = UdpNeighbour(
                    self._node, neighbour, link, now_s,
                    lambda octets: transport.sendto(octets, target.where),
                )  # fmt: skip
                self._find(target, udp, lambda where: self._udp_neighbours.update({where: udp}))
                return udp
            case DaemonLink():
                if (daemon := self._daemon) is None:
                    raise BundleError(f"{neighbour.name} is reached by a daemon: attach to one")
                return DaemonNeighbour(self._node, neighbour, link, daemon, now_s, self._wake)
            case _:
                assert_never(link)

    def _find(
        self, target: Target, link: LtpNeighbour | UdpNeighbour, tell: Callable[[Where], None]
    ) -> None:
        """Have a link up from when it is known where it leads."""

        def found(where: Where) -> None:
            tell(where)
            link.up = True
            self._wake()

        link.up = False
        self._targets.append(target)
        target.find(found)


class _Numbers:
    """LTP session numbers that no start of the agent gives again."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._next = self._end = 0

    def next(self) -> int:
        if self._next == self._end:
            self._next = self._node.database.reserve(_SESSIONS, _SESSIONS_AT_ONCE)
            self._end = self._next + _SESSIONS_AT_ONCE
        self._next += 1
        return self._next - 1
