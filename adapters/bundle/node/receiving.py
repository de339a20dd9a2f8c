"""What a node does with a bundle that has arrived (RFC 9171, 5.6 and 5.7)."""

import logging
from typing import Final

from adapters.bundle.codec.bundle import (
    DTN_EPOCH_UTC_MS,
    REPORTS,
    BlockFlag,
    BlockType,
    Bundle,
    Flag,
    Primary,
    decode_age,
    decode_bundles,
    decode_hop_count,
    identity_of,
)
from adapters.bundle.codec.eid import decode_eid, node_of
from adapters.bundle.codec.errors import DecodeError
from adapters.bundle.codec.report import Assertion, ReportReason
from adapters.bundle.node.inbox import Arrival
from adapters.bundle.node.reporting import NodeState, Reporting

_LOG: Final = logging.getLogger(__name__)
_ADMINISTRATIVE: Final = int(Flag.ADMINISTRATIVE)
_KEPT_FLAGS: Final = REPORTS | int(Flag.REPORT_TIMES)


class Receiving:
    """Takes bundles in: for the application, to be forwarded, or to be deleted with a reason.

    Attributes:
        malformed: how many could not be read.
    """

    def __init__(self, state: NodeState, reporting: Reporting) -> None:
        self._state, self._reporting = state, reporting
        self.malformed = 0

    def arrived(self, neighbour: str, octets: bytes) -> None:
        """Take in bundles that stand back to back, within the transaction.

        What cannot be read is counted and dropped: it would not be better the next time.

        Args:
            neighbour: from whom they came.
            octets: the bundles.

        Raises:
            StoreFull: there is no room for more.
            StoreError: the store cannot be written.
        """
        try:
            for bundle, encoded in decode_bundles(octets):
                self._take(bundle, encoded, neighbour)
        except DecodeError as error:
            self.malformed += 1
            _LOG.warning("malformed bundle dropped: %s", error)

    def _take(self, bundle: Bundle, encoded: bytes, neighbour: str) -> None:
        state, primary = self._state, bundle.primary
        now_utc_ms = state.utc_ms()
        local = node_of(primary.destination) == state.settings.node
        if local and primary.flags & _ADMINISTRATIVE:
            self._reporting.receive(bundle)
            return
        if local and state.inbox.has_seen(identity_of(primary)):
            self._take_again(primary)
            return
        state.database.require_room()
        expires_utc_ms = _expires_utc_ms(bundle, now_utc_ms)
        self._reporting.about(bundle, Assertion.RECEIVED)
        if (reason := self._refusal(bundle, expires_utc_ms <= now_utc_ms, neighbour)) is not None:
            self._reporting.deleted(bundle, reason)
        elif local:
            self._keep(bundle, expires_utc_ms)
        else:
            state.outbox.add(
                primary,
                state.settings.neighbour_of(primary.destination) or "",
                encoded,
                own=False,
                confirm=False,
                now_utc_ms=now_utc_ms,
                expires_utc_ms=expires_utc_ms,
            )

    def _take_again(self, primary: Primary) -> None:
        """Repeat the delivery report of a bundle that comes again: the first may be lost."""
        identity = identity_of(primary)
        if not self._state.inbox.holds(identity):
            self._reporting.report(identity, primary.flags, primary.report_to, Assertion.DELIVERED)

    def _refusal(self, bundle: Bundle, expired: bool, neighbour: str) -> ReportReason | None:
        primary, settings = bundle.primary, self._state.settings
        if _has_unsupported_block(bundle):
            return ReportReason.BLOCK_UNSUPPORTED
        if expired:
            return ReportReason.LIFETIME_EXPIRED
        if node_of(primary.destination) == settings.node:
            if primary.destination not in settings.receivers:
                return ReportReason.DESTINATION_UNAVAILABLE
            too_long = primary.part and primary.part.total > settings.most_payload_octets
            return ReportReason.DEPLETED_STORAGE if too_long else None
        onward = settings.neighbour_of(primary.destination)
        if onward is None or onward in _came_through(bundle, neighbour):
            return ReportReason.NO_ROUTE
        return ReportReason.HOP_LIMIT_EXCEEDED if _hops_exceeded(bundle) else None

    def _keep(self, bundle: Bundle, expires_utc_ms: int) -> None:
        primary, inbox = bundle.primary, self._state.inbox
        identity, payload = identity_of(primary), bundle.payload
        if primary.part is not None:
            whole = inbox.add_fragment(identity, primary.part, payload, expires_utc_ms)
            if whole is None:
                return
            payload = whole
        inbox.add(
            Arrival(
                identity,
                primary.destination,
                primary.report_to,
                primary.flags & _KEPT_FLAGS,
                expires_utc_ms,
                payload,
            )
        )


def _has_unsupported_block(bundle: Bundle) -> bool:
    """Return whether a block that is not known here asks for the bundle's deletion (5.6)."""
    known = set(BlockType)
    return any(
        block.flags & BlockFlag.DELETE_BUNDLE_IF_UNKNOWN and block.type not in known
        for block in bundle.blocks
    )


def _hops_exceeded(bundle: Bundle) -> bool:
    """Return whether a bundle may not be forwarded once more (4.4.3)."""
    if (block := bundle.block(BlockType.HOP_COUNT)) is None:
        return False
    hops = decode_hop_count(block.data)
    return hops.count + 1 > hops.limit


def _came_through(bundle: Bundle, neighbour: str) -> tuple[str, ...]:
    previous = bundle.block(BlockType.PREVIOUS_NODE)
    named = () if previous is None else (str(node_of(decode_eid(previous.data))),)
    return (neighbour, str(node_of(bundle.primary.source)), *named)


def _expires_utc_ms(bundle: Bundle, now_utc_ms: int) -> int:
    """Return when the lifetime ends: counted from its creation, or by its age (4.4.2)."""
    primary = bundle.primary
    if primary.creation.time_ms:
        return DTN_EPOCH_UTC_MS + primary.creation.time_ms + primary.lifetime_ms
    age = bundle.block(BlockType.BUNDLE_AGE)
    return now_utc_ms + primary.lifetime_ms - (decode_age(age.data) if age else 0)
