"""What the parts of a node share, and status reports: ours on bundles of others, theirs on ours."""

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
_TELL_EVERY_MS: Final = 10_000
_LAST_TIME: Final = "last creation time"
_LAST_SEQUENCE: Final = "last creation sequence"
_FLAGS: Final = {
    Assertion.RECEIVED: int(Flag.REPORT_RECEPTION),
    Assertion.FORWARDED: int(Flag.REPORT_FORWARDING),
    Assertion.DELIVERED: int(Flag.REPORT_DELIVERY),
    Assertion.DELETED: int(Flag.REPORT_DELETION),
}


class DeliveryStatus(Enum):
    """What has become of something that was sent."""

    HANDED_ON = "handed on to the next node"
    DELIVERED = "delivered to its receiver"
    EXPIRED = "deleted, its lifetime is over"
    DELETED = "deleted by a node on its way"


@dataclass(frozen=True, slots=True)
class DeliveryNotice:
    """A status, and whose it is. May come more than once; DELIVERED may come before HANDED_ON."""

    identity: BundleId
    status: DeliveryStatus


@dataclass(slots=True)
class Traffic:
    """What went to a neighbour and came from it, counted where it happens, since the start.

    Attributes:
        sent: bundles and fragments given to the link, each time that they are.
        acknowledged: bundles that the neighbour has said to have, or their receiver of those that
            were sent with `confirm`.
        retransmitted: what was sent once more: segments over LTP, and bundles.
        expired: bundles for it that ended here with their lifetime.
        received: bundles and fragments that came from it and could be read.
        round_trip_s: how long the neighbour took to answer what was sent only once; None before the
            first answer, and over links without answers.
    """

    sent: int = 0
    acknowledged: int = 0
    retransmitted: int = 0
    expired: int = 0
    received: int = 0
    round_trip_s: float | None = None


class RejectionCounter:
    """Counts the bundles that are not taken, and logs one of them every ten seconds at most.

    Attributes:
        count: how many, since the start.
    """

    def __init__(self, utc_ms: Callable[[], int]) -> None:
        self.count = 0
        self._utc_ms, self._told_utc_ms, self._told = utc_ms, -_TELL_EVERY_MS, 0

    def note(self, identity: BundleId, why: str) -> None:
        """Note that a bundle is refused."""
        self.count += 1
        now_utc_ms = self._utc_ms()
        if abs(now_utc_ms - self._told_utc_ms) < _TELL_EVERY_MS:
            return
        more = self.count - self._told - 1
        others = f" ({more} more since the last of these lines)" if more else ""
        _LOG.warning("bundle %s refused: %s%s", identity, why, others)
        self._told_utc_ms, self._told = now_utc_ms, self.count


class NodeContext:
    """What the parts of a node share: settings, store, clock, and the callback for notices.

    Creation timestamps only grow, over restarts and when the clock steps back. The last one is
    written with the transaction of the bundle that has it. What a crash undoes was never sent, so
    that it may be given again.

    `on_status` is told what becomes of what was put in, after it is on the disk.

    Attributes:
        utc_ms: the time in milliseconds since 1970.
        security: signs and verifies; None for neither.
        transaction: what gathers until it is committed.
        refusals: of what came.
        traffic: what went over the links, by the names of the neighbours.
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
        self._last = Creation(database.count(_LAST_TIME), database.count(_LAST_SEQUENCE))
        self._last_to_write = False

    def notify(self, identity: BundleId, status: DeliveryStatus) -> None:
        """Tell the application when it is on the disk."""

        def tell(failure: StoreError | None) -> None:
            if failure is None:
                self._on_status(DeliveryNotice(identity, status))

        self.transaction.then(tell)

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
        """Make a bundle and put it into the outbox, within the transaction."""
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
            self.transaction.mark(self._write_last)
        return self._last

    def _write_last(self) -> None:
        self._last_to_write = False
        self.database.set_count(_LAST_TIME, self._last.time_ms)
        self.database.set_count(_LAST_SEQUENCE, self._last.sequence)


class Reporting:
    """Sends status reports where they were asked for, and reads those that come."""

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
        """Report on a bundle, within the transaction, if its flags ask for that.

        A fragment has a part: offset and length of its payload.
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

    def about(
        self, bundle: Bundle, assertion: Assertion, reason: ReportReason = ReportReason.NONE
    ) -> None:
        """Report on a bundle that is at hand, if it asks for that."""
        primary = bundle.primary
        part = primary.part and FragmentRange(primary.part.offset, len(bundle.payload))
        identity = identity_of(primary)
        self.report(identity, primary.flags, primary.report_to, assertion, reason, part)

    def deleted(self, bundle: Bundle, reason: ReportReason) -> None:
        """Say that a bundle was deleted: in the log always, to others if they asked for it."""
        primary = bundle.primary
        _LOG.warning(
            "bundle %s to %s deleted: %s", identity_of(primary), primary.destination, reason.name
        )
        self.about(bundle, Assertion.DELETED, reason)

    def receive(self, bundle: Bundle) -> None:
        """Read an administrative record that was sent to this node."""
        state, sender = self._state, bundle.primary.source
        try:
            report = decode_report(bundle.payload)
        except DecodeError as error:
            _LOG.warning("malformed report from %s: %s", sender, error)
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
