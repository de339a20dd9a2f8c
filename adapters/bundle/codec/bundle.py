"""`Bundle` (RFC 9171, 4) as value and as octets; the decoder is strict, raises DecodeError."""

import struct
from binascii import crc_hqx
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Final

from adapters.bundle.codec import cbor
from adapters.bundle.codec.eid import Eid, decode_eid, encode_eid, is_null, read_eid
from adapters.bundle.codec.errors import DecodeError

DTN_EPOCH_UTC_MS: Final = 946_684_800_000  # 2000-01-01T00:00:00Z (RFC 9171, 4.2.6)
PAYLOAD_NUMBER: Final = 1
_VERSION: Final = 7  # RFC 9171, 4.3.1


class Crc(IntEnum):
    """CRC type of a block (RFC 9171, 4.2.1)."""

    NONE = 0
    CRC16 = 1
    CRC32C = 2


CRC_OCTETS: Final = {Crc.NONE: 0, Crc.CRC16: 2, Crc.CRC32C: 4}


def crc16(octets: bytes) -> bytes:
    """Return the CRC-16/X.25 of the octets, big-endian (RFC 9171, 4.2.1).

    X.25 is the reflected form of the CRC that `binascii.crc_hqx` computes in C. Reflecting the
    input and the result converts one into the other.
    """
    mirrored = crc_hqx(octets.translate(_MIRRORED), 0xFFFF) ^ 0xFFFF
    return bytes((_MIRRORED[mirrored & 0xFF], _MIRRORED[mirrored >> 8]))


def crc32c(octets: bytes) -> bytes:
    """Return the CRC-32C (Castagnoli) of the octets, big-endian (RFC 9171, 4.2.1)."""
    crc = 0xFFFFFFFF
    last, third, second, first = _CASTAGNOLI
    fours = len(octets) & ~3
    for (four,) in _FOURS.iter_unpack(octets[:fours]):
        four ^= crc
        crc = (
            first[four & 0xFF]
            ^ second[four >> 8 & 0xFF]
            ^ third[four >> 16 & 0xFF]
            ^ last[four >> 24]
        )
    for octet in octets[fours:]:
        crc = last[(crc ^ octet) & 0xFF] ^ (crc >> 8)
    return struct.pack(">I", crc ^ 0xFFFFFFFF)


def check_sum(kind: Crc, octets: bytes) -> bytes:
    """Return the CRC of the given type; no octets for NONE."""
    if kind is Crc.CRC16:
        return crc16(octets)
    return crc32c(octets) if kind is Crc.CRC32C else b""


def _reverse_bits(octet: int) -> int:
    return int(f"{octet:08b}"[::-1], 2)


def _castagnoli(octet: int, behind: int) -> int:
    """Return the contribution of an octet to a CRC-32C, with `behind` octets after it."""
    for _ in range(8 + 8 * behind):
        octet = (octet >> 1) ^ (0x82F63B78 if octet & 1 else 0)
    return octet


_MIRRORED: Final = bytes(map(_reverse_bits, range(256)))
_CASTAGNOLI: Final = [[_castagnoli(octet, behind) for octet in range(256)] for behind in range(4)]
_FOURS: Final = struct.Struct("<I")


class Flag(IntFlag):
    """Bundle processing control flags (RFC 9171, 4.2.3)."""

    FRAGMENT = 0x1
    ADMINISTRATIVE = 0x2
    MUST_NOT_FRAGMENT = 0x4
    ACKNOWLEDGE = 0x20
    REPORT_TIMES = 0x40
    REPORT_RECEPTION = 0x4000
    REPORT_FORWARDING = 0x10000
    REPORT_DELIVERY = 0x20000
    REPORT_DELETION = 0x40000


REPORTS: Final = int(
    Flag.REPORT_RECEPTION | Flag.REPORT_FORWARDING | Flag.REPORT_DELIVERY | Flag.REPORT_DELETION
)


class BlockFlag(IntFlag):
    """Block processing control flags (RFC 9171, 4.2.4)."""

    REPLICATE = 0x1
    REPORT_IF_UNKNOWN = 0x2
    DELETE_BUNDLE_IF_UNKNOWN = 0x4
    DISCARD_IF_UNKNOWN = 0x10


class BlockType(IntEnum):
    """Block types of RFC 9171 and RFC 9172, and NASA ION's quality-of-service block."""

    PAYLOAD = 1
    PREVIOUS_NODE = 6
    BUNDLE_AGE = 7
    HOP_COUNT = 10
    INTEGRITY = 11
    CONFIDENTIALITY = 12
    QUALITY = 193


KNOWN_BLOCKS: Final = frozenset(BlockType)


@dataclass(frozen=True, slots=True)
class Creation:
    """Creation timestamp (RFC 9171, 4.2.7): DTN time in ms since 2000, and sequence number."""

    time_ms: int
    sequence: int


@dataclass(frozen=True, slots=True)
class FragmentRange:
    """Fragment offset and total application data unit length, in octets (RFC 9171, 4.3.1)."""

    offset: int
    total: int


@dataclass(frozen=True, slots=True)
class Primary:
    """Primary block (RFC 9171, 4.3.1).

    Attributes:
        flags: a sum of `Flag`s; unknown flags are retained.
        part: present in fragments only.
    """

    destination: Eid
    source: Eid
    report_to: Eid
    creation: Creation
    lifetime_ms: int
    flags: int = 0
    crc: Crc = Crc.CRC32C
    part: FragmentRange | None = None


@dataclass(frozen=True, slots=True)
class Block:
    """Canonical block (RFC 9171, 4.3.2).

    Attributes:
        type: a `BlockType`, or another code.
        flags: a sum of `BlockFlag`s.
    """

    type: int
    number: int
    data: bytes
    flags: int = 0
    crc: Crc = Crc.NONE


@dataclass(frozen=True, slots=True)
class Bundle:
    """A bundle; the payload block is its last block."""

    primary: Primary
    blocks: tuple[Block, ...]

    @property
    def payload(self) -> bytes:
        """The application data, or the fragment's part of them."""
        return self.blocks[-1].data

    def block(self, kind: BlockType) -> Block | None:
        """Return the first block of a type, or None."""
        return next((block for block in self.blocks if block.type == kind), None)


@dataclass(frozen=True, slots=True)
class BundleId:
    """Source and creation timestamp of a bundle (RFC 9171, 4.2.7). Its fragments share both."""

    source: Eid
    creation: Creation

    def __str__(self) -> str:
        return f"{self.source} {self.creation.time_ms}.{self.creation.sequence}"

    @property
    def key(self) -> bytes:
        """The identity as octets, the key of the store."""
        creation = self.creation
        return (
            encode_eid(self.source)
            + cbor.unsigned(creation.time_ms)
            + cbor.unsigned(creation.sequence)
        )


def identity_of(primary: Primary) -> BundleId:
    """Return the identity of the bundle with this primary block."""
    return BundleId(primary.source, primary.creation)


def bundle_id_from_key(key: bytes) -> BundleId:
    """Return the identity encoded in a key of the store."""
    reader = cbor.Reader(key)
    source = read_eid(reader)
    return BundleId(source, Creation(reader.unsigned(), reader.unsigned()))


@dataclass(frozen=True, slots=True)
class HopCount:
    """Hop limit and hop count of a bundle (RFC 9171, 4.4.3)."""

    limit: int
    count: int


def decode_age(data: bytes) -> int:
    """Decode a bundle age in milliseconds (RFC 9171, 4.4.2).

    Raises:
        DecodeError: the data are no bundle age.
    """
    reader = cbor.Reader(data)
    age_ms = reader.unsigned()
    reader.finish()
    return age_ms


def encode_hop_count(hops: HopCount) -> bytes:
    """Encode a hop count (RFC 9171, 4.4.3)."""
    return cbor.array(2) + cbor.unsigned(hops.limit) + cbor.unsigned(hops.count)


def decode_hop_count(data: bytes) -> HopCount:
    """Decode a hop count (RFC 9171, 4.4.3).

    Raises:
        DecodeError: the data are no hop count, or the limit is not in 1 to 255.
    """
    reader = cbor.Reader(data)
    reader.array_of(2)
    hops = HopCount(reader.unsigned(), reader.unsigned())
    reader.finish()
    if not 1 <= hops.limit <= 255:
        raise reader.fail(f"hop limit {hops.limit} is not in 1 to 255")
    return hops


_EXPEDITED_CLASS: Final = 2  # of ION's quality-of-service block
MAX_EXPEDITED_OCTETS: Final = 4096


def expedited_block(number: int) -> Block:
    """Return NASA ION's quality-of-service block that marks a bundle as expedited.

    RFC 9171 has no class of service; ION's routers honour this block. It holds flags, class,
    ordinal and label, and is replicated into every fragment.
    """
    data = cbor.array(4) + b"".join(map(cbor.unsigned, (0, _EXPEDITED_CLASS, 0, 0)))
    return Block(BlockType.QUALITY, number, data, BlockFlag.REPLICATE)


def is_expedited(bundle: Bundle) -> bool:
    """Return whether a bundle is expedited; payloads above `MAX_EXPEDITED_OCTETS` never are."""
    block = bundle.block(BlockType.QUALITY)
    if block is None or len(bundle.payload) > MAX_EXPEDITED_OCTETS:
        return False
    reader = cbor.Reader(block.data)
    try:
        reader.array_of(4)
        return (reader.unsigned(), reader.unsigned())[1] == _EXPEDITED_CLASS
    except DecodeError:
        return False


_FRAGMENT: Final = int(Flag.FRAGMENT)
_MUST_NOT_FRAGMENT: Final = int(Flag.MUST_NOT_FRAGMENT)
_ADMINISTRATIVE: Final = int(Flag.ADMINISTRATIVE)
_REPORT_IF_UNKNOWN: Final = int(BlockFlag.REPORT_IF_UNKNOWN)
_ONCE: Final[dict[int, Callable[[bytes], object]]] = {
    BlockType.PREVIOUS_NODE: decode_eid,
    BlockType.BUNDLE_AGE: decode_age,
    BlockType.HOP_COUNT: decode_hop_count,
}
_CRCS: Final = tuple(Crc)


def encode_bundle(bundle: Bundle) -> bytes:
    """Encode a bundle with its CRCs."""
    blocks = map(encode_block, bundle.blocks)
    return b"".join((cbor.OPEN_ARRAY, encode_primary(bundle.primary), *blocks, cbor.BREAK))


def decode_bundle(octets: bytes, *, lenient: bool = False) -> Bundle:
    """Decode octets that are exactly one bundle.

    Args:
        octets: the bundle.
        lenient: skip the checks across blocks, which published examples do not all pass.

    Raises:
        DecodeError: the octets are no bundle, a CRC is wrong, or a rule of RFC 9171 is violated.
    """
    reader = cbor.Reader(octets)
    bundle = _read_bundle(reader, lenient)
    reader.finish()
    return bundle


def decode_bundles(octets: bytes) -> Iterator[tuple[Bundle, bytes]]:
    """Decode concatenated bundles; yield each with its octets.

    Raises:
        DecodeError: the next octets are no bundle; those before were yielded.
    """
    reader = cbor.Reader(octets)
    while reader.at < len(octets):
        begin = reader.at
        yield _read_bundle(reader), octets[begin : reader.at]


def split_bundle(octets: bytes) -> list[bytes]:
    """Return the octets of each block of a decoded bundle, the primary block first."""
    reader, blocks = cbor.Reader(octets), list[bytes]()
    reader.open_array()
    while not reader.is_break():
        begin = reader.at
        reader.skip()
        blocks.append(octets[begin : reader.at])
    return blocks


def encode_primary(primary: Primary) -> bytes:
    """Encode a primary block with its CRC."""
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
    return _append_crc(encoded, primary.crc)


def encode_block(block: Block) -> bytes:
    """Encode a canonical block with its CRC."""
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
    return _append_crc(encoded, block.crc)


def _append_crc(encoded: bytes, kind: Crc) -> bytes:
    """Append the CRC, computed with the CRC field's octets at zero (RFC 9171, 4.2.1)."""
    if kind is Crc.NONE:
        return encoded
    head = encoded + cbor.octet_string(bytes(CRC_OCTETS[kind]))
    return head[: -CRC_OCTETS[kind]] + check_sum(kind, head)


def _read_bundle(reader: cbor.Reader, lenient: bool = False) -> Bundle:
    reader.open_array()
    primary = _read_primary(reader)
    blocks: list[Block] = []
    while not reader.is_break():
        blocks.append(_read_block(reader))
    bundle = Bundle(primary, tuple(blocks))
    _check_numbers(reader, bundle)
    if not lenient:
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
        raise reader.fail(f"primary block of {length} elements does not match its flags and CRC")
    part = FragmentRange(reader.unsigned(), reader.unsigned()) if fragment else None
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
        raise reader.fail(f"unknown CRC type {code}")
    return _CRCS[code]


def _check_sum(reader: cbor.Reader, begin: int, kind: Crc) -> None:
    if kind is Crc.NONE:
        return
    given = reader.octet_string()
    size = CRC_OCTETS[kind]
    if len(given) != size:
        raise reader.fail(f"CRC of {len(given)} octets, expected {size}")
    if check_sum(kind, reader.octets[begin : reader.at - size] + bytes(size)) != given:
        raise reader.fail("CRC is wrong")


def _check_numbers(reader: cbor.Reader, bundle: Bundle) -> None:
    """Check the presence, order and numbers of the blocks (RFC 9171, 4.1)."""
    types = [block.type for block in bundle.blocks]
    numbers = [block.number for block in bundle.blocks]
    if not types or types[-1] != BlockType.PAYLOAD or types.count(BlockType.PAYLOAD) != 1:
        raise reader.fail("expected exactly one payload block, as the last block")
    # NASA ION 4.1 numbers the extension blocks of its fragments 0.
    unique = [number for number in numbers if number]
    if numbers[-1] != PAYLOAD_NUMBER or len(set(unique)) != len(unique):
        raise reader.fail("block numbers: payload must be 1, others unique")


def _check(reader: cbor.Reader, bundle: Bundle) -> None:
    """Check the rules across blocks (RFC 9171, 4.2.3, 4.2.4, 4.3.1, 4.4.2)."""
    primary, types = bundle.primary, [block.type for block in bundle.blocks]
    for block in bundle.blocks[:-1]:
        if (decode := _ONCE.get(block.type)) is not None:
            decode(block.data)
            if types.count(block.type) > 1:
                raise reader.fail(f"duplicate block of type {block.type}")
    if primary.crc is Crc.NONE and not any(map(_signs_primary, bundle.blocks)):
        raise reader.fail("primary block without CRC or integrity block")
    if not primary.creation.time_ms and BlockType.BUNDLE_AGE not in types:
        raise reader.fail("creation time 0 without bundle age")
    if is_null(primary.destination):
        raise reader.fail("destination is the null endpoint")
    anonymous = is_null(primary.source)
    if anonymous and not primary.flags & _MUST_NOT_FRAGMENT:
        raise reader.fail("anonymous bundle without the flag that forbids fragmentation")
    if (anonymous or primary.flags & _ADMINISTRATIVE) and (
        primary.flags & REPORTS or any(block.flags & _REPORT_IF_UNKNOWN for block in bundle.blocks)
    ):
        raise reader.fail("anonymous bundle or administrative record requests status reports")
    if primary.part and primary.flags & _MUST_NOT_FRAGMENT:
        raise reader.fail("fragment of a bundle that must not be fragmented")
    if primary.part and primary.part.offset + len(bundle.payload) > primary.part.total:
        raise reader.fail("fragment ends beyond the total length")


def _signs_primary(block: Block) -> bool:
    """Return whether a block is a BIB that targets the primary block (number 0)."""
    if block.type != BlockType.INTEGRITY:
        return False
    targets = cbor.Reader(block.data)
    return 0 in [targets.unsigned() for _ in range(targets.array())]
