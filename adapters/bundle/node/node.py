"""`BundleNode`: processes bundles (RFC 9171, 5) with a store; `BundleAgent` adds the links.

It uses no clock and no network of its own. Changes take effect with their commit.
"""

import logging
from collections import deque
from collections.abc import Callable
from typing import Final

from adapters.bundle.codec.bundle import (
    DTN_EPOCH_UTC_MS,
    KNOWN_BLOCKS,
    MAX_EXPEDITED_OCTETS,
    REPORTS,
    BlockFlag,
    BlockType,
    Bundle,
    BundleId,
    Flag,
    Primary,
    decode_age,
    decode_bundle,
    decode_bundles,
    decode_hop_count,
    identity_of,
    is_expedited,
)
from adapters.bundle.codec.eid import Eid, decode_eid, is_null, node_of
from adapters.bundle.codec.errors import DecodeError
from adapters.bundle.codec.report import Assertion, ReportReason
from adapters.bundle.node.database import BundleDatabase
from adapters.bundle.node.reporting import DeliveryNotice, DeliveryStatus, NodeContext, Reporting
from adapters.bundle.node.security import Security
from adapters.bundle.node.sending import OutboxReader
from adapters.bundle.node.settings import NodeSettings
from adapters.bundle.node.store import Delivery

_LOG: Final = logging.getLogger(__name__)
_FETCHED: Final = 32
_EXPIRY_BATCH: Final = 500
_CONFIRM: Final = int(Flag.REPORT_DELIVERY | Flag.REPORT_DELETION)
_ADMINISTRATIVE: Final = int(Flag.ADMINISTRATIVE)
_RETAINED_FLAGS: Final = REPORTS | int(Flag.REPORT_TIMES)


class BundleNode(NodeContext):
    """A bundle node, used by applications and links; constructed like a `NodeContext`.

    Attributes:
        receiving: accepts the octets that links receive.
        sending: gives links their outgoing bundles.
        expired: bundles that expired here, counted over restarts.
    """

    def __init__(
        self,
        settings: NodeSettings,
        database: BundleDatabase,
        utc_ms: Callable[[], int],
        on_status: Callable[[DeliveryNotice], None],
        security: Security | None = None,
    ) -> None:
        super().__init__(settings, database, utc_ms, on_status, security)
        self._reporting = Reporting(self)
        self.receiving = Receiving(self, self._reporting)
        self.sending = OutboxReader(self, self._reporting)
        self.expired = database.count("expired")
        self._fetched: dict[bool, deque[Delivery]] = {True: deque(), False: deque()}
        self._last_fetched = {True: 0, False: 0}
        self.outbox.reroute(lambda destination: settings.neighbour_of(destination) or "")
        if stranded := self.outbox.depth(""):
            _LOG.warning("%d bundles have a destination that no neighbour reaches now", stranded)

    def put(
        self, destination: Eid, payload: bytes, lifetime_s: float | None = None,
        confirm: bool = False, expedited: bool = False,
    ) -> BundleId:  # fmt: skip
        """Queue application data, within the transaction.

        Raises:
            StoreFull: the store is full.
            StoreError: the store cannot be written.
            ValueError: no neighbour reaches the destination, its link offers no confirmation,
                or the payload is too long to be expedited.
        """
        settings = self.settings
        neighbour = settings.neighbour_of(destination)
        if is_null(destination) or neighbour is None or node_of(destination) == settings.node:
            raise ValueError(f"no neighbour reaches {destination}")
        if confirm and not settings.confirms(neighbour):
            raise ValueError(f"the daemon that reaches {destination} offers no confirmation")
        if expedited and len(payload) > MAX_EXPEDITED_OCTETS:
            raise ValueError(
                f"at most {MAX_EXPEDITED_OCTETS} octets fit into an expedited payload, it has"
                f" {len(payload)}"
            )
        self.database.require_space(len(payload), expedited=expedited)
        lifetime_s = settings.lifetime_s if lifetime_s is None else lifetime_s
        return self.add_own(
            destination,
            neighbour,
            settings.sender,
            payload,
            lifetime_ms=round(1000 * min(lifetime_s, settings.max_lifetime_s)),
            flags=_CONFIRM if confirm else 0,
            confirm=confirm,
            expedited=expedited,
        )

    def fetch(self, *, only_expedited: bool = False) -> Delivery | None:
        """Return the next committed unit for the application, or None."""
        delivery = self._fetch(expedited=True)
        return delivery if delivery or only_expedited else self._fetch(expedited=False)

    def _fetch(self, *, expedited: bool) -> Delivery | None:
        fetched = self._fetched[expedited]
        if not fetched and not self.database.gathering:
            after = self._last_fetched[expedited]
            fetched.extend(self.inbox.deliveries(after, _FETCHED, expedited=expedited))
            if fetched:
                self._last_fetched[expedited] = fetched[-1].id
        return fetched.popleft() if fetched else None

    def requeue_delivery(self, delivery: Delivery) -> None:
        """Requeue a fetched unit, before all others of its priority."""
        self._fetched[delivery.expedited].appendleft(delivery)

    def mark_delivered(self, delivery: Delivery) -> None:
        """Record that the application has processed a unit."""

        def write() -> None:
            self.inbox.remove([delivery.id])
            self._reporting.report(
                delivery.identity, delivery.flags, delivery.report_to, Assertion.DELIVERED
            )

        self.transaction.add_retried(write)

    def tick(self) -> None:
        """Delete expired bundles and requeue unconfirmed ones; called once a second.

        It also measures the free space, because a full store may see no other activity.

        Raises:
            StoreError: the store cannot be written.
        """
        self.database.measure_free_space()
        now_utc_ms = self.utc_ms()
        unconfirmed = self.outbox.requeue_unconfirmed(now_utc_ms)
        for neighbour in unconfirmed:
            if traffic := self.traffic.get(neighbour):
                traffic.retransmitted += 1
        if unconfirmed:
            self.sending.rewind()
        outgoing = self.outbox.expired(now_utc_ms, _EXPIRY_BATCH)
        for _, identity, octets in outgoing:
            self._end(identity, decode_bundle(octets))
        if outgoing:
            self.outbox.remove(row_id for row_id, *_ in outgoing)
        arrived = [
            row for row in self.inbox.expired(now_utc_ms, _EXPIRY_BATCH)
            if row[0] > self._last_fetched[row[1]]
        ]  # fmt: skip
        if arrived:
            self.inbox.remove(row_id for row_id, *_ in arrived)
        incomplete = self.inbox.forget(now_utc_ms)
        for identity in [*(identity for *_, identity in arrived), *incomplete]:
            _LOG.warning("received bundle %s expired before its delivery", identity)
        if ended := len(outgoing) + len(arrived) + len(incomplete):
            self.expired += ended
            self.database.set_count("expired", self.expired)

    def _end(self, identity: BundleId, bundle: Bundle) -> None:
        if neighbour := self.settings.neighbour_of(bundle.primary.destination):
            self.traffic[neighbour].expired += 1
        self._reporting.report_deletion(bundle, ReportReason.LIFETIME_EXPIRED)
        if bundle.primary.source == self.settings.sender:
            self.notify(identity, DeliveryStatus.EXPIRED)


class Receiving:
    """Processes received bundles: delivers them locally, forwards them, or deletes them.

    Attributes:
        malformed: transmissions that could not be decoded, since the start.
    """

    def __init__(self, state: NodeContext, reporting: Reporting) -> None:
        self._state, self._reporting = state, reporting
        self.malformed = 0

    def receive(self, neighbour: str, octets: bytes) -> None:
        """Process concatenated bundles, within the transaction.

        Malformed octets are counted and dropped, because a retransmission would be malformed too.

        Raises:
            StoreFull: the store is full.
            StoreError: the store cannot be written.
        """
        try:
            for bundle, encoded in decode_bundles(octets):
                if traffic := self._state.traffic.get(neighbour):
                    traffic.received += 1
                self._process(bundle, encoded, neighbour)
        except DecodeError as error:
            self.malformed += 1
            _LOG.warning("malformed bundle dropped: %s", error)

    def _process(self, bundle: Bundle, encoded: bytes, neighbour: str) -> None:
        state, primary = self._state, bundle.primary
        now_utc_ms = state.utc_ms()
        local = node_of(primary.destination) == state.settings.node
        if why := self._drop_reason(bundle, encoded, local, now_utc_ms):
            state.refusals.note(identity_of(primary), why)
            return
        if local and primary.flags & _ADMINISTRATIVE:
            self._reporting.receive(bundle)
            return
        if local and state.inbox.has_seen(identity_of(primary)):
            self._repeat_delivery_report(primary)
            return
        expedited = is_expedited(bundle)
        state.database.require_space(len(encoded), expedited=expedited)
        expires_utc_ms = _expires_utc_ms(bundle, now_utc_ms)
        self._reporting.report_on(bundle, Assertion.RECEIVED)
        if (reason := self._refusal(bundle, expires_utc_ms <= now_utc_ms, neighbour)) is not None:
            self._reporting.report_deletion(bundle, reason)
        elif local:
            self._store(bundle, expires_utc_ms)
        else:
            state.outbox.add(
                primary,
                state.settings.neighbour_of(primary.destination) or "",
                encoded,
                own=False,
                confirm=False,
                now_utc_ms=now_utc_ms,
                expires_utc_ms=expires_utc_ms,
                expedited=expedited,
            )

    def _drop_reason(self, bundle: Bundle, encoded: bytes, local: bool, now_utc_ms: int) -> str:
        """Return why a bundle is dropped without any status report; empty if it is not."""
        primary, state = bundle.primary, self._state
        settings = state.settings
        ahead_s = (primary.creation.time_ms + DTN_EPOCH_UTC_MS - now_utc_ms) / 1000
        if ahead_s > settings.max_clock_lead_s:
            return (
                f"creation time is {ahead_s:.0f} s ahead of the clock here, max_clock_lead_s is"
                f" {settings.max_clock_lead_s:.0f}"
            )
        if primary.lifetime_ms > 1000 * settings.max_lifetime_s:
            return (
                f"lifetime is {primary.lifetime_ms / 1000:.3g} s, max_lifetime_s is"
                f" {settings.max_lifetime_s:.0f}"
            )
        return (
            state.security.signature_error(bundle, encoded, local=local) if state.security else ""
        )

    def _repeat_delivery_report(self, primary: Primary) -> None:
        """Repeat the delivery report of a duplicate bundle: the first report may be lost."""
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
            max_octets = min(settings.max_payload_octets, self._state.inbox.max_fragment_octets)
            too_long = primary.part and primary.part.total > max_octets
            return ReportReason.DEPLETED_STORAGE if too_long else None
        onward = settings.neighbour_of(primary.destination)
        if onward is None or onward in _upstream_nodes(bundle, neighbour):
            return ReportReason.NO_ROUTE
        return ReportReason.HOP_LIMIT_EXCEEDED if _hops_exceeded(bundle) else None

    def _store(self, bundle: Bundle, expires_utc_ms: int) -> None:
        primary, inbox = bundle.primary, self._state.inbox
        identity, payload = identity_of(primary), bundle.payload
        if primary.part is not None:
            for dropped in inbox.evict_fragments(identity, len(payload)):
                self._state.refusals.note(dropped, "fragments evicted for others of their source")
            whole = inbox.add_fragment(identity, primary.part, payload, expires_utc_ms)
            if whole is None:
                return
            payload = whole
        inbox.add(
            Delivery(
                identity,
                primary.destination,
                payload,
                is_expedited(bundle),
                primary.report_to,
                primary.flags & _RETAINED_FLAGS,
                expires_utc_ms,
            )
        )


def _has_unsupported_block(bundle: Bundle) -> bool:
    """Return whether an unknown block requires the deletion of the bundle (RFC 9171, 5.6)."""
    return any(
        block.flags & BlockFlag.DELETE_BUNDLE_IF_UNKNOWN and block.type not in KNOWN_BLOCKS
        for block in bundle.blocks
    )


def _hops_exceeded(bundle: Bundle) -> bool:
    """Return whether forwarding would exceed the hop limit (RFC 9171, 4.4.3)."""
    if (block := bundle.block(BlockType.HOP_COUNT)) is None:
        return False
    hops = decode_hop_count(block.data)
    return hops.count + 1 > hops.limit


def _upstream_nodes(bundle: Bundle, neighbour: str) -> tuple[str, ...]:
    previous = bundle.block(BlockType.PREVIOUS_NODE)
    named = () if previous is None else (str(node_of(decode_eid(previous.data))),)
    return (neighbour, str(node_of(bundle.primary.source)), *named)


def _expires_utc_ms(bundle: Bundle, now_utc_ms: int) -> int:
    """Return the end of the lifetime, from creation time or bundle age (RFC 9171, 4.4.2)."""
    primary = bundle.primary
    if primary.creation.time_ms:
        return DTN_EPOCH_UTC_MS + primary.creation.time_ms + primary.lifetime_ms
    age = bundle.block(BlockType.BUNDLE_AGE)
    return now_utc_ms + primary.lifetime_ms - (decode_age(age.data) if age else 0)
