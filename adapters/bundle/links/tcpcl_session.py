"""TCPCL version 3 (RFC 7242): messages, and a session fed with octets and time."""

import logging
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, IntEnum, IntFlag
from math import inf
from typing import Final, assert_never

from adapters.bundle.codec.eid import Eid, node_of, parse_eid
from adapters.bundle.codec.errors import DecodeError, StoreError
from adapters.bundle.links.sdnv import SdnvReader, TruncatedError, encode_sdnv
from adapters.bundle.node.node import Node
from adapters.bundle.node.sending import Outgoing
from adapters.bundle.node.settings import TcpclLink

MAGIC: Final = b"dtn!"
VERSION: Final = 3
_MOST_EID_OCTETS: Final = 1024


_LOG = logging.getLogger(__name__)
_MOST_BUNDLE_OCTETS: Final = 64 << 20


class _Kind(IntEnum):
    DATA = 1
    ACK = 2
    REFUSE = 3
    KEEPALIVE = 4
    SHUTDOWN = 5
    LENGTH = 6


class ContactFlag(IntFlag):
    """What a node asks for in its contact header (4.1)."""

    ACKNOWLEDGE = 0x1
    FRAGMENT = 0x2
    REFUSE = 0x4
    LENGTH = 0x8


class RefuseReason(IntEnum):
    """Why a bundle is refused (5.4)."""

    UNKNOWN = 0
    ALREADY_COMPLETE = 1
    NO_RESOURCES = 2
    PROBLEM = 3


@dataclass(frozen=True, slots=True)
class ContactHeader:
    """The first message of either side."""

    flags: int
    keepalive_s: int
    eid: str


@dataclass(frozen=True, slots=True)
class DataSegment:
    """A part of a bundle."""

    octets: bytes
    start: bool
    end: bool


@dataclass(frozen=True, slots=True)
class AckSegment:
    """How much of the bundle has been received."""

    length: int


@dataclass(frozen=True, slots=True)
class RefuseBundle:
    """The bundle that is being received is not wanted."""

    reason: int


@dataclass(frozen=True, slots=True)
class Keepalive:
    """Keeps an idle session alive."""


@dataclass(frozen=True, slots=True)
class Shutdown:
    """The session ends (6.1), with the code of a reason; come again after a delay."""

    reason: int | None = None
    delay_s: int | None = None


@dataclass(frozen=True, slots=True)
class BundleLength:
    """How long the bundle that follows is."""

    length: int


Message = (
    ContactHeader | DataSegment | AckSegment | RefuseBundle | Keepalive | Shutdown | BundleLength
)


def encode_message(message: Message) -> bytes:
    """Encode a message."""
    match message:
        case ContactHeader():
            eid = message.eid.encode()
            keepalive = message.keepalive_s.to_bytes(2, "big")
            return b"".join(
                (MAGIC, bytes((VERSION, message.flags)), keepalive, encode_sdnv(len(eid)), eid)
            )
        case DataSegment():
            flags = (2 if message.start else 0) | (1 if message.end else 0)
            return _head(_Kind.DATA, flags) + encode_sdnv(len(message.octets)) + message.octets
        case AckSegment():
            return _head(_Kind.ACK) + encode_sdnv(message.length)
        case RefuseBundle():
            return _head(_Kind.REFUSE, message.reason)
        case Keepalive():
            return _head(_Kind.KEEPALIVE)
        case Shutdown():
            reason = b"" if message.reason is None else bytes((message.reason,))
            delay = b"" if message.delay_s is None else encode_sdnv(message.delay_s)
            return (
                _head(_Kind.SHUTDOWN, (2 if reason else 0) | (1 if delay else 0)) + reason + delay
            )
        case BundleLength():
            return _head(_Kind.LENGTH) + encode_sdnv(message.length)
        case _:
            assert_never(message)


class MessageReader:
    """Cuts a stream, however it comes in pieces, into messages.

    Args:
        most_octets: the longest segment that is taken.
        expect_header: whether the contact header comes first.
    """

    def __init__(self, most_octets: int, expect_header: bool = True) -> None:
        self._most_octets = most_octets
        self._expect_header = expect_header
        self._buffer = b""

    def feed(self, octets: bytes) -> list[Message]:
        """Take octets in; return the messages that they complete.

        Raises:
            DecodeError: the stream is not what the standard allows; nothing can follow.
        """
        self._buffer += octets
        reader, messages, end = SdnvReader(self._buffer), list[Message](), 0
        try:
            while reader.left:
                messages.append(self._header(reader) if self._expect_header else self._read(reader))
                self._expect_header, end = False, reader.at
        except TruncatedError:
            pass
        self._buffer = self._buffer[end:]
        return messages

    @property
    def pending_octets(self) -> int:
        """How much waits for the rest of its message."""
        return len(self._buffer)

    def _read(self, reader: SdnvReader) -> Message:
        first = reader.octet()
        kind, flags = first >> 4, first & 0x0F
        match kind:
            case _Kind.DATA:
                if (length := reader.number()) > self._most_octets:
                    most = self._most_octets
                    raise DecodeError(f"TCPCL segment of {length} octets, {most} allowed")
                return DataSegment(reader.take(length), bool(flags & 2), bool(flags & 1))
            case _Kind.ACK:
                return AckSegment(reader.number())
            case _Kind.REFUSE:
                return RefuseBundle(flags)
            case _Kind.KEEPALIVE:
                return Keepalive()
            case _Kind.SHUTDOWN:
                reason = reader.octet() if flags & 2 else None
                return Shutdown(reason, reader.number() if flags & 1 else None)
            case _Kind.LENGTH:
                return BundleLength(reader.number())
            case _:
                raise DecodeError(f"TCPCL message of undefined type {kind}")

    def _header(self, reader: SdnvReader) -> ContactHeader:
        if not MAGIC.startswith(self._buffer[: len(MAGIC)]):
            raise DecodeError("no TCPCL contact header")
        reader.take(len(MAGIC))
        if (version := reader.octet()) != VERSION:
            raise DecodeError(f"TCPCL version {version}")
        flags, keepalive_s = reader.octet(), int.from_bytes(reader.take(2), "big")
        if (length := reader.number()) > _MOST_EID_OCTETS:
            raise DecodeError(f"TCPCL endpoint of {length} octets")
        try:
            return ContactHeader(flags, keepalive_s, reader.take(length).decode())
        except UnicodeDecodeError as error:
            raise DecodeError("TCPCL endpoint is not UTF-8") from error


def _head(kind: int, flags: int = 0) -> bytes:
    return bytes((kind << 4 | flags,))


class SessionStage(Enum):
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
        settings_of: gives the settings of the link to a node, if it is a neighbour.
        now_s: monotonic time.
        write: takes octets for the other side.

    Attributes:
        stage: how far it has come; the connection is closed when it is OVER.
        peer: the other node, when it has said who it is.
        last_heard_s: when something came, in monotonic time.
        unacknowledged: what has to be queued again; the link takes it from here.
    """

    def __init__(
        self,
        node: Node,
        settings_of: Callable[[Eid], TcpclLink | None],
        now_s: Callable[[], float],
        write: Callable[[bytes], None],
    ) -> None:
        self.stage = SessionStage.GREETING
        self.peer: Eid | None = None
        self.last_heard_s = now_s()
        self._settings_of, self._now_s, self._write = settings_of, now_s, write
        self._node = node
        self._reader = MessageReader(_MOST_BUNDLE_OCTETS)
        self._settings: TcpclLink | None = None
        self._acknowledged = self._may_refuse = False
        self._keepalive_s = 0.0
        self._last_sent_s = now_s()
        self._incoming = bytearray()
        self._in_flight: deque[Outgoing] = deque()
        self._in_flight_octets = 0
        self.unacknowledged: list[Outgoing] = []

    def send_contact_header(self, link: TcpclLink) -> None:
        """Send our node and what we ask of the session."""
        self._settings = link
        flags = ContactFlag.REFUSE | (ContactFlag.ACKNOWLEDGE if link.acknowledge else 0)
        self._send_message(
            ContactHeader(int(flags), link.keepalive_s, str(self._node.settings.node))
        )

    @property
    def room(self) -> int:
        """How many more octets it takes now."""
        if self.stage is not SessionStage.UP or self._settings is None:
            return 0
        return self._settings.window_octets - self._in_flight_octets

    def send(self, outgoing: Outgoing) -> None:
        """Send a bundle."""
        assert self._settings is not None
        size = self._settings.segment_octets
        octets = outgoing.octets
        for at in range(0, len(octets), size):
            end = at + size >= len(octets)
            self._send_message(DataSegment(octets[at : at + size], start=not at, end=end))
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
                if self.stage is not SessionStage.OVER:
                    self._receive_message(message)
        except DecodeError as error:
            _LOG.warning("TCPCL session with %s ended: %s", self.peer, error)
            self.end()

    @property
    def next_s(self) -> float:
        """When `tick` has something to do; infinity for never."""
        if not self._keepalive_s or self.stage is not SessionStage.UP:
            return inf
        next_keepalive_s = self._last_sent_s + self._keepalive_s
        return min(next_keepalive_s, self.last_heard_s + 2 * self._keepalive_s)

    def tick(self) -> None:
        """Send a keepalive, or end a session that is silent."""
        now_s = self._now_s()
        if not self._keepalive_s or self.stage is not SessionStage.UP:
            return
        if now_s >= self.last_heard_s + 2 * self._keepalive_s:
            _LOG.warning("TCPCL session with %s ended: nothing heard", self.peer)
            self.end()
        elif now_s >= self._last_sent_s + self._keepalive_s:
            self._send_message(Keepalive())

    def end(self) -> None:
        """Shut the session down; what was not acknowledged is given back."""
        if self.stage is not SessionStage.OVER:
            if self._settings is not None:
                self._send_message(Shutdown())
            self.lost()

    def lost(self) -> None:
        """Note that the connection is gone."""
        self.stage = SessionStage.OVER
        self.unacknowledged += self._in_flight
        self._in_flight.clear()
        self._incoming.clear()

    def _receive_message(self, message: Message) -> None:
        match message:
            case ContactHeader():
                self._receive_header(message)
            case DataSegment():
                self._take(message)
            case AckSegment():
                self._acked(message.length)
            case RefuseBundle():
                if self._in_flight:
                    self.unacknowledged.append(self._in_flight.popleft())
                    self.end()
            case Shutdown():
                self.end()
            case Keepalive() | BundleLength():
                pass
            case _:
                assert_never(message)

    def _receive_header(self, header: ContactHeader) -> None:
        try:
            self.peer = node_of(parse_eid(header.eid))
        except ValueError as error:
            raise DecodeError("contact header without an endpoint") from error
        link = self._settings_of(self.peer)
        if link is None:
            raise DecodeError(f"{self.peer} is no neighbour")
        if link.acknowledge and not header.flags & ContactFlag.ACKNOWLEDGE:
            raise DecodeError("it acknowledges nothing, so acknowledge has to be false here, too")
        if self._settings is None:
            self.send_contact_header(link)
        self._acknowledged = link.acknowledge
        self._may_refuse = bool(header.flags & ContactFlag.REFUSE)
        self._keepalive_s = float(min(link.keepalive_s, header.keepalive_s))
        self.stage = SessionStage.UP

    def _take(self, segment: DataSegment) -> None:
        if segment.start:
            self._incoming.clear()
        self._incoming += segment.octets
        if len(self._incoming) > _MOST_BUNDLE_OCTETS:
            raise DecodeError("a bundle that does not end")
        length = len(self._incoming)
        if not segment.end:
            # In turn with those of whole bundles, which wait for the disk.
            self._node.transaction.then(lambda _: self._ack(length))
            return
        octets = bytes(self._incoming)
        self._incoming.clear()
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
        if self._acknowledged and self.stage is SessionStage.UP:
            self._send_message(AckSegment(length))

    def _refuse(self) -> None:
        """Refuse a bundle; a peer that does not understand that loses the session and retries."""
        if self.stage is SessionStage.UP:
            if self._may_refuse:
                self._send_message(RefuseBundle(RefuseReason.NO_RESOURCES))
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

    def _send_message(self, message: Message) -> None:
        self._last_sent_s = self._now_s()
        self._write(encode_message(message))
