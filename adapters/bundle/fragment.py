"""Fragmentation and reassembly (RFC 9171, 5.8 and 5.9)."""

from collections.abc import Iterable
from dataclasses import replace

from adapters.bundle.codec import encode_bundle
from adapters.bundle.values import Block, BlockFlag, Bundle, Flag, Part

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


def assembled(total: int, parts: Iterable[tuple[int, bytes]]) -> bytes | None:
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
