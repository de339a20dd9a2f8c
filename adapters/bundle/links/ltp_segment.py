"""Segments of the Licklider Transmission Protocol (LTP, RFC 5326, 3): encoder and decoder."""

from dataclasses import dataclass
from enum import IntEnum
from typing import Final, assert_never

from adapters.bundle.codec.errors import DecodeError
from adapters.bundle.links.sdnv import SdnvReader, encode_sdnv

_DATA_TYPES: Final = range(8)
_END_OF_RED: Final = (2, 3)
_REPORT, _REPORT_ACK = 8, 9
_CANCEL: Final = {12: "sender", 14: "receiver"}


class CancelReason(IntEnum):
    """Reason of a cancellation (RFC 5326, 3.2.4)."""

    BY_CLIENT = 0
    UNREACHABLE = 1
    RETRANSMISSION_LIMIT = 2
    MISCOLOURED = 3
    SYSTEM = 4
    CYCLE_LIMIT = 5


@dataclass(frozen=True, slots=True)
class SessionId:
    """Session identifier: engine number of the block's sender, and its session number."""

    originator: int
    number: int


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """Serial number of a checkpoint, and of the report it responds to (0 for none)."""

    serial: int
    report_serial: int = 0


@dataclass(frozen=True, slots=True)
class Data:
    """Data segment (RFC 5326, 3.2.1).

    Attributes:
        red: whether it belongs to the reliable (red) part.
        checkpoint: its checkpoint, which requests a report; None if it is no checkpoint.
    """

    session: SessionId
    client_service: int
    offset: int
    octets: bytes
    red: bool = True
    checkpoint: Checkpoint | None = None
    ends_red: bool = False
    ends_block: bool = False


@dataclass(frozen=True, slots=True)
class ReceptionClaim:
    """Range of received octets, by its offset in the block."""

    offset: int
    length: int


@dataclass(frozen=True, slots=True)
class ReportSegment:
    """Report of the octets received between two bounds of the block (RFC 5326, 3.2.2)."""

    session: SessionId
    serial: int
    checkpoint_serial: int
    upper: int
    lower: int
    claims: tuple[ReceptionClaim, ...]


@dataclass(frozen=True, slots=True)
class ReportAck:
    """Acknowledgement of a report (RFC 5326, 3.2.3)."""

    session: SessionId
    serial: int


@dataclass(frozen=True, slots=True)
class Cancel:
    """Cancellation of a session (RFC 5326, 3.2.4); `reason` may be an unknown code."""

    session: SessionId
    by_sender: bool
    reason: int


@dataclass(frozen=True, slots=True)
class CancelAck:
    """Acknowledgement of a cancellation."""

    session: SessionId
    of_sender: bool


Segment = Data | ReportSegment | ReportAck | Cancel | CancelAck


def encode_segment(segment: Segment) -> bytes:
    """Encode a segment, without extensions."""
    session = segment.session
    match segment:
        case Data():
            kind = _data_type(segment)
            numbers = [segment.client_service, segment.offset, len(segment.octets)]
            if segment.checkpoint:
                numbers += [segment.checkpoint.serial, segment.checkpoint.report_serial]
            content = b"".join(map(encode_sdnv, numbers)) + segment.octets
        case ReportSegment():
            kind = _REPORT
            numbers = [segment.serial, segment.checkpoint_serial, segment.upper, segment.lower]
            numbers.append(len(segment.claims))
            for claim in segment.claims:
                numbers += [claim.offset - segment.lower, claim.length]
            content = b"".join(map(encode_sdnv, numbers))
        case ReportAck():
            kind, content = _REPORT_ACK, encode_sdnv(segment.serial)
        case Cancel():
            kind, content = 12 if segment.by_sender else 14, bytes((segment.reason,))
        case CancelAck():
            kind, content = 13 if segment.of_sender else 15, b""
        case _:
            assert_never(segment)
    head = bytes((kind,)) + encode_sdnv(session.originator) + encode_sdnv(session.number)
    return head + b"\x00" + content


def decode_segment(datagram: bytes) -> Segment:
    """Decode a datagram that is exactly one segment; extensions are skipped.

    Raises:
        DecodeError: the datagram is not a segment.
    """
    reader = SdnvReader(datagram)
    first = reader.octet()
    if first >> 4:
        raise DecodeError(f"LTP version {first >> 4} is not 0")
    kind = first & 0x0F
    session = SessionId(reader.number(), reader.number())
    extensions = reader.octet()
    _skip_extensions(reader, extensions >> 4)
    segment = _read_content(reader, kind, session)
    _skip_extensions(reader, extensions & 0x0F)
    if reader.remaining:
        raise DecodeError(f"octet {reader.at}: trailing octets after the segment")
    return segment


def _data_type(data: Data) -> int:
    if not data.red:
        return 7 if data.ends_block else 4
    if data.checkpoint is None:
        return 0
    return 3 if data.ends_block else 2 if data.ends_red else 1


def _read_content(reader: SdnvReader, kind: int, session: SessionId) -> Segment:
    if kind in (5, 6, 10, 11):
        raise DecodeError(f"LTP segment of undefined type {kind}")
    if kind in _DATA_TYPES:
        service, offset, length = reader.number(), reader.number(), reader.number()
        checkpoint = Checkpoint(reader.number(), reader.number()) if kind in (1, 2, 3) else None
        return Data(
            session, service, offset, reader.take(length),
            red=kind < 4, checkpoint=checkpoint,
            ends_red=kind in _END_OF_RED, ends_block=kind in (3, 7),
        )  # fmt: skip
    if kind == _REPORT:
        return _read_report(reader, session)
    if kind == _REPORT_ACK:
        return ReportAck(session, reader.number())
    if kind in _CANCEL:
        return Cancel(session, kind == 12, reader.octet())
    return CancelAck(session, kind == 13)


def _read_report(reader: SdnvReader, session: SessionId) -> ReportSegment:
    serial, checkpoint_serial = reader.number(), reader.number()
    upper, lower, count = reader.number(), reader.number(), reader.number()
    claims = []
    reached = lower
    for _ in range(count):
        offset, length = lower + reader.number(), reader.number()
        if offset < reached or not length or offset + length > upper:
            raise DecodeError("LTP report claims are out of order or out of bounds")
        claims.append(ReceptionClaim(offset, length))
        reached = offset + length
    if not claims or upper <= lower:
        raise DecodeError("LTP report without claims")
    return ReportSegment(session, serial, checkpoint_serial, upper, lower, tuple(claims))


def _skip_extensions(reader: SdnvReader, count: int) -> None:
    for _ in range(count):
        reader.octet()
        reader.take(reader.number())
