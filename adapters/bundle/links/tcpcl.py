"""The link to a neighbour over TCPCL: dials while there is contact, and takes calls."""

import asyncio
import logging
from collections.abc import Callable
from functools import partial
from typing import Final

from adapters.bundle.codec.eid import Eid
from adapters.bundle.links.contact import ContactState
from adapters.bundle.links.link import Backoff
from adapters.bundle.links.tcpcl_session import SessionStage, TcpclSession
from adapters.bundle.node.node import Node
from adapters.bundle.node.settings import Address, Neighbour, TcpclLink

_LOG = logging.getLogger(__name__)
_DIAL_S: Final = 10.0
_BATCH_OCTETS: Final = 65_536
_UNCUT_OCTETS: Final = 1 << 62
_GREETING_S: Final = 10.0


class TcpclNeighbour:
    """One neighbour over TCPCL; it sends over the newest session and receives over all."""

    def __init__(
        self,
        node: Node,
        neighbour: Neighbour,
        link: TcpclLink,
        now_s: Callable[[], float],
        connect: Callable[[], asyncio.Protocol],
    ) -> None:
        """Begin without a session and without contact."""
        self.link = link
        self.last_heard_s: float | None = None
        self._node, self._name, self._now_s = node, neighbour.name, now_s
        self._connect = connect
        self._sessions: list[Connection] = []
        self._contact = False
        self._dialling: asyncio.Task[None] | None = None

    @property
    def up(self) -> bool:
        """Whether there is a session."""
        return bool(self._sessions)

    @property
    def next_s(self) -> float | None:
        """When a session has to be kept alive or given up."""
        times_s = [connection.session.next_s for connection in self._sessions]
        return min((time_s for time_s in times_s if time_s is not None), default=None)

    def heed(self, outlook: ContactState) -> None:
        """Have sessions only while there is contact: what an eclipse breaks does not say so."""
        if outlook.contact == self._contact:
            return
        self._contact = outlook.contact
        if not self._contact:
            self.close()
        elif self.link.address is not None:
            dial = self._dial(self.link.address)
            self._dialling = asyncio.get_running_loop().create_task(dial)

    def pump(self) -> None:
        """Send what waits over the newest session."""
        if not self._contact or not self._sessions:
            return
        connection = self._sessions[-1]
        while connection.session.room > 0 and not connection.paused:
            octets = min(connection.session.room, _BATCH_OCTETS)
            batch = self._node.sending.outgoing(self._name, octets, _UNCUT_OCTETS)
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

    def heard(self) -> None:
        """Note that something came."""
        self.last_heard_s = self._now_s()

    def left(self, connection: "Connection") -> None:
        """Do without a session that is over; what it did not bring waits again."""
        if connection in self._sessions:
            self._sessions.remove(connection)
        self._node.sending.came_back(self._name, connection.session.came_back)
        connection.session.came_back = []

    async def _dial(self, address: Address) -> None:
        """Have a session, and another whenever it is over; pauses grow while none lasts longer."""
        where = f"{self._name} at {address.host}:{address.port}"
        backoff = Backoff(where, self.link.redial_s)
        while True:
            begun_s = self._now_s()
            try:
                if await self._session(address) and self._now_s() - begun_s > backoff.pause_s:
                    backoff.went_well()
                pause_s = backoff.next_pause_s()
            except OSError as error:  # a timeout is one
                pause_s = backoff.failed(error)
            await asyncio.sleep(pause_s)

    async def _session(self, address: Address) -> bool:
        """Have one session; return whether the other side greeted."""
        loop = asyncio.get_running_loop()
        async with asyncio.timeout(_DIAL_S):
            _, protocol = await loop.create_connection(self._connect, address.host, address.port)
        assert isinstance(protocol, Connection)
        protocol.dialled = True
        protocol.session.greet(self.link)
        protocol.flush()
        await protocol.over.wait()
        return protocol.session.peer is not None


class Connection(asyncio.Protocol):
    """A TCP connection and its session.

    Args:
        node: whose bundles.
        neighbours: the TCPCL neighbours by their nodes.
        now_s: monotonic time.
        wake: is called when something has come.

    Attributes:
        paused: whether the connection takes no more now.
        dialled: whether it was made from here.
        over: is set when the connection is gone.
    """

    def __init__(
        self,
        node: Node,
        neighbours: dict[Eid, TcpclNeighbour],
        now_s: Callable[[], float],
        wake: Callable[[], None],
    ) -> None:
        """Wait to be connected."""
        self.paused = self.dialled = False
        self.over = asyncio.Event()
        self._neighbours, self._wake = neighbours, wake
        self._transport: asyncio.Transport | None = None
        self._out: list[bytes] = []
        self._joined: TcpclNeighbour | None = None
        self.session = TcpclSession(node, self._know, now_s, self._say)

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

    def _know(self, node: Eid) -> TcpclLink | None:
        neighbour = self._neighbours.get(node)
        return neighbour.link if neighbour else None

    def _give_up(self) -> None:
        if self.session.stage is SessionStage.GREETING and self._transport is not None:
            self._transport.abort()


def connection_factory(
    node: Node,
    neighbours: dict[Eid, TcpclNeighbour],
    now_s: Callable[[], float],
    wake: Callable[[], None],
) -> Callable[[], Connection]:
    """Return what makes connections, for those who dial and for those who are called."""
    return partial(Connection, node, neighbours, now_s, wake)
