"""`OutboxReader` selects the bundles to send to a neighbour; forwarding and fragmentation."""

import logging
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from adapters.bundle.codec import cbor
from adapters.bundle.codec.bundle import (
    KNOWN_BLOCKS,
    Block,
    BlockFlag,
    BlockType,
    Bundle,
    Flag,
    FragmentRange,
    HopCount,
    decode_age,
    decode_bundle,
    decode_hop_count,
    encode_bundle,
    encode_hop_count,
)
from adapters.bundle.codec.eid import Eid, encode_eid
from adapters.bundle.codec.report import Assertion, ReportReason
from adapters.bundle.node.reporting import DeliveryStatus, NodeContext, Reporting
from adapters.bundle.node.store import OutboxEntry

_LOG: Final = logging.getLogger(__name__)
_FETCHED: Final = 32
_LENGTH_OCTETS: Final = 8


@dataclass(frozen=True, slots=True)
class Outgoing:
    """A bundle or fragment in the form sent to a neighbour."""

    stored: OutboxEntry
    octets: bytes


@dataclass(slots=True)
class _Queue:
    """Outgoing bundles of one neighbour and one priority.

    Attributes:
        ready: bundles read from the outbox, or requeued, that the link has not taken.
        last_id: row id up to which the outbox has been read.
    """

    ready: deque[Outgoing] = field(default_factory=deque)
    last_id: int = 0


class OutboxReader:
    """Reads the outbox ahead of the links, and tracks the bundles in flight."""

    def __init__(self, state: NodeContext, reporting: Reporting) -> None:
        self._state, self._reporting = state, reporting
        self._queues = {
            (neighbour.name, expedited): _Queue()
            for neighbour in state.settings.neighbours
            for expedited in (True, False)
        }
        self._parts: dict[int, int] = {}

    def outgoing(
        self, neighbour: str, octets: int, bundle_octets: int, *, expedited: bool = False
    ) -> list[Outgoing]:
        """Return the next bundles for a neighbour; they count as in flight.

        Only committed bundles are returned: a rollback must not undo a bundle that was sent.

        Returns up to `octets`, but at least one bundle. Bundles longer than `bundle_octets` are
        fragmented. Links request expedited bundles first, even when they have no capacity for
        the others.
        """
        if self._state.database.gathering:
            return []
        queue, taken = self._queues[neighbour, expedited], list[Outgoing]()
        while queue.ready or self._fetch(neighbour, expedited, bundle_octets):
            octets -= len(queue.ready[0].octets)
            if taken and octets < 0:
                break
            taken.append(queue.ready.popleft())
        self._state.traffic[neighbour].sent += len(taken)
        return taken

    def mark_forwarded(self, sent: Sequence[Outgoing]) -> None:
        """Record that the neighbour has received these."""
        whole = []
        for outgoing in sent:
            row_id = outgoing.stored.id
            self._parts[row_id] -= 1
            if not self._parts[row_id]:
                del self._parts[row_id]
                whole.append(outgoing.stored)
        if whole:
            self._state.transaction.add_retried(lambda: self._write_handed_on(whole))

    def requeue(self, neighbour: str, sent: Sequence[Outgoing]) -> None:
        """Queue bundles that the neighbour did not receive, before all others."""
        for outgoing in reversed(sent):
            self._queues[neighbour, outgoing.stored.expedited].ready.appendleft(outgoing)

    def forget(self, outgoing: Outgoing) -> None:
        """Stop sending this bundle; its row in the outbox stays until it expires."""
        self._parts.pop(outgoing.stored.id, None)

    def rewind(self) -> None:
        """Read the outbox from its beginning, so that requeued bundles are sent again."""
        for queue in self._queues.values():
            queue.last_id = 0

    def _fetch(self, neighbour: str, expedited: bool, bundle_octets: int) -> bool:
        state, queue = self._state, self._queues[neighbour, expedited]
        while not queue.ready:
            rows = state.outbox.waiting(
                neighbour, queue.last_id, _FETCHED, state.utc_ms(), expedited=expedited
            )
            if not rows:
                return False
            queue.last_id = rows[-1].id
            for stored in rows:
                if stored.id not in self._parts:
                    queue.ready.extend(self._cut(stored, bundle_octets))
        return True

    def _cut(self, stored: OutboxEntry, bundle_octets: int) -> list[Outgoing]:
        octets = stored.octets
        if not stored.own:
            stayed_ms = max(0, self._state.utc_ms() - stored.put_utc_ms)
            node = self._state.settings.node
            octets = encode_bundle(prepare_forwarding(decode_bundle(octets), node, stayed_ms))
        security = self._state.security if stored.own else None
        parts = [octets]
        if security or len(octets) > bundle_octets:
            bundle = decode_bundle(octets)
            more = security.octets(bundle.primary) if security else 0
            if len(octets) + more > bundle_octets:
                cut = fragments(bundle, bundle_octets - more)
                if cut is None:
                    self._discard(stored, bundle, bundle_octets)
                    return []
                parts = cut
            if more and security:
                parts = [encode_bundle(security.sign(decode_bundle(part))) for part in parts]
        self._parts[stored.id] = len(parts)
        return [Outgoing(stored, part) for part in parts]

    def _discard(self, stored: OutboxEntry, bundle: Bundle, bundle_octets: int) -> None:
        _LOG.warning(
            "bundle %s cannot be fragmented to %d octets, bundle_octets of the link to %s",
            stored.identity, bundle_octets, stored.neighbour,
        )  # fmt: skip
        self._reporting.report_deletion(bundle, ReportReason.TRANSMISSION_CANCELLED)
        self._state.outbox.remove([stored.id])
        if stored.own:
            self._state.notify(stored.identity, DeliveryStatus.DELETED)

    def _write_handed_on(self, whole: Sequence[OutboxEntry]) -> None:
        self._state.outbox.mark_forwarded(whole, self._state.utc_ms())
        for stored in whole:
            if not stored.confirm and self._state.settings.acknowledges(stored.neighbour):
                self._state.traffic[stored.neighbour].acknowledged += 1
            if stored.own:
                self._state.notify(stored.identity, DeliveryStatus.HANDED_ON)
            else:
                self._reporting.report_on(decode_bundle(stored.octets), Assertion.FORWARDED)


def prepare_forwarding(bundle: Bundle, by: Eid, stayed_ms: int) -> Bundle:
    """Return a bundle as a node forwards it (RFC 9171, 5.4): previous node, age and hop count."""
    blocks = [
        _one_hop_on(block, stayed_ms)
        for block in bundle.blocks
        if block.type != BlockType.PREVIOUS_NODE
        and not (block.flags & BlockFlag.DISCARD_IF_UNKNOWN and block.type not in KNOWN_BLOCKS)
    ]
    number = 1 + max(block.number for block in blocks)
    previous = Block(BlockType.PREVIOUS_NODE, number, encode_eid(by))
    return replace(bundle, blocks=(previous, *blocks))


def _one_hop_on(block: Block, stayed_ms: int) -> Block:
    if block.type == BlockType.BUNDLE_AGE:
        age_ms = min(decode_age(block.data) + stayed_ms, cbor.MAX_UNSIGNED)
        return replace(block, data=cbor.unsigned(age_ms))
    if block.type == BlockType.HOP_COUNT:
        hops = decode_hop_count(block.data)
        return replace(block, data=encode_hop_count(HopCount(hops.limit, hops.count + 1)))
    return block


def fragments(bundle: Bundle, max_octets: int) -> list[bytes] | None:
    """Encode a bundle as fragments (RFC 9171, 5.8) of at most this many octets.

    Returns:
        The encoded fragments, or None if the bundle must not or cannot be fragmented so small.
        Bundles signed by another node are not fragmented: no fragment could be verified.
    """
    primary, payload = bundle.primary, bundle.payload
    if primary.flags & Flag.MUST_NOT_FRAGMENT or bundle.block(BlockType.INTEGRITY):
        return None
    base = primary.part or FragmentRange(0, len(payload))
    head = _fragment(bundle, FragmentRange(base.total, base.total), b"", first=True)
    available = max_octets - len(encode_bundle(head)) - _LENGTH_OCTETS
    if available <= 0:
        return None
    return [
        encode_bundle(
            _fragment(
                bundle,
                FragmentRange(base.offset + at, base.total),
                payload[at : at + available],
                first=not at,
            )
        )
        for at in range(0, len(payload), available)
    ]


def _fragment(bundle: Bundle, part: FragmentRange, octets: bytes, *, first: bool) -> Bundle:
    primary = replace(bundle.primary, flags=bundle.primary.flags | int(Flag.FRAGMENT), part=part)
    blocks = [block for block in bundle.blocks[:-1] if first or block.flags & BlockFlag.REPLICATE]
    return Bundle(primary, (*blocks, replace(bundle.blocks[-1], data=octets)))
