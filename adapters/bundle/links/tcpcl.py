"""`TcpclNeighbour`: link over TCPCL version 3 (RFC 7242), with the sessions it opens or accepts."""

import asyncio
import logging
from collections import deque
from collections.abc import Mapping
from enum import Enum
from math import inf
from typing import Final, assert_never, cast

from adapters.bundle.codec.eid import Eid, node_of, parse_eid
from adapters.bundle.codec.errors import DecodeError, StoreError
from adapters.bundle.links.contact import ContactState
from adapters.bundle.links.link import WHOLE_BUNDLES, Backoff, Endpoint, Link, LinkContext
from adapters.bundle.links.tcpcl_messages import (
    AckSegment,
    BundleLength,
    ContactFlag,
    ContactHeader,
    DataSegment,
    Keepalive,
    Message,
    MessageReader,
    RefuseBundle,
    RefuseReason,
    Shutdown,
    encode_message,
)
from adapters.bundle.node.sending import Outgoing
from adapters.bundle.node.settings import Address, Neighbour, TcpclLink

_LOG: Final = logging.getLogger(__name__)
_DIAL_S: Final = 10.0  # as `_GREETING_S`: chosen, not measured
_BATCH_OCTETS: Final = 65_536
_GREETING_S: Final = 10.0
_MAX_BUNDLE_OCTETS: Final = 64 << 20


class SessionStage(Enum):
    """State of a session: no contact header yet, established, ended."""

    GREETING = 1
    UP = 2
    OVER = 3


class TcpclSession(asyncio.Protocol):
    """A TCP connection to a neighbour, with its session.

    The segment that ends a bundle is acknowledged when the bundle is on the disk. Without
    acknowledgements a bundle counts as handed on once it is written to the connection.

    Attributes:
        calls: neighbour that this side connects to; None for an accepted connection.
        paused: whether the connection accepts no data now.
        over: set when the connection is closed.
    """

    def __init__(
        self,
        context: LinkContext,
        neighbours: Mapping[Eid, "TcpclNeighbour"],
        calls: "TcpclNeighbour | None" = None,
    ) -> None:
        self.stage = SessionStage.GREETING
        self.calls = calls
        self.paused = False
        self.over = asyncio.Event()
        self._node, self._now_s, self._wake = context.node, context.now_s, context.wake
        self._neighbours = neighbours
        self._neighbour: TcpclNeighbour | None = None
        self._transport: asyncio.Transport | None = None
        self._out: list[bytes] = []
        self._reader = MessageReader(_MAX_BUNDLE_OCTETS)
        self._acknowledged = self._may_refuse = False
        self._keepalive_s = 0.0
        self._last_received_s = self._last_sent_s = self._now_s()
        self._incoming = bytearray()
        self._in_flight: deque[tuple[Outgoing, float]] = deque()
        self._in_flight_octets = 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Send the contact header if this side has connected, and wait for the peer's."""
        self._transport = cast("asyncio.Transport", transport)
        asyncio.get_running_loop().call_later(_GREETING_S, self._abort_unless_greeted)
        if self.calls is not None:
            self._send_contact_header(self.calls.settings)
            self.flush()

    def data_received(self, data: bytes) -> None:
        """Process received octets."""
        self._last_received_s = self._now_s()
        try:
            for message in self._reader.feed(data):
                if self.stage is not SessionStage.OVER:
                    self._receive(message)
        except DecodeError as error:
            self._end(str(error))
        if self._neighbour is not None:
            self._neighbour.note_received()
        self.flush()
        self._wake()

    def connection_lost(self, exc: Exception | None) -> None:
        """Requeue bundles in flight."""
        self._transport = None
        self._leave()
        self.over.set()
        self._wake()

    def pause_writing(self) -> None:
        """Stop sending: the write buffer is full."""
        self.paused = True

    def resume_writing(self) -> None:
        """Continue sending."""
        self.paused = False
        self._wake()

    @property
    def established(self) -> bool:
        """Whether contact headers were exchanged, even if the session has ended since."""
        return self._neighbour is not None

    @property
    def window_left_octets(self) -> int:
        """Octets that the window accepts now."""
        if self.stage is not SessionStage.UP or self._neighbour is None:
            return 0
        return self._neighbour.settings.window_octets - self._in_flight_octets

    def send(self, outgoing: Outgoing, segment_octets: int) -> None:
        """Queue the segments of a bundle; `flush` writes them."""
        octets = outgoing.octets
        for at in range(0, len(octets), segment_octets):
            end = at + segment_octets >= len(octets)
            self._send(DataSegment(octets[at : at + segment_octets], start=not at, end=end))
        if self._acknowledged:
            self._in_flight.append((outgoing, self._now_s()))
            self._in_flight_octets += len(octets)
        else:
            self._node.sending.mark_forwarded([outgoing])

    def flush(self) -> None:
        """Write the queued messages in one call."""
        if self._out and self._transport is not None and not self._transport.is_closing():
            self._transport.write(b"".join(self._out))
        self._out.clear()

    @property
    def next_s(self) -> float:
        """Monotonic due time of `tick`; infinity for never."""
        if not self._keepalive_s or self.stage is not SessionStage.UP:
            return inf
        next_keepalive_s = self._last_sent_s + self._keepalive_s
        return min(next_keepalive_s, self._last_received_s + 2 * self._keepalive_s)

    def tick(self) -> None:
        """Send a keepalive, or end a session without reception."""
        now_s = self._now_s()
        if not self._keepalive_s or self.stage is not SessionStage.UP:
            return
        if now_s >= self._last_received_s + 2 * self._keepalive_s:
            self._end("nothing received for two keepalive intervals")
        elif now_s >= self._last_sent_s + self._keepalive_s:
            self._send(Keepalive())
            self.flush()

    def end(self) -> None:
        """Shut the session down; unacknowledged bundles are requeued."""
        if self.stage is not SessionStage.OVER:
            if self.calls is not None or self._neighbour is not None:
                self._send(Shutdown())
            self._leave()

    def _abort_unless_greeted(self) -> None:
        if self.stage is SessionStage.GREETING and self._transport is not None:
            self._transport.abort()

    def _end(self, why: str) -> None:
        peer = self._neighbour or self.calls
        _LOG.warning("TCPCL session with %s ended: %s", peer and peer.name, why)
        self.end()

    def _leave(self) -> None:
        """Mark the session as ended, and close the connection."""
        self.stage = SessionStage.OVER
        self._incoming.clear()
        if self._neighbour is not None:
            self._neighbour.remove_session(self, [outgoing for outgoing, _ in self._in_flight])
        self._in_flight.clear()
        self.flush()
        if self._transport is not None:
            self._transport.close()

    def _receive(self, message: Message) -> None:
        match message:
            case ContactHeader():
                self._receive_header(message)
            case DataSegment():
                self._receive_segment(message)
            case AckSegment():
                self._on_ack(message.length)
            case RefuseBundle():
                if self._in_flight:
                    self.end()
            case Shutdown():
                self.end()
            case Keepalive() | BundleLength():
                pass
            case _:
                assert_never(message)

    def _receive_header(self, header: ContactHeader) -> None:
        try:
            peer = node_of(parse_eid(header.eid))
        except ValueError as error:
            raise DecodeError("contact header has no endpoint") from error
        if (neighbour := self._neighbours.get(peer)) is None:
            raise DecodeError(f"{peer} is not a neighbour")
        link = neighbour.settings
        if link.acknowledge and not header.flags & ContactFlag.ACKNOWLEDGE:
            raise DecodeError("the peer does not acknowledge: set acknowledge: false here, too")
        if self.calls is None:
            self._send_contact_header(link)
        self._acknowledged = link.acknowledge
        self._may_refuse = link.acknowledge and bool(header.flags & ContactFlag.REFUSE)
        self._keepalive_s = float(min(link.keepalive_s, header.keepalive_s))
        self.stage, self._neighbour = SessionStage.UP, neighbour
        neighbour.add_session(self)
        _LOG.info("TCPCL session with %s", peer)

    def _send_contact_header(self, link: TcpclLink) -> None:
        """Send node EID and flags; refusal needs acknowledgements (RFC 7242, 4.1)."""
        flags = int(ContactFlag.ACKNOWLEDGE | ContactFlag.REFUSE) if link.acknowledge else 0
        self._send(ContactHeader(flags, link.keepalive_s, str(self._node.settings.node)))

    def _receive_segment(self, segment: DataSegment) -> None:
        if segment.start:
            self._incoming.clear()
        self._incoming += segment.octets
        if len(self._incoming) > _MAX_BUNDLE_OCTETS:
            raise DecodeError("bundle exceeds the maximum length")
        length = len(self._incoming)
        if not segment.end:
            # Keeps the order with acknowledgements of complete bundles, which await their commit.
            self._node.transaction.on_commit(lambda _: self._send_ack(length))
            return
        octets = bytes(self._incoming)
        self._incoming.clear()
        assert self._neighbour is not None
        try:
            self._node.receiving.receive(self._neighbour.name, octets)
        except StoreError as error:
            _LOG.debug("bundle from %s refused: %s", self._neighbour.name, error)
            self._node.transaction.on_commit(lambda _: self._refuse())
            return
        self._node.transaction.on_commit(
            lambda failure: self._refuse() if failure else self._send_ack(length)
        )

    def _send_ack(self, length: int) -> None:
        if self._acknowledged and self.stage is SessionStage.UP:
            self._send(AckSegment(length))

    def _refuse(self) -> None:
        """Refuse a bundle; a peer without support of refusals loses the session and retries."""
        if self.stage is SessionStage.UP:
            if self._may_refuse:
                self._send(RefuseBundle(RefuseReason.NO_RESOURCES))
            self.end()

    def _on_ack(self, length: int) -> None:
        if not self._in_flight:
            raise DecodeError("acknowledgement although no bundle is in flight")
        outgoing, sent_s = self._in_flight[0]
        expected = len(outgoing.octets)
        if length > expected:
            raise DecodeError(f"{length} octets acknowledged, {expected} sent")
        if length == expected:
            self._in_flight_octets -= expected
            self._in_flight.popleft()
            assert self._neighbour is not None
            self._neighbour.record_round_trip(self._now_s() - sent_s)
            self._node.sending.mark_forwarded([outgoing])

    def _send(self, message: Message) -> None:
        self._last_sent_s = self._now_s()
        self._out.append(encode_message(message))


class TcpclNeighbour(Link):
    """Link to one TCPCL neighbour; it sends over the newest session and receives over all.

    Attributes:
        settings: its listen address, if it has one, and parameters of the sessions.
    """

    def __init__(
        self,
        context: LinkContext,
        neighbour: Neighbour,
        neighbours: Mapping[Eid, "TcpclNeighbour"],
    ) -> None:
        super().__init__(context, neighbour)
        assert isinstance(neighbour.link, TcpclLink)
        self.settings = neighbour.link
        self.up = self._contact = False
        self._context, self._neighbours = context, neighbours
        self._sessions: list[TcpclSession] = []
        self._dialling: asyncio.Task[None] | None = None

    @property
    def next_s(self) -> float:
        """Monotonic due time of the next keepalive or session timeout."""
        return min((session.next_s for session in self._sessions), default=inf)

    def on_contact(self, state: ContactState) -> None:
        """Close the sessions when contact ends, because an outage breaks them unnoticed."""
        if state.contact == self._contact:
            return
        super().on_contact(state)
        if not self._contact:
            self.close()
        elif self.settings.address is not None:
            dial = self._dial(self.settings.address)
            self._dialling = asyncio.get_running_loop().create_task(dial)

    def _send_waiting(self, expedited: bool) -> None:
        """Send acknowledgements on all sessions, and waiting bundles over the newest."""
        for session in self._sessions:
            session.flush()
        if not self._contact or not self._sessions:
            return
        session = self._sessions[-1]
        while expedited or (session.window_left_octets > 0 and not session.paused):
            octets = min(max(1, session.window_left_octets), _BATCH_OCTETS)
            batch = self._node.sending.outgoing(
                self.name, octets, WHOLE_BUNDLES, expedited=expedited
            )
            if not batch:
                return
            for outgoing in batch:
                session.send(outgoing, self.settings.segment_octets)
            session.flush()

    def tick(self) -> None:
        """Run the timers of the sessions."""
        for session in list(self._sessions):
            session.tick()

    def close(self) -> None:
        """Close all sessions, and stop connecting."""
        if self._dialling is not None:
            self._dialling.cancel()
            self._dialling = None
        for session in list(self._sessions):
            session.end()

    def add_session(self, session: TcpclSession) -> None:
        """Use an established session; an older one of the same direction is broken."""
        for other in list(self._sessions):
            if other.calls is session.calls:
                other.end()
        self._sessions.append(session)
        self.up = True

    def remove_session(self, session: TcpclSession, unacknowledged: list[Outgoing]) -> None:
        """Remove a session that has ended, and requeue its unacknowledged bundles."""
        if session in self._sessions:
            self._sessions.remove(session)
        self.up = bool(self._sessions)
        self._traffic.retransmitted += len(unacknowledged)
        self._node.sending.requeue(self.name, unacknowledged)

    def record_round_trip(self, round_trip_s: float) -> None:
        """Record the time that the neighbour took to acknowledge a bundle."""
        self._traffic.round_trip_s = round_trip_s

    async def _dial(self, address: Address) -> None:
        """Connect repeatedly; pauses grow until a session lasts longer than the pause."""
        where = f"{self.name} at {address.host}:{address.port}"
        backoff = Backoff(where, self.settings.redial_s)
        while True:
            begun_s = self._now_s()
            try:
                if await self._call(address) and self._now_s() - begun_s > backoff.pause_s:
                    backoff.reset()
                pause_s = backoff.next_pause_s()
            except OSError as error:  # a timeout is one
                pause_s = backoff.next_pause_s(error)
            await asyncio.sleep(pause_s)

    async def _call(self, address: Address) -> bool:
        """Run one session; return whether it was established."""
        loop = asyncio.get_running_loop()
        async with asyncio.timeout(_DIAL_S):
            _, session = await loop.create_connection(
                lambda: TcpclSession(self._context, self._neighbours, self),
                address.host,
                address.port,
            )
        await session.over.wait()
        return session.established


class TcpclEndpoint(Endpoint):
    """Creates the links to TCPCL neighbours, and accepts their connections."""

    def __init__(self, context: LinkContext, listen: Address | None) -> None:
        self._context, self._listen = context, listen
        self._neighbours: dict[Eid, TcpclNeighbour] = {}
        self._server: asyncio.Server | None = None

    def link(self, neighbour: Neighbour) -> TcpclNeighbour:
        """Return the link to a neighbour."""
        link = TcpclNeighbour(self._context, neighbour, self._neighbours)
        self._neighbours[neighbour.node] = link
        return link

    async def open(self) -> None:
        """Start listening, if an address is set."""
        if (listen := self._listen) is not None:
            self._server = await asyncio.get_running_loop().create_server(
                lambda: TcpclSession(self._context, self._neighbours), listen.host, listen.port
            )
            self.address = Address(*self._server.sockets[0].getsockname()[:2])

    async def close(self) -> None:
        """Close the listening socket."""
        if self._server is not None:
            self._server.close()
