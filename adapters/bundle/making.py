"""The bundles that a node makes itself: application data, and status reports."""

from adapters.bundle.crc import Crc
from adapters.bundle.eid import Eid
from adapters.bundle.extension import HopCount, encode_hop_count
from adapters.bundle.identity import BundleId
from adapters.bundle.report import Asserted, Assertion, ReportReason, StatusReport, encode_report
from adapters.bundle.values import Block, BlockType, Bundle, Creation, Flag, Part, Primary

_CONFIRM = int(Flag.REPORT_DELIVERY | Flag.REPORT_DELETION)


def data_bundle(
    identity: BundleId, destination: Eid, report_to: Eid, payload: bytes, *,
    lifetime_ms: int, confirm: bool, hop_limit: int | None,
) -> Bundle:  # fmt: skip
    """Return a bundle with application data, which asks for reports where it is to be confirmed."""
    primary = Primary(
        destination, identity.source, report_to, identity.creation, lifetime_ms,
        flags=_CONFIRM if confirm else 0,
    )  # fmt: skip
    return Bundle(primary, (*_hop_count(hop_limit), _payload(payload)))


def report_bundle(
    creation: Creation, sender: Eid, report_to: Eid, report: StatusReport, *,
    lifetime_ms: int, hop_limit: int | None,
) -> Bundle:  # fmt: skip
    """Return a bundle with a status report."""
    primary = Primary(
        report_to, sender, sender, creation, lifetime_ms, flags=int(Flag.ADMINISTRATIVE)
    )
    return Bundle(primary, (*_hop_count(hop_limit), _payload(encode_report(report))))


def status_report(
    subject: BundleId, flags: int, assertion: Assertion, reason: ReportReason, time_ms: int,
    part: Part | None = None,
) -> StatusReport:  # fmt: skip
    """Return a report on a bundle, with the time where the bundle's flags ask for it."""
    told = Asserted(assertion, time_ms if flags & Flag.REPORT_TIMES else None)
    return StatusReport((told,), reason.value, subject.source, subject.creation, part)


def _payload(payload: bytes) -> Block:
    return Block(BlockType.PAYLOAD, 1, payload, crc=Crc.CRC32C)


def _hop_count(limit: int | None) -> tuple[Block, ...]:
    if limit is None:
        return ()
    return (Block(BlockType.HOP_COUNT, 2, encode_hop_count(HopCount(limit, 0))),)
