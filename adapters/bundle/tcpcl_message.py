"""Messages of the TCP convergence layer, version 3 (RFC 7242), to octets and back."""

from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Final, assert_never

from adapters.bundle.errors import DecodeError
from adapters.bundle.sdnv import encode_sdnv, read_sdnv

MAGIC: Final = b"dtn!"
VERSION: Final = 3
_MOST_EID_OCTETS: Final = 1024
_DATA, _ACK, _REFUSE, _KEEPALIVE, _SHUTDOWN, _LENGTH = 1, 2, 3, 4, 5, 6


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
    """The first thing that either side says."""

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
    """Nothing to say, still there."""


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
            return _head(_DATA, flags) + encode_sdnv(len(message.octets)) + message.octets
        case AckSegment():
            return _head(_ACK) + encode_sdnv(message.length)
        case RefuseBundle():
            return _head(_REFUSE, message.reason)
        case Keepalive():
            return _head(_KEEPALIVE)
        case Shutdown():
            reason = b"" if message.reason is None else bytes((message.reason,))
            delay = b"" if message.delay_s is None else encode_sdnv(message.delay_s)
            return _head(_SHUTDOWN, (2 if reason else 0) | (1 if delay else 0)) + reason + delay
        case BundleLength():
            return _head(_LENGTH) + encode_sdnv(message.length)
        case _:
            assert_never(message)


class MessageReader:
    """Cuts a stream, however it comes in pieces, into messages.

    Args:
        most_octets: the longest segment that is taken.
    """

    def __init__(self, most_octets: int, expect_header: bool = True) -> None:
        """Begin with the contact header, unless that has been read."""
        self._most_octets = most_octets
        self._expect_header = expect_header
        self._buffer = b""

    def feed(self, octets: bytes) -> list[Message]:
        """Take octets in; return the messages that they complete.

        Raises:
            DecodeError: the stream is not what the standard allows; nothing can follow.
        """
        self._buffer += octets
        messages: list[Message] = []
        at = 0
        while found := self._message(at):
            message, at = found
            messages.append(message)
        self._buffer = self._buffer[at:]
        return messages

    @property
    def pending_octets(self) -> int:
        """How much waits for the rest of its message."""
        return len(self._buffer)

    def _message(self, at: int) -> tuple[Message, int] | None:
        if self._expect_header:
            found = self._header(at)
            self._expect_header = found is None
            return found
        if at >= len(self._buffer):
            return None
        kind, flags = self._buffer[at] >> 4, self._buffer[at] & 0x0F
        match kind:
            case 1:
                return self._data(at + 1, flags)
            case 2:
                number = read_sdnv(self._buffer, at + 1)
                return number and (AckSegment(number[0]), number[1])
            case 3:
                return RefuseBundle(flags), at + 1
            case 4:
                return Keepalive(), at + 1
            case 5:
                return self._shutdown(at + 1, flags)
            case 6:
                number = read_sdnv(self._buffer, at + 1)
                return number and (BundleLength(number[0]), number[1])
            case _:
                raise DecodeError(f"TCPCL message of undefined type {kind}")

    def _header(self, at: int) -> tuple[Message, int] | None:
        there = self._buffer[at : at + 8]
        if not MAGIC.startswith(there[:4]):
            raise DecodeError("no TCPCL contact header")
        if len(there) > 4 and there[4] != VERSION:
            raise DecodeError(f"TCPCL version {there[4]}")
        if len(there) < 8 or (number := read_sdnv(self._buffer, at + 8)) is None:
            return None
        length, begin = number
        if length > _MOST_EID_OCTETS:
            raise DecodeError(f"TCPCL endpoint of {length} octets")
        if len(self._buffer) < begin + length:
            return None
        try:
            eid = self._buffer[begin : begin + length].decode()
        except UnicodeDecodeError as error:
            raise DecodeError("TCPCL endpoint is not UTF-8") from error
        keepalive_s = int.from_bytes(there[6:8], "big")
        return ContactHeader(there[5], keepalive_s, eid), begin + length

    def _data(self, at: int, flags: int) -> tuple[Message, int] | None:
        number = read_sdnv(self._buffer, at)
        if number is None:
            return None
        length, begin = number
        if length > self._most_octets:
            raise DecodeError(f"TCPCL segment of {length} octets, {self._most_octets} allowed")
        if len(self._buffer) < begin + length:
            return None
        octets = self._buffer[begin : begin + length]
        return DataSegment(octets, bool(flags & 2), bool(flags & 1)), begin + length

    def _shutdown(self, at: int, flags: int) -> tuple[Message, int] | None:
        reason = delay_s = None
        if flags & 2:
            if at >= len(self._buffer):
                return None
            reason, at = self._buffer[at], at + 1
        if flags & 1:
            number = read_sdnv(self._buffer, at)
            if number is None:
                return None
            delay_s, at = number
        return Shutdown(reason, delay_s), at


def _head(kind: int, flags: int = 0) -> bytes:
    return bytes((kind << 4 | flags,))
