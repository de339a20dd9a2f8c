"""The link to a neighbour over TCPCL: dials while there is contact, and accepts connections."""

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
        """Close the sessions where contact ends, as an eclipse breaks them without notice."""
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
            connection.update()

    def close(self) -> None:
        """Close all sessions, and dial no more."""
        if self._dialling is not None:
            self._dialling.cancel()
            self._dialling = None
        for connection in list(self._sessions):
            connection.end()

    def add_session(self, connection: "Connection") -> None:
        """Use an established session; an older one of the same direction is broken."""
        for other in list(self._sessions):
            if other.dialled == connection.dialled:
                other.end()
        self._sessions.append(connection)
        self.up = True

    def remove_session(self, connection: "Connection") -> None:
        """Drop a session that is over; its unacknowledged bundles wait again."""
        if connection in self._sessions:
            self._sessions.remove(connection)
        self.up = bool(self._sessions)
        self._node.sending.requeue(self.name, connection.session.unacknowledged)
        connection.session.unacknowledged = []

    async def _dial(self, address: Address) -> None:
        """Keep dialling; the pauses grow while no session lasts longer than they do."""
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
        """Run one session; return whether the other side sent its contact header."""
        loop = asyncio.get_running_loop()
        async with asyncio.timeout(_DIAL_S):
            _, protocol = await loop.create_connection(
                self._endpoint.connection, address.host, address.port
            )
        protocol.dialled = True
        protocol.session.send_contact_header(self.settings)
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
        self._neighbour: TcpclNeighbour | None = None
        self.session = TcpclSession(context.node, self._settings_of, context.now_s, self._queue)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Start the timeout for the contact header."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        asyncio.get_running_loop().call_later(_GREETING_S, self._abort_unless_greeted)

    def data_received(self, data: bytes) -> None:
        """Take octets from the other side."""
        self.session.receive(data)
        self.update()
        if self._neighbour is not None:
            self._neighbour.heard()
        self._wake()

    def connection_lost(self, exc: Exception | None) -> None:
        """Requeue what was on its way."""
        self._transport = None
        self.session.lost()
        self.update()
        self.over.set()
        self._wake()

    def pause_writing(self) -> None:
        """Take no more."""
        self.paused = True

    def resume_writing(self) -> None:
        """Take more."""
        self.paused = False
        self._wake()

    def end(self) -> None:
        """Shut the session down."""
        self.session.end()
        self.update()

    def update(self) -> None:
        """Act on the stage of the session: register it, or close the connection."""
        stage = self.session.stage
        if stage is SessionStage.UP and self._neighbour is None and self.session.peer is not None:
            self._neighbour = self._neighbours[self.session.peer]
            self._neighbour.add_session(self)
            _LOG.info("TCPCL session with %s", self.session.peer)
        self.flush()
        if stage is SessionStage.OVER:
            if self._neighbour is not None:
                self._neighbour.remove_session(self)
            if self._transport is not None:
                self._transport.close()

    def flush(self) -> None:
        """Write what the session has queued, in one piece."""
        if self._out and self._transport is not None and not self._transport.is_closing():
            self._transport.write(b"".join(self._out))
        self._out.clear()

    def _queue(self, octets: bytes) -> None:
        if not self._out:
            asyncio.get_running_loop().call_soon(self.update)
        self._out.append(octets)

    def _settings_of(self, node: Eid) -> TcpclLink | None:
        neighbour = self._neighbours.get(node)
        return neighbour.settings if neighbour else None

    def _abort_unless_greeted(self) -> None:
        if self.session.stage is SessionStage.GREETING and self._transport is not None:
            self._transport.abort()


class TcpclEndpoint(Endpoint):
    """Dials TCPCL neighbours, and accepts their connections.

    Args:
        context: of the links.
        listen: where to accept connections; None for not at all.
    """

    def __init__(self, context: LinkContext, listen: Address | None) -> None:
        self._context, self._listen = context, listen
        self._neighbours: dict[Eid, TcpclNeighbour] = {}
        self._server: asyncio.Server | None = None

    def connection(self) -> Connection:
        """Return the protocol object for a new TCP connection."""
        return Connection(self._context, self._neighbours)

    def link(self, neighbour: Neighbour) -> TcpclNeighbour:
        """Return the link to a neighbour."""
        settings = neighbour.link
        assert isinstance(settings, TcpclLink)
        link = TcpclNeighbour(self, self._context, neighbour, settings)
        self._neighbours[neighbour.node] = link
        return link

    async def open(self) -> None:
        """Listen, if an address is given."""
        if (listen := self._listen) is not None:
            self._server = await asyncio.get_running_loop().create_server(
                self.connection, listen.host, listen.port
            )
            self.address = Address(*self._server.sockets[0].getsockname()[:2])

    async def close(self) -> None:
        """Close the listening socket."""
        if self._server is not None:
            self._server.close()
