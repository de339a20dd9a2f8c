"""One TCPCL session (RFC 7242), fed with octets and time, without its socket."""

import logging
from collections import deque
from collections.abc import Callable
from enum import Enum
from typing import Final, assert_never

from adapters.bundle.eid import Eid, node_of, parse_eid
from adapters.bundle.errors import DecodeError, StoreError
from adapters.bundle.node import Node
from adapters.bundle.sending import Outgoing
from adapters.bundle.settings import TcpclLink
from adapters.bundle.tcpcl_message import (
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

_LOG = logging.getLogger(__name__)
_MOST_BUNDLE_OCTETS: Final = 64 << 20


class Stage(Enum):
    """How far a session has come: no contact header yet, established, over."""

    GREETING = 1
    UP = 2
    OVER = 3


class TcpclSession:
    """Moves bundles between a node and one TCP connection.

    A segment that ends a bundle is acknowledged when the bundle is on the disk. Without
    acknowledgements a bundle counts as handed on when it was written to the connection.

    Args:
        node: whose bundles.
        know: gives the link to a node, if it may come here at all.
        now_s: monotonic time.
        write: takes octets for the other side.

    Attributes:
        stage: how far it has come; whoever has the connection closes it when it is OVER.
        peer: the other node, when it has said who it is.
        last_heard_s: when something came, in monotonic time.
        came_back: what was not acknowledged; whoever queues it again empties it.
    """

    def __init__(
        self,
        node: Node,
        know: Callable[[Eid], TcpclLink | None],
        now_s: Callable[[], float],
        write: Callable[[bytes], None],
    ) -> None:
        """Wait for the other side's contact header."""
        self.stage = Stage.GREETING
        self.peer: Eid | None = None
        self.last_heard_s = now_s()
        self._node, self._know, self._now_s, self._write = node, know, now_s, write
        self._reader = MessageReader(_MOST_BUNDLE_OCTETS)
        self._greeted: TcpclLink | None = None
        self._acknowledged = self._may_refuse = False
        self._keepalive_s = 0.0
        self._said_s = now_s()
        self._coming = bytearray()
        self._in_flight: deque[Outgoing] = deque()
        self._in_flight_octets = 0
        self.came_back: list[Outgoing] = []

    def greet(self, link: TcpclLink) -> None:
        """Say who we are, and what we ask for."""
        self._greeted = link
        flags = ContactFlag.REFUSE | (ContactFlag.ACKNOWLEDGE if link.acknowledge else 0)
        self._say(ContactHeader(int(flags), link.keepalive_s, str(self._node.settings.node)))

    @property
    def room(self) -> int:
        """How many more octets it takes now."""
        if self.stage is not Stage.UP or self._greeted is None:
            return 0
        return self._greeted.window_octets - self._in_flight_octets

    def send(self, outgoing: Outgoing) -> None:
        """Send a bundle."""
        assert self._greeted is not None
        size = self._greeted.segment_octets
        octets = outgoing.octets
        for at in range(0, len(octets), size):
            end = at + size >= len(octets)
            self._say(DataSegment(octets[at : at + size], start=not at, end=end))
        if self._acknowledged:
            self._in_flight.append(outgoing)
            self._in_flight_octets += len(octets)
        else:
            self._node.sending.handed_on([outgoing])

    def receive(self, octets: bytes) -> None:
        """Take octets from the connection."""
        self.last_heard_s = self._now_s()
        try:
            for message in self._reader.feed(octets):
                if self.stage is not Stage.OVER:
                    self._heed(message)
        except DecodeError as error:
            _LOG.warning("TCPCL session with %s ended: %s", self.peer, error)
            self.end()

    @property
    def next_s(self) -> float | None:
        """When `tick` has something to do, if ever."""
        if not self._keepalive_s or self.stage is not Stage.UP:
            return None
        said_s = self._said_s + self._keepalive_s
        return min(said_s, self.last_heard_s + 2 * self._keepalive_s)

    def tick(self) -> None:
        """Keep the session alive, or give it up."""
        now_s = self._now_s()
        if not self._keepalive_s or self.stage is not Stage.UP:
            return
        if now_s >= self.last_heard_s + 2 * self._keepalive_s:
            _LOG.warning("TCPCL session with %s ended: nothing heard", self.peer)
            self.end()
        elif now_s >= self._said_s + self._keepalive_s:
            self._say(Keepalive())

    def end(self) -> None:
        """End the session in good form; what was not acknowledged comes back."""
        if self.stage is not Stage.OVER:
            if self._greeted is not None:
                self._say(Shutdown())
            self.lost()

    def lost(self) -> None:
        """Note that the connection is gone."""
        self.stage = Stage.OVER
        self.came_back += self._in_flight
        self._in_flight.clear()
        self._coming.clear()

    def _heed(self, message: Message) -> None:
        match message:
            case ContactHeader():
                self._greeted_by(message)
            case DataSegment():
                self._take(message)
            case AckSegment():
                self._acked(message.length)
            case RefuseBundle():
                if self._in_flight:
                    self.came_back.append(self._in_flight.popleft())
                    self.end()
            case Shutdown():
                self.end()
            case Keepalive() | BundleLength():
                pass
            case _:
                assert_never(message)

    def _greeted_by(self, header: ContactHeader) -> None:
        try:
            self.peer = node_of(parse_eid(header.eid))
        except ValueError as error:
            raise DecodeError("contact header without an endpoint") from error
        link = self._know(self.peer)
        if link is None:
            raise DecodeError(f"{self.peer} is no neighbour")
        if link.acknowledge and not header.flags & ContactFlag.ACKNOWLEDGE:
            raise DecodeError("it acknowledges nothing, so acknowledge has to be false here, too")
        if self._greeted is None:
            self.greet(link)
        self._acknowledged = link.acknowledge
        self._may_refuse = bool(header.flags & ContactFlag.REFUSE)
        self._keepalive_s = float(min(link.keepalive_s, header.keepalive_s))
        self.stage = Stage.UP

    def _take(self, segment: DataSegment) -> None:
        if segment.start:
            self._coming.clear()
        self._coming += segment.octets
        if len(self._coming) > _MOST_BUNDLE_OCTETS:
            raise DecodeError("a bundle that does not end")
        length = len(self._coming)
        if not segment.end:
            # In turn with those of whole bundles, which wait for the disk.
            self._node.transaction.then(lambda _: self._ack(length))
            return
        octets = bytes(self._coming)
        self._coming.clear()
        try:
            self._node.receiving.arrived(str(self.peer), octets)
        except StoreError as error:
            _LOG.debug("bundle from %s refused: %s", self.peer, error)
            self._node.transaction.then(lambda _: self._refuse())
            return
        self._node.transaction.then(
            lambda failure: self._refuse() if failure else self._ack(length)
        )

    def _ack(self, length: int) -> None:
        if self._acknowledged and self.stage is Stage.UP:
            self._say(AckSegment(length))

    def _refuse(self) -> None:
        """Refuse a bundle; who does not understand that loses the session and tries again."""
        if self.stage is Stage.UP:
            if self._may_refuse:
                self._say(RefuseBundle(RefuseReason.NO_RESOURCES))
            self.end()

    def _acked(self, length: int) -> None:
        if not self._in_flight:
            raise DecodeError("an acknowledgement of nothing")
        expected = len(self._in_flight[0].octets)
        if length > expected:
            raise DecodeError(f"{length} octets acknowledged, {expected} were sent")
        if length == expected:
            self._in_flight_octets -= expected
            self._node.sending.handed_on([self._in_flight.popleft()])

    def _say(self, message: Message) -> None:
        self._said_s = self._now_s()
        self._write(encode_message(message))
