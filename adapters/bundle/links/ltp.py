"""Link over LTP: bundles in blocks, each acknowledged once the receiver has stored it on disk."""

import logging
from collections.abc import Callable
from typing import Final

from adapters.bundle.codec.errors import DecodeError, StoreError
from adapters.bundle.links.contact import ContactState
from adapters.bundle.links.link import Link, LinkContext, Pacer
from adapters.bundle.links.ltp_engine import (
    BlockReceived,
    ExportCancelled,
    ExportCompleted,
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
from adapters.bundle.links.udp import DatagramEndpoint
from adapters.bundle.node.sending import Outgoing
from adapters.bundle.node.settings import Address, LtpLink, Neighbour, engine_of
from adapters.system import SocketAddress

_LOG: Final = logging.getLogger(__name__)
_REFUSED_PAUSE_S: Final = 1.0  # chosen, not measured
_LAST_SESSION: Final = "last LTP session"
_SESSIONS_AT_ONCE: Final = 1 << 16
_SERIALS: Final = 1 << 28
_FIRST_SESSIONS: Final = 1 << 30
_MAX_UNKNOWN_ENGINES: Final = 100
_EXPEDITED_SESSIONS: Final = 4
"""Sessions for expedited blocks, in addition to those of the settings."""


class LtpNeighbour(Link):
    """Moves bundles between a node and an LTP span; `transmit` sends the span's segments.

    Attributes:
        span: state of the protocol.
    """

    def __init__(
        self,
        context: LinkContext,
        neighbour: Neighbour,
        settings: LtpLink,
        next_number: Callable[[], int],
        transmit: Callable[[list[Segment]], None],
    ) -> None:
        super().__init__(context, neighbour)
        own, other = engine_of(context.node.settings.node), engine_of(neighbour.next_hop)

        def first_serial() -> int:
            return 1 + int.from_bytes(context.system.random_octets(4), "big") % (_SERIALS - 1)

        self.span = LtpSpan(own, other, settings, next_number, context.now_s, first_serial)
        self._settings, self._transmit = settings, transmit
        self._pacer = Pacer(context.now_s)
        self._blocks: dict[int, list[Outgoing]] = {}
        self._refusing = False
        self._cancelled = 0

    def receive(self, segment: Segment) -> None:
        """Process a segment from the neighbour."""
        self.note_received()
        self.span.receive(segment)
        for event in self.span.events:
            match event:
                case ExportCompleted():
                    self._node.sending.mark_forwarded(self._blocks.pop(event.number))
                case ExportCancelled():
                    self._cancelled += len(self._blocks[event.number])
                    self._requeue(event.number)
                case BlockReceived():
                    self._store(event)
        self.span.events.clear()
        self._flush()

    @property
    def next_s(self) -> float:
        """Monotonic time of the next protocol timer, or end of the pacer's pause."""
        return min(self.span.next_s, self._pacer.next_s)

    def on_contact(self, state: ContactState) -> None:
        """Suspend the timers of the protocol while there is no contact."""
        self.span.light_time_s = state.light_time_s
        self._pacer.rate_octets_s = state.rate_octets_s
        if state.contact == self._contact:
            return
        super().on_contact(state)
        if state.contact:
            self._pacer.reset()
            self.span.resume()
        else:
            self.span.suspend()

    def _send_waiting(self, expedited: bool) -> None:
        """Send waiting bundles in blocks."""
        settings, sending = self._settings, self._node.sending
        while (
            self.up
            and self.span.free_sessions + _EXPEDITED_SESSIONS * expedited > 0
            and not self.span.suspended
            and (expedited or self._pacer.ready)
        ):
            batch = sending.outgoing(
                self.name, settings.block_octets, settings.bundle_octets, expedited=expedited
            )
            if not batch:
                break
            block = b"".join(outgoing.octets for outgoing in batch)
            try:
                number = self.span.send(block)
            except StoreError:
                sending.requeue(self.name, batch)
                raise
            self._blocks[number] = batch
            self._pacer.add_sent(len(block))
        self._flush()

    def tick(self) -> None:
        """Retransmit unanswered segments."""
        self.span.tick()
        self._flush()

    def close(self) -> None:
        """Close; bundles of blocks in flight are requeued."""
        for number in list(self._blocks):
            self._requeue(number)

    def _requeue(self, number: int) -> None:
        self._node.sending.requeue(self.name, self._blocks.pop(number))
        self._pacer.pause(_REFUSED_PAUSE_S)

    def _store(self, arrived: BlockReceived) -> None:
        """Store a block, and report it when it is on the disk."""
        try:
            self._node.receiving.receive(self.name, arrived.block)
        except StoreError as error:
            if not self._refusing:
                _LOG.warning("blocks from %s are refused: %s", self.name, error)
            self._refusing = True
            self.span.refuse(arrived.number)
            return
        self._refusing = False

        def on_commit(failure: StoreError | None) -> None:
            if failure is None:
                self.span.mark_stored(arrived.number)
            else:
                self.span.refuse(arrived.number)
            self._flush()

        self._node.transaction.on_commit(on_commit)

    def _flush(self) -> None:
        if self.span.segments:
            segments, self.span.segments[:] = list(self.span.segments), []
            self._transmit(segments)
        self._traffic.retransmitted = self.span.resent + self._cancelled
        self._traffic.round_trip_s = self.span.round_trip_s


class LtpEndpoint(DatagramEndpoint):
    """UDP socket of the node's LTP engine, shared by all LTP neighbours."""

    def __init__(self, context: LinkContext, listen: Address) -> None:
        super().__init__(context, listen)
        self._links: dict[int, list[LtpNeighbour]] = {}
        self._unknown_engines: set[int] = set()
        self._next_session = self._end_of_sessions = 0

    def link(self, neighbour: Neighbour) -> LtpNeighbour:
        """Return the link to a neighbour."""
        settings = neighbour.link
        assert isinstance(settings, LtpLink)
        link = LtpNeighbour(
            self._context,
            neighbour,
            settings,
            self._session_number,
            lambda segments: self._send(lookup, map(encode_segment, segments)),
        )
        lookup = self._resolve(link, settings.address)
        self._links.setdefault(engine_of(neighbour.next_hop), []).append(link)
        return link

    async def open(self) -> None:
        """Start listening, with a durable reservation of session numbers."""
        try:
            self._session_number()
            self._context.node.database.sync()
        except StoreError:  # a full disk: the first bundle reserves them
            self._context.node.database.rollback()
        await super().open()

    def _session_number(self) -> int:
        """Return a session number that is never reused, even after a restart."""
        if self._next_session == self._end_of_sessions:
            database = self._context.node.database
            if not database.count(_LAST_SESSION):  # peers may remember sessions of a lost store
                chance = int.from_bytes(self._context.system.random_octets(4), "big")
                database.reserve(_LAST_SESSION, chance % _FIRST_SESSIONS)
            elif not self._next_session:  # a loss of power may have undone the last reservation
                database.reserve(_LAST_SESSION, _SESSIONS_AT_ONCE)
            self._next_session = database.reserve(_LAST_SESSION, _SESSIONS_AT_ONCE)
            self._end_of_sessions = self._next_session + _SESSIONS_AT_ONCE
        self._next_session += 1
        return self._next_session - 1

    def _receive(self, datagram: bytes, sender: SocketAddress) -> None:
        try:
            segment = decode_segment(datagram)
        except DecodeError as error:
            self.malformed += 1
            _LOG.debug("malformed segment dropped: %s", error)
            return
        if (link := self._link_of(segment)) is not None:
            link.receive(segment)

    def _link_of(self, segment: Segment) -> LtpNeighbour | None:
        """Return the link of a segment: by the engine of the block's sender, or by session."""
        session = segment.session
        by_sender = (
            isinstance(segment, Data)
            or (isinstance(segment, Cancel) and segment.by_sender)
            or (isinstance(segment, CancelAck) and not segment.of_sender)
        )
        if by_sender:
            if links := self._links.get(session.originator):
                for link in links[1:]:  # behind the same router: the sender is ambiguous
                    link.note_received()
                return links[0]
            self._log_unknown_engine(session.originator)
            return None
        for engine, links in self._links.items():
            for link in links:
                if session.originator != engine and link.span.owns(session):
                    return link
        return None

    def _log_unknown_engine(self, engine: int) -> None:
        """Log an engine that is no neighbour, once for each engine."""
        if (
            engine not in self._unknown_engines
            and len(self._unknown_engines) < _MAX_UNKNOWN_ENGINES
        ):
            self._unknown_engines.add(engine)
            _LOG.warning(
                "segments of LTP engine %d dropped: it is no neighbour. If it is a router, set via:"
                " ipn:%d.0 in the ltp of the neighbour behind it",
                *(engine, engine),
            )
