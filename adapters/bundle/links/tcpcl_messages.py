"""Messages of TCPCL version 3 (RFC 7242): encoder and decoder."""

from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Final, assert_never

from adapters.bundle.codec.errors import DecodeError
from adapters.bundle.links.sdnv import SdnvReader, TruncatedError, encode_sdnv

MAGIC: Final = b"dtn!"
VERSION: Final = 3
_MAX_EID_OCTETS: Final = 1024


class _Kind(IntEnum):
    DATA = 1
    ACK = 2
    REFUSE = 3
    KEEPALIVE = 4
    SHUTDOWN = 5
    LENGTH = 6


class ContactFlag(IntFlag):
    """Flags of the contact header (RFC 7242, 4.1)."""

    ACKNOWLEDGE = 0x1
    FRAGMENT = 0x2
    REFUSE = 0x4
    LENGTH = 0x8


class RefuseReason(IntEnum):
    """Reason of a refusal (RFC 7242, 5.4)."""

    UNKNOWN = 0
    ALREADY_COMPLETE = 1
    NO_RESOURCES = 2
    PROBLEM = 3


@dataclass(frozen=True, slots=True)
class ContactHeader:
    """First message of each side (RFC 7242, 4.1)."""

    flags: int
    keepalive_s: int
    eid: str


@dataclass(frozen=True, slots=True)
class DataSegment:
    """Part of a bundle (RFC 7242, 5.2)."""

    octets: bytes
    start: bool
    end: bool


@dataclass(frozen=True, slots=True)
class AckSegment:
    """Acknowledgement: octets of the bundle that were received (RFC 7242, 5.3)."""

    length: int


@dataclass(frozen=True, slots=True)
class RefuseBundle:
    """Refusal of the bundle that is being received (RFC 7242, 5.4)."""

    reason: int


@dataclass(frozen=True, slots=True)
class Keepalive:
    """Keepalive of an idle session (RFC 7242, 5.6)."""


@dataclass(frozen=True, slots=True)
class Shutdown:
    """End of the session (RFC 7242, 6.1): reason code, and delay before reconnecting."""

    reason: int | None = None
    delay_s: int | None = None


@dataclass(frozen=True, slots=True)
class BundleLength:
    """Length of the next bundle (RFC 7242, 5.5)."""

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
    """Splits a stream into messages, beginning with the contact header.

    Segments above `max_octets` are rejected.
    """

    def __init__(self, max_octets: int) -> None:
        self._max_octets = max_octets
        self._expect_header = True
        self._buffer = b""

    def feed(self, octets: bytes) -> list[Message]:
        """Add received octets; return the messages that they complete.

        Raises:
            DecodeError: the stream violates the standard; it cannot be continued.
        """
        self._buffer += octets
        reader, messages, end = SdnvReader(self._buffer), list[Message](), 0
        try:
            while reader.remaining:
                messages.append(self._header(reader) if self._expect_header else self._read(reader))
                self._expect_header, end = False, reader.at
        except TruncatedError:
            pass
        self._buffer = self._buffer[end:]
        return messages

    def _read(self, reader: SdnvReader) -> Message:
        first = reader.octet()
        kind, flags = first >> 4, first & 0x0F
        match kind:
            case _Kind.DATA:
                if (length := reader.number()) > self._max_octets:
                    limit = self._max_octets
                    raise DecodeError(f"TCPCL segment of {length} octets exceeds {limit} octets")
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
            raise DecodeError("expected TCPCL contact header")
        reader.take(len(MAGIC))
        if (version := reader.octet()) != VERSION:
            raise DecodeError(f"TCPCL version {version} is not 3")
        flags, keepalive_s = reader.octet(), int.from_bytes(reader.take(2), "big")
        if (length := reader.number()) > _MAX_EID_OCTETS:
            raise DecodeError(f"TCPCL endpoint of {length} octets is too long")
        try:
            return ContactHeader(flags, keepalive_s, reader.take(length).decode())
        except UnicodeDecodeError as error:
            raise DecodeError("TCPCL endpoint is not UTF-8") from error


def _head(kind: int, flags: int = 0) -> bytes:
    return bytes((kind << 4 | flags,))
