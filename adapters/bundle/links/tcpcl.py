"""The link to a neighbour over TCPCL: dials while there is contact, and takes calls."""

import asyncio
import logging
from math import inf
from typing import Final

from adapters.bundle.codec.eid import Eid
from adapters.bundle.links.contact import ContactState
from adapters.bundle.links.link import WHOLE_BUNDLES, Backoff, Endpoint, Link, LinkContext
from adapters.bundle.links.tcpcl_session import SessionStage, TcpclSession
from adapters.bundle.node.settings import Address, Neighbour, TcpclLink

_LOG: Final = logging.getLogger(__name__)
_DIAL_S: Final = 10.0
_BATCH_OCTETS: Final = 65_536
_GREETING_S: Final = 10.0


class TcpclNeighbour(Link):
    """One neighbour over TCPCL; it sends over the newest session and receives over all.

    Args:
        endpoint: makes connections.
        context: of the links.
        neighbour: to whom.
        settings: where it listens, if it does, and what is asked of its sessions.
    """

    def __init__(
        self,
        endpoint: "TcpclEndpoint",
        context: LinkContext,
        neighbour: Neighbour,
        settings: TcpclLink,
    ) -> None:
        super().__init__(context, neighbour)
        self.settings = settings
        self.up = self._contact = False
        self._endpoint = endpoint
        self._sessions: list[Connection] = []
        self._dialling: asyncio.Task[None] | None = None

    @property
    def next_s(self) -> float:
        """When a session has to be kept alive or given up."""
        return min((connection.session.next_s for connection in self._sessions), default=inf)

    def on_contact(self, state: ContactState) -> None:
        """Have sessions only while there is contact: what an eclipse breaks does not say so."""
        if state.contact == self._contact:
            return
        super().on_contact(state)
        if not self._contact:
            self.close()
        elif self.settings.address is not None:
            dial = self._dial(self.settings.address)
            self._dialling = asyncio.get_running_loop().create_task(dial)

    def pump(self) -> None:
        """Send what waits over the newest session."""
        if not self._contact or not self._sessions:
            return
        connection = self._sessions[-1]
        while connection.session.room > 0 and not connection.paused:
            octets = min(connection.session.room, _BATCH_OCTETS)
            batch = self._node.sending.outgoing(self.name, octets, WHOLE_BUNDLES)
            if not batch:
                return
            for outgoing in batch:
                connection.session.send(outgoing)
            connection.flush()

    def tick(self) -> None:
        """Keep sessions alive."""
        for connection in list(self._sessions):
            connection.session.tick()
            connection.settle()

    def close(self) -> None:
        """End all sessions, and dial no more."""
        if self._dialling is not None:
            self._dialling.cancel()
            self._dialling = None
        for connection in list(self._sessions):
            connection.hang_up()

    def joined(self, connection: "Connection") -> None:
        """Use a session that is established; an older one of the same caller is broken."""
        for other in list(self._sessions):
            if other.dialled == connection.dialled:
                other.hang_up()
        self._sessions.append(connection)
        self.up = True

    def left(self, connection: "Connection") -> None:
        """Do without a session that is over; what it did not bring waits again."""
        if connection in self._sessions:
            self._sessions.remove(connection)
        self.up = bool(self._sessions)
        self._node.sending.came_back(self.name, connection.session.came_back)
        connection.session.came_back = []

    async def _dial(self, address: Address) -> None:
        """Have a session, and another whenever it is over; pauses grow while none lasts longer."""
        where = f"{self.name} at {address.host}:{address.port}"
        backoff = Backoff(where, self.settings.redial_s)
        while True:
            begun_s = self._now_s()
            try:
                if await self._session(address) and self._now_s() - begun_s > backoff.pause_s:
                    backoff.succeeded()
                pause_s = backoff.failed()
            except OSError as error:  # a timeout is one
                pause_s = backoff.failed(error)
            await asyncio.sleep(pause_s)

    async def _session(self, address: Address) -> bool:
        """Have one session; return whether the other side greeted."""
        loop = asyncio.get_running_loop()
        async with asyncio.timeout(_DIAL_S):
            _, protocol = await loop.create_connection(
                self._endpoint.connection, address.host, address.port
            )
        protocol.dialled = True
        protocol.session.greet(self.settings)
        protocol.flush()
        await protocol.over.wait()
        return protocol.session.peer is not None


class Connection(asyncio.Protocol):
    """A TCP connection and its session.

    Args:
        context: of the links.
        neighbours: the TCPCL neighbours by their nodes.

    Attributes:
        paused: whether the connection takes no more now.
        dialled: whether it was made from here.
        over: is set when the connection is gone.
    """

    def __init__(self, context: LinkContext, neighbours: dict[Eid, TcpclNeighbour]) -> None:
        self.paused = self.dialled = False
        self.over = asyncio.Event()
        self._neighbours, self._wake = neighbours, context.wake
        self._transport: asyncio.Transport | None = None
        self._out: list[bytes] = []
        self._joined: TcpclNeighbour | None = None
        self.session = TcpclSession(context.node, self._settings_of, context.now_s, self._say)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Give a caller some time to say who it is."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        asyncio.get_running_loop().call_later(_GREETING_S, self._give_up)

    def data_received(self, data: bytes) -> None:
        """Take octets from the other side."""
        self.session.receive(data)
        self.settle()
        if self._joined is not None:
            self._joined.heard()
        self._wake()

    def connection_lost(self, exc: Exception | None) -> None:
        """Let what was on its way wait again."""
        self._transport = None
        self.session.lost()
        self.settle()
        self.over.set()
        self._wake()

    def pause_writing(self) -> None:
        """Take no more."""
        self.paused = True

    def resume_writing(self) -> None:
        """Take more."""
        self.paused = False
        self._wake()

    def hang_up(self) -> None:
        """End the session in good form."""
        self.session.end()
        self.settle()

    def settle(self) -> None:
        """Act on what has become of the session."""
        stage = self.session.stage
        if stage is SessionStage.UP and self._joined is None and self.session.peer is not None:
            self._joined = self._neighbours[self.session.peer]
            self._joined.joined(self)
            _LOG.info("TCPCL session with %s", self.session.peer)
        self.flush()
        if stage is SessionStage.OVER:
            if self._joined is not None:
                self._joined.left(self)
            if self._transport is not None:
                self._transport.close()

    def flush(self) -> None:
        """Write what the session has said, in one piece."""
        if self._out and self._transport is not None and not self._transport.is_closing():
            self._transport.write(b"".join(self._out))
        self._out.clear()

    def _say(self, octets: bytes) -> None:
        if not self._out:
            asyncio.get_running_loop().call_soon(self.settle)
        self._out.append(octets)

    def _settings_of(self, node: Eid) -> TcpclLink | None:
        neighbour = self._neighbours.get(node)
        return neighbour.settings if neighbour else None

    def _give_up(self) -> None:
        if self.session.stage is SessionStage.GREETING and self._transport is not None:
            self._transport.abort()


class TcpclEndpoint(Endpoint):
    """Dials TCPCL neighbours, and takes their calls.

    Args:
        context: of the links.
        listen: where to take calls; None for not at all.
    """

    def __init__(self, context: LinkContext, listen: Address | None) -> None:
        self._context, self._listen = context, listen
        self._neighbours: dict[Eid, TcpclNeighbour] = {}
        self._server: asyncio.Server | None = None

    def connection(self) -> Connection:
        """Return what a new TCP connection speaks with."""
        return Connection(self._context, self._neighbours)

    def link(self, neighbour: Neighbour) -> TcpclNeighbour:
        """Return the link to a neighbour."""
        settings = neighbour.link
        assert isinstance(settings, TcpclLink)
        link = TcpclNeighbour(self, self._context, neighbour, settings)
        self._neighbours[neighbour.node] = link
        return link

    async def open(self) -> None:
        """Begin to take calls."""
        if (listen := self._listen) is not None:
            self._server = await asyncio.get_running_loop().create_server(
                self.connection, listen.host, listen.port
            )
            self.address = Address(*self._server.sockets[0].getsockname()[:2])

    async def close(self) -> None:
        """Take no more calls."""
        if self._server is not None:
            self._server.close()
