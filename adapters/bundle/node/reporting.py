"""`NodeContext`: state shared by a node's parts; `Reporting`: status reports sent and received."""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Final

from adapters.bundle.codec.bundle import (
    DTN_EPOCH_UTC_MS,
    PAYLOAD_NUMBER,
    Block,
    BlockType,
    Bundle,
    BundleId,
    Crc,
    Creation,
    Flag,
    FragmentRange,
    HopCount,
    Primary,
    encode_bundle,
    encode_hop_count,
    expedited_block,
    identity_of,
)
from adapters.bundle.codec.eid import Eid, is_null, node_of
from adapters.bundle.codec.errors import DecodeError, StoreError
from adapters.bundle.codec.report import (
    Assertion,
    ReportReason,
    StatusReport,
    decode_report,
    encode_report,
)
from adapters.bundle.node.database import BundleDatabase, GroupCommit
from adapters.bundle.node.security import Security
from adapters.bundle.node.settings import NodeSettings
from adapters.bundle.node.store import BundleInbox, Outbox

_LOG: Final = logging.getLogger(__name__)
_LOG_PERIOD_MS: Final = 10_000
_LAST_TIME: Final = "last creation time"
_LAST_SEQUENCE: Final = "last creation sequence"
_MAX_UNSYNCED: Final = 1000
"""Bundles that may be sent during one sync of the disk; chosen, not measured."""
_FLAGS: Final = {
    Assertion.RECEIVED: int(Flag.REPORT_RECEPTION),
    Assertion.FORWARDED: int(Flag.REPORT_FORWARDING),
    Assertion.DELIVERED: int(Flag.REPORT_DELIVERY),
    Assertion.DELETED: int(Flag.REPORT_DELETION),
}


class DeliveryStatus(Enum):
    """Delivery status of a bundle that was sent."""

    HANDED_ON = "handed on to the next node"
    DELIVERED = "delivered to its receiver"
    EXPIRED = "deleted, lifetime expired"
    DELETED = "deleted by a node on the path"


@dataclass(frozen=True, slots=True)
class DeliveryNotice:
    """Status of one bundle. May be repeated; DELIVERED may precede HANDED_ON."""

    identity: BundleId
    status: DeliveryStatus


@dataclass(slots=True)
class Traffic:
    """Traffic counters of one neighbour since the start.

    Attributes:
        sent: bundles and fragments given to the link, counted at each transmission.
        acknowledged: bundles acknowledged by the neighbour; by their receiver if sent with
            `confirm`.
        retransmitted: retransmissions: LTP segments, and bundles.
        expired: bundles for the neighbour that expired here.
        received: bundles and fragments received from it and decoded.
        round_trip_s: latest round-trip time of a message that was sent only once. None before the
            first answer, and on links without answers.
    """

    sent: int = 0
    acknowledged: int = 0
    retransmitted: int = 0
    expired: int = 0
    received: int = 0
    round_trip_s: float | None = None


class RejectionCounter:
    """Counts rejected bundles, and logs at most one of them in ten seconds.

    Attributes:
        count: rejected bundles since the start.
    """

    def __init__(self, utc_ms: Callable[[], int]) -> None:
        self.count = 0
        self._utc_ms, self._logged_utc_ms, self._logged_count = utc_ms, -_LOG_PERIOD_MS, 0

    def note(self, identity: BundleId, why: str) -> None:
        """Count the rejection of a bundle, and log it if the last line is old enough."""
        self.count += 1
        now_utc_ms = self._utc_ms()
        if abs(now_utc_ms - self._logged_utc_ms) < _LOG_PERIOD_MS:
            return
        more = self.count - self._logged_count - 1
        others = f" ({more} more since the last such line)" if more else ""
        _LOG.warning("bundle %s rejected: %s%s", identity, why, others)
        self._logged_utc_ms, self._logged_count = now_utc_ms, self.count


class NodeContext:
    """State shared by the parts of a node: settings, store, clock, and the callback for notices.

    Creation timestamps never decrease, over restarts and when the clock steps back. The last one is
    written in the transaction of its bundle. Expedited bundles are sent before they are on the
    disk, so a start omits the sequence numbers that a loss of power may have undone.

    `on_status` receives the delivery notices of own bundles, after their commit.

    Attributes:
        utc_ms: returns the time in milliseconds since 1970.
        security: signs and verifies bundles; None disables both.
        transaction: the pending group commit.
        refusals: counter of rejected received bundles.
        traffic: traffic counters by neighbour name.
    """

    def __init__(
        self,
        settings: NodeSettings,
        database: BundleDatabase,
        utc_ms: Callable[[], int],
        on_status: Callable[[DeliveryNotice], None],
        security: Security | None = None,
    ) -> None:
        self.settings, self.database, self.utc_ms = settings, database, utc_ms
        self.security, self.refusals = security, RejectionCounter(utc_ms)
        self.transaction = GroupCommit(database)
        self.traffic = {each.name: Traffic() for each in settings.neighbours}
        pause_ms = {n.name: round(1000 * n.link.confirm_after_s) for n in settings.neighbours}
        self.outbox, self.inbox = Outbox(database, pause_ms), BundleInbox(database)
        self._on_status = on_status
        sequence = database.count(_LAST_SEQUENCE) + _MAX_UNSYNCED
        try:
            database.set_count(_LAST_SEQUENCE, sequence)
            database.commit()
            database.sync()  # the next start must omit those of this one, too
        except StoreError:  # a full disk: the next commit writes it
            database.rollback()
        # Before 2000 the time of each creation is 1: a first start continues the numbers, too.
        self._last = Creation(max(database.count(_LAST_TIME), 1), sequence)
        self._last_to_write = False

    def notify(self, identity: BundleId, status: DeliveryStatus) -> None:
        """Notify the application of a delivery status, after the commit."""

        def on_commit(failure: StoreError | None) -> None:
            if failure is None:
                self._on_status(DeliveryNotice(identity, status))

        self.transaction.on_commit(on_commit)

    def add_own(
        self,
        destination: Eid,
        neighbour: str,
        source: Eid,
        payload: bytes,
        *,
        lifetime_ms: int,
        flags: int,
        confirm: bool = False,
        expedited: bool = False,
    ) -> BundleId:
        """Create a bundle and add it to the outbox, within the transaction."""
        now_utc_ms, settings = self.utc_ms(), self.settings
        primary = Primary(
            destination, source, settings.node, self._next_creation(now_utc_ms), lifetime_ms, flags
        )
        blocks = [Block(BlockType.PAYLOAD, PAYLOAD_NUMBER, payload, crc=Crc.CRC32C)]
        if settings.hop_limit is not None:
            hops = HopCount(settings.hop_limit, 0)
            blocks.insert(0, Block(BlockType.HOP_COUNT, 2, encode_hop_count(hops)))
        if expedited:
            blocks.insert(0, expedited_block(3))
        self.outbox.add(
            primary,
            neighbour,
            encode_bundle(Bundle(primary, tuple(blocks))),
            own=True,
            confirm=confirm,
            now_utc_ms=now_utc_ms,
            expires_utc_ms=now_utc_ms + lifetime_ms,
            expedited=expedited,
        )
        return identity_of(primary)

    def _next_creation(self, utc_ms: int) -> Creation:
        last = self._last
        time_ms = max(utc_ms - DTN_EPOCH_UTC_MS, last.time_ms, 1)
        self._last = Creation(time_ms, last.sequence + 1 if time_ms == last.time_ms else 0)
        if not self._last_to_write:
            self._last_to_write = True
            self.transaction.add_retried(self._write_last)
        return self._last

    def _write_last(self) -> None:
        self._last_to_write = False
        self.database.set_count(_LAST_TIME, self._last.time_ms)
        self.database.set_count(_LAST_SEQUENCE, self._last.sequence)


class Reporting:
    """Sends the status reports that bundles request, and processes those received."""

    def __init__(self, state: NodeContext) -> None:
        self._state = state

    def report(
        self,
        identity: BundleId,
        flags: int,
        report_to: Eid,
        assertion: Assertion,
        reason: ReportReason = ReportReason.NONE,
        part: FragmentRange | None = None,
    ) -> None:
        """Send a status report within the transaction, if the bundle's flags request it.

        For a fragment, `part` gives offset and length of its payload.
        """
        if not flags & _FLAGS[assertion] or is_null(report_to):
            return
        state, settings = self._state, self._state.settings
        neighbour = settings.neighbour_of(report_to)
        if neighbour is None or node_of(report_to) == settings.node:
            return
        time_ms = state.utc_ms() - DTN_EPOCH_UTC_MS if flags & Flag.REPORT_TIMES else None
        report = StatusReport(
            {assertion: time_ms}, reason.value, identity.source, identity.creation, part
        )
        state.add_own(
            report_to,
            neighbour,
            settings.node,
            encode_report(report),
            lifetime_ms=round(1000 * settings.lifetime_s),
            flags=int(Flag.ADMINISTRATIVE),
        )

    def report_on(
        self, bundle: Bundle, assertion: Assertion, reason: ReportReason = ReportReason.NONE
    ) -> None:
        """Send a status report on a decoded bundle, if the bundle requests it."""
        primary = bundle.primary
        part = primary.part and FragmentRange(primary.part.offset, len(bundle.payload))
        identity = identity_of(primary)
        self.report(identity, primary.flags, primary.report_to, assertion, reason, part)

    def report_deletion(self, bundle: Bundle, reason: ReportReason) -> None:
        """Log the deletion of a bundle, and report it if the bundle requests that."""
        primary = bundle.primary
        _LOG.warning(
            "bundle %s to %s deleted: %s", identity_of(primary), primary.destination, reason.name
        )
        self.report_on(bundle, Assertion.DELETED, reason)

    def receive(self, bundle: Bundle) -> None:
        """Process an administrative record addressed to this node."""
        state, sender = self._state, bundle.primary.source
        try:
            report = decode_report(bundle.payload)
        except DecodeError as error:
            _LOG.warning("malformed administrative record from %s: %s", sender, error)
            return
        if report is None or node_of(report.source) != state.settings.node:
            return
        identity = BundleId(report.source, report.creation)
        if Assertion.DELIVERED in report.asserted and not report.part:
            rows = state.outbox.ids(identity)
            state.outbox.remove(rows)
            if neighbour := state.settings.neighbour_of(sender):
                state.traffic[neighbour].acknowledged += len(rows)
            state.notify(identity, DeliveryStatus.DELIVERED)
        elif Assertion.DELETED in report.asserted:
            _LOG.warning("bundle %s deleted by %s", identity, sender)
            state.notify(identity, DeliveryStatus.DELETED)
