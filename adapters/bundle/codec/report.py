"""`StatusReport`: the bundle status report, an administrative record (RFC 9171, 6.1), as octets."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Final

from adapters.bundle.codec import cbor
from adapters.bundle.codec.bundle import Creation, FragmentRange
from adapters.bundle.codec.eid import Eid, encode_eid, read_eid

_STATUS_REPORT: Final = 1  # administrative record type (RFC 9171, 6.1)


class Assertion(Enum):
    """Status assertion of a bundle status report; the value is its index (RFC 9171, 6.1.1)."""

    RECEIVED = 0
    FORWARDED = 1
    DELIVERED = 2
    DELETED = 3


class ReportReason(Enum):
    """Reason code of a status report (IANA: Bundle Status Report Reason Codes)."""

    NONE = 0
    LIFETIME_EXPIRED = 1
    FORWARDED_UNIDIRECTIONAL = 2
    TRANSMISSION_CANCELLED = 3
    DEPLETED_STORAGE = 4
    DESTINATION_UNAVAILABLE = 5
    NO_ROUTE = 6
    NO_TIMELY_CONTACT = 7
    BLOCK_UNINTELLIGIBLE = 8
    HOP_LIMIT_EXCEEDED = 9
    TRAFFIC_PARED = 10
    BLOCK_UNSUPPORTED = 11


@dataclass(frozen=True, slots=True)
class StatusReport:
    """A bundle status report (RFC 9171, 6.1.1).

    Attributes:
        asserted: DTN time of each assertion in milliseconds since 2000; None if not requested.
        reason: a `ReportReason`, or another code.
        part: payload offset and length, if the reported bundle is a fragment.
    """

    asserted: Mapping[Assertion, int | None]
    reason: int
    source: Eid
    creation: Creation
    part: FragmentRange | None = None


def encode_report(report: StatusReport) -> bytes:
    """Encode a status report as an administrative record (RFC 9171, 6.1)."""
    part = report.part
    return b"".join(
        (
            cbor.array(2),
            cbor.unsigned(_STATUS_REPORT),
            cbor.array(6 if part else 4),
            cbor.array(len(Assertion)),
            *(_encode_asserted(report.asserted, assertion) for assertion in Assertion),
            cbor.unsigned(report.reason),
            encode_eid(report.source),
            cbor.array(2),
            cbor.unsigned(report.creation.time_ms),
            cbor.unsigned(report.creation.sequence),
            cbor.unsigned(part.offset) + cbor.unsigned(part.total) if part else b"",
        )
    )


def decode_report(record: bytes) -> StatusReport | None:
    """Decode a bundle status report; return None for another administrative record.

    Raises:
        DecodeError: the record or the report is malformed.
    """
    reader = cbor.Reader(record)
    reader.array_of(2)
    if reader.unsigned() != _STATUS_REPORT:
        return None
    length = reader.array_of(4, 6)
    reader.array_of(len(Assertion))
    asserted = _read_asserted(reader)
    reason = reader.unsigned()
    source = read_eid(reader)
    reader.array_of(2)
    creation = Creation(reader.unsigned(), reader.unsigned())
    part = FragmentRange(reader.unsigned(), reader.unsigned()) if length == 6 else None
    reader.finish()
    return StatusReport(asserted, reason, source, creation, part)


def _encode_asserted(asserted: Mapping[Assertion, int | None], assertion: Assertion) -> bytes:
    if assertion not in asserted:
        return cbor.array(1) + cbor.FALSE
    time_ms = asserted[assertion]
    if time_ms is None:
        return cbor.array(1) + cbor.TRUE
    return cbor.array(2) + cbor.TRUE + cbor.unsigned(time_ms)


def _read_asserted(reader: cbor.Reader) -> dict[Assertion, int | None]:
    asserted: dict[Assertion, int | None] = {}
    for assertion in Assertion:
        timed = reader.array_of(1, 2) == 2
        holds = reader.boolean()
        time_ms = reader.unsigned() if timed else None
        if holds:
            asserted[assertion] = time_ms
        elif timed:
            raise reader.fail("time given for an assertion that is false")
    return asserted
