"""The bundles that a node makes or changes: data, reports, fragments, forwarded ones."""

from collections.abc import Iterable
from dataclasses import replace

from adapters.bundle.codec.bundle import (
    Block,
    BlockFlag,
    BlockType,
    Bundle,
    BundleId,
    Crc,
    Creation,
    Flag,
    HopCount,
    Part,
    Primary,
    decode_age,
    decode_hop_count,
    encode_age,
    encode_bundle,
    encode_hop_count,
)
from adapters.bundle.codec.eid import Eid, encode_eid
from adapters.bundle.codec.report import (
    Asserted,
    Assertion,
    ReportReason,
    StatusReport,
    encode_report,
)

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


def hops_exceeded(bundle: Bundle) -> bool:
    """Return whether a bundle may not be forwarded once more (4.4.3)."""
    block = bundle.block(BlockType.HOP_COUNT)
    if block is None:
        return False
    hops = decode_hop_count(block.data)
    return hops.count + 1 > hops.limit


def has_unsupported_block(bundle: Bundle) -> bool:
    """Return whether a block that is not known here asks for the bundle's deletion (5.6)."""
    known = set(BlockType)
    return any(
        block.flags & BlockFlag.DELETE_BUNDLE_IF_UNKNOWN and block.type not in known
        for block in bundle.blocks
    )


def forwarded(bundle: Bundle, by: Eid, stayed_ms: int) -> Bundle:
    """Return a bundle as this node sends it on.

    Args:
        bundle: as it was received.
        by: this node.
        stayed_ms: how long it was here.
    """
    kept = [
        _changed(block, stayed_ms)
        for block in bundle.blocks
        if block.type != BlockType.PREVIOUS_NODE
        and not (block.flags & BlockFlag.DISCARD_IF_UNKNOWN and block.type not in set(BlockType))
    ]
    number = 1 + max(block.number for block in kept)
    previous = Block(BlockType.PREVIOUS_NODE, number, encode_eid(by))
    return replace(bundle, blocks=(previous, *kept))


def _changed(block: Block, stayed_ms: int) -> Block:
    if block.type == BlockType.BUNDLE_AGE:
        age_ms = min(decode_age(block.data) + stayed_ms, 2**64 - 1)
        return replace(block, data=encode_age(age_ms))
    if block.type == BlockType.HOP_COUNT:
        hops = decode_hop_count(block.data)
        return replace(block, data=encode_hop_count(HopCount(hops.limit, hops.count + 1)))
    return block


_FRAGMENT = int(Flag.FRAGMENT)
_MUST_NOT = int(Flag.MUST_NOT_FRAGMENT)
_LENGTH_OCTETS = 8


def fragments(bundle: Bundle, most_octets: int) -> list[bytes] | None:
    """Encode a bundle as fragments of at most this many octets.

    Returns:
        The encoded fragments, or None if it must not or cannot be cut that small.
    """
    primary, payload = bundle.primary, bundle.payload
    if primary.flags & _MUST_NOT:
        return None
    base = primary.part or Part(0, len(payload))
    longest = _fragment(bundle, Part(base.total, base.total), b"", first=True)
    room = most_octets - len(encode_bundle(longest)) - _LENGTH_OCTETS
    if room <= 0:
        return None
    return [
        encode_bundle(
            _fragment(
                bundle, Part(base.offset + at, base.total), payload[at : at + room], first=not at
            )
        )
        for at in range(0, len(payload), room)
    ]


def reassemble(total: int, parts: Iterable[tuple[int, bytes]]) -> bytes | None:
    """Put parts, each with its offset, together; None while octets are missing."""
    whole = bytearray()
    for offset, octets in sorted(parts):
        if offset > len(whole):
            return None
        whole += octets[len(whole) - offset :]
    return bytes(whole) if len(whole) == total else None


def _fragment(bundle: Bundle, part: Part, octets: bytes, *, first: bool) -> Bundle:
    primary = replace(bundle.primary, flags=bundle.primary.flags | _FRAGMENT, part=part)
    kept: list[Block] = [
        block for block in bundle.blocks[:-1] if first or block.flags & BlockFlag.REPLICATE
    ]
    return Bundle(primary, (*kept, replace(bundle.blocks[-1], data=octets)))
