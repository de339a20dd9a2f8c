"""What forwarding changes in a bundle (RFC 9171, 5.4): previous node, age, hops."""

from dataclasses import replace

from adapters.bundle.eid import Eid, encode_eid
from adapters.bundle.extension import (
    HopCount,
    decode_age,
    decode_hop_count,
    encode_age,
    encode_hop_count,
)
from adapters.bundle.values import Block, BlockFlag, BlockType, Bundle


def hops_exceeded(bundle: Bundle) -> bool:
    """Return whether a bundle may not be forwarded once more (4.4.3)."""
    block = bundle.block(BlockType.HOP_COUNT)
    if block is None:
        return False
    hops = decode_hop_count(block.data)
    return hops.count + 1 > hops.limit


def unsupported(bundle: Bundle) -> bool:
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
