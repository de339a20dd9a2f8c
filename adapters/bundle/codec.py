"""Bundles to octets and back (RFC 9171, 4), strict: what is not allowed raises DecodeError."""

from collections.abc import Callable, Iterator
from typing import Final

from adapters.bundle import cbor
from adapters.bundle.crc import CRC_OCTETS, Crc, check_sum
from adapters.bundle.eid import decode_eid, encode_eid, is_null, read_eid
from adapters.bundle.extension import decode_age, decode_hop_count
from adapters.bundle.values import (
    PAYLOAD_NUMBER,
    REPORTS,
    Block,
    BlockType,
    Bundle,
    Creation,
    Flag,
    Part,
    Primary,
)

_VERSION: Final = 7
_FRAGMENT: Final = int(Flag.FRAGMENT)
_MUST_NOT_FRAGMENT: Final = int(Flag.MUST_NOT_FRAGMENT)
_ADMINISTRATIVE: Final = int(Flag.ADMINISTRATIVE)
_ONCE: Final[dict[int, Callable[[bytes], object]]] = {
    BlockType.PREVIOUS_NODE: decode_eid,
    BlockType.BUNDLE_AGE: decode_age,
    BlockType.HOP_COUNT: decode_hop_count,
}
_CRCS: Final = tuple(Crc)


def encode_bundle(bundle: Bundle) -> bytes:
    """Encode a bundle with its check sums."""
    blocks = map(_encode_block, bundle.blocks)
    return b"".join((cbor.OPEN_ARRAY, _encode_primary(bundle.primary), *blocks, cbor.BREAK))


def decode_bundle(octets: bytes) -> Bundle:
    """Decode octets that are exactly one bundle.

    Raises:
        DecodeError: they are not, a check sum is wrong, or the standard forbids what they say.
    """
    reader = cbor.Reader(octets)
    bundle = _read_bundle(reader)
    reader.finish()
    return bundle


def decode_bundles(octets: bytes) -> Iterator[tuple[Bundle, bytes]]:
    """Decode bundles that stand back to back, each with its octets.

    Raises:
        DecodeError: what follows is no bundle; those before it have come.
    """
    reader = cbor.Reader(octets)
    while reader.at < len(octets):
        begin = reader.at
        yield _read_bundle(reader), octets[begin : reader.at]


def _encode_primary(primary: Primary) -> bytes:
    part = primary.part
    length = 8 + (2 if part else 0) + (1 if primary.crc else 0)
    encoded = b"".join(
        (
            cbor.array(length),
            cbor.unsigned(_VERSION),
            cbor.unsigned(primary.flags),
            cbor.unsigned(primary.crc),
            encode_eid(primary.destination),
            encode_eid(primary.source),
            encode_eid(primary.report_to),
            b"\x82",
            cbor.unsigned(primary.creation.time_ms),
            cbor.unsigned(primary.creation.sequence),
            cbor.unsigned(primary.lifetime_ms),
            cbor.unsigned(part.offset) + cbor.unsigned(part.total) if part else b"",
        )
    )
    return _sealed(encoded, primary.crc)


def _encode_block(block: Block) -> bytes:
    encoded = b"".join(
        (
            cbor.array(6 if block.crc else 5),
            cbor.unsigned(block.type),
            cbor.unsigned(block.number),
            cbor.unsigned(block.flags),
            cbor.unsigned(block.crc),
            cbor.octet_string(block.data),
        )
    )
    return _sealed(encoded, block.crc)


def _sealed(encoded: bytes, kind: Crc) -> bytes:
    """Append the check sum, taken over the block with the check sum's octets at zero."""
    if kind is Crc.NONE:
        return encoded
    head = encoded + cbor.octet_string(bytes(CRC_OCTETS[kind]))
    return head[: -CRC_OCTETS[kind]] + check_sum(kind, head)


def _read_bundle(reader: cbor.Reader) -> Bundle:
    reader.open_array()
    primary = _read_primary(reader)
    blocks: list[Block] = []
    while not reader.is_break():
        blocks.append(_read_block(reader))
    bundle = Bundle(primary, tuple(blocks))
    _check(reader, bundle)
    return bundle


def _read_primary(reader: cbor.Reader) -> Primary:
    begin = reader.at
    length = reader.array_of(8, 9, 10, 11)
    if (version := reader.unsigned()) != _VERSION:
        raise reader.fail(f"bundle protocol version {version}")
    flags = reader.unsigned()
    kind = _read_crc_kind(reader)
    destination, source, report_to = read_eid(reader), read_eid(reader), read_eid(reader)
    reader.array_of(2)
    creation = Creation(reader.unsigned(), reader.unsigned())
    lifetime_ms = reader.unsigned()
    fragment = bool(flags & _FRAGMENT)
    if length != 8 + 2 * fragment + (kind is not Crc.NONE):
        raise reader.fail(f"primary block of {length} elements, flags and CRC ask for another")
    part = Part(reader.unsigned(), reader.unsigned()) if fragment else None
    _check_sum(reader, begin, kind)
    return Primary(destination, source, report_to, creation, lifetime_ms, flags, kind, part)


def _read_block(reader: cbor.Reader) -> Block:
    begin = reader.at
    length = reader.array_of(5, 6)
    block_type, number, flags = reader.unsigned(), reader.unsigned(), reader.unsigned()
    kind = _read_crc_kind(reader)
    if length != (5 if kind is Crc.NONE else 6):
        raise reader.fail(f"block of {length} elements with CRC type {kind}")
    data = reader.octet_string()
    _check_sum(reader, begin, kind)
    return Block(block_type, number, data, flags, kind)


def _read_crc_kind(reader: cbor.Reader) -> Crc:
    code = reader.unsigned()
    if code >= len(_CRCS):
        raise reader.fail(f"CRC type {code}")
    return _CRCS[code]


def _check_sum(reader: cbor.Reader, begin: int, kind: Crc) -> None:
    if kind is Crc.NONE:
        return
    given = reader.octet_string()
    size = CRC_OCTETS[kind]
    if len(given) != size:
        raise reader.fail(f"CRC of {len(given)} octets where it has {size}")
    if check_sum(kind, reader.octets[begin : reader.at - size] + bytes(size)) != given:
        raise reader.fail("CRC is wrong")


def _check(reader: cbor.Reader, bundle: Bundle) -> None:
    """Hold a bundle to what the standard asks beyond its form (4.1, 4.2.3, 4.3.1, 4.4.2)."""
    primary, types = bundle.primary, [block.type for block in bundle.blocks]
    numbers = [block.number for block in bundle.blocks]
    if not types or types[-1] != BlockType.PAYLOAD or types.count(BlockType.PAYLOAD) != 1:
        raise reader.fail("one payload block wanted, as the last one")
    if numbers[-1] != PAYLOAD_NUMBER or 0 in numbers or len(set(numbers)) != len(numbers):
        raise reader.fail("block numbers: payload 1, others unique and not 0")
    for block in bundle.blocks[:-1]:
        if (decode := _ONCE.get(block.type)) is not None:
            decode(block.data)
            if types.count(block.type) > 1:
                raise reader.fail(f"block of type {block.type} comes twice")
    if primary.crc is Crc.NONE and BlockType.INTEGRITY not in types:
        raise reader.fail("primary block without CRC or integrity block")
    if not primary.creation.time_ms and BlockType.BUNDLE_AGE not in types:
        raise reader.fail("creation time 0 without bundle age")
    if is_null(primary.destination):
        raise reader.fail("destination is the null endpoint")
    anonymous = is_null(primary.source)
    if anonymous and not primary.flags & _MUST_NOT_FRAGMENT:
        raise reader.fail("a bundle of nobody must say that it must not be fragmented")
    if (anonymous or primary.flags & _ADMINISTRATIVE) and primary.flags & REPORTS:
        raise reader.fail("reports are asked for where they are not allowed")
    if primary.part and primary.flags & _MUST_NOT_FRAGMENT:
        raise reader.fail("a fragment of a bundle that must not be fragmented")
    if primary.part and primary.part.offset + len(bundle.payload) > primary.part.total:
        raise reader.fail("a fragment ends beyond the whole")
