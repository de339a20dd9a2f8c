"""What a node does with a bundle that has arrived (RFC 9171, 5.6, 5.7 and 6.1)."""

import logging
from collections.abc import Callable

from adapters.bundle.codec.bundle import (
    DTN_EPOCH_UTC_MS,
    REPORTS,
    BlockType,
    Bundle,
    BundleId,
    Flag,
    Part,
    Primary,
    decode_age,
    decode_bundles,
    encode_bundle,
    identity_of,
)
from adapters.bundle.codec.eid import Eid, decode_eid, is_null, node_of
from adapters.bundle.codec.errors import DecodeError
from adapters.bundle.codec.report import Assertion, ReportReason, decode_report
from adapters.bundle.node.bundle_factory import (
    has_unsupported_block,
    hops_exceeded,
    report_bundle,
    status_report,
)
from adapters.bundle.node.database import Database, Numbering
from adapters.bundle.node.inbox import Arrival, Inbox
from adapters.bundle.node.outbox import Outbox
from adapters.bundle.node.port import DeliveryStatus, Notice
from adapters.bundle.node.settings import NodeSettings

_REPORT_LOG = logging.getLogger(__name__)
_FLAGS = {
    Assertion.RECEIVED: int(Flag.REPORT_RECEPTION),
    Assertion.FORWARDED: int(Flag.REPORT_FORWARDING),
    Assertion.DELIVERED: int(Flag.REPORT_DELIVERY),
    Assertion.DELETED: int(Flag.REPORT_DELETION),
}


class Reporting:
    """Sends status reports where they were asked for, and reads those that come."""

    def __init__(
        self,
        settings: NodeSettings,
        outbox: Outbox,
        numbering: Numbering,
        utc_ms: Callable[[], int],
        notify: Callable[[Notice], None],
    ) -> None:
        """Report through the outbox of a node."""
        self._settings = settings
        self._outbox = outbox
        self._numbering = numbering
        self._utc_ms = utc_ms
        self._notify = notify

    def report(
        self,
        identity: BundleId,
        flags: int,
        report_to: Eid,
        assertion: Assertion,
        reason: ReportReason = ReportReason.NONE,
        part: Part | None = None,
    ) -> None:
        """Report on a bundle, within the transaction, if its flags ask for that.

        A fragment has a part: offset and length of its payload.
        """
        if not flags & _FLAGS[assertion] or is_null(report_to):
            return
        settings, now_utc_ms = self._settings, self._utc_ms()
        neighbour = settings.neighbour_of(report_to)
        if neighbour is None or node_of(report_to) == settings.node:
            return
        creation = self._numbering.next(now_utc_ms)
        lifetime_ms = round(1000 * settings.lifetime_s)
        bundle = report_bundle(
            creation,
            settings.node,
            report_to,
            status_report(identity, flags, assertion, reason, now_utc_ms - DTN_EPOCH_UTC_MS, part),
            lifetime_ms=lifetime_ms,
            hop_limit=settings.hop_limit,
        )
        self._outbox.add(
            identity_of(bundle.primary),
            report_to,
            neighbour,
            encode_bundle(bundle),
            own=True,
            confirm=False,
            now_utc_ms=now_utc_ms,
            expires_utc_ms=now_utc_ms + lifetime_ms,
        )

    def about(
        self, bundle: Bundle, assertion: Assertion, reason: ReportReason = ReportReason.NONE
    ) -> None:
        """Report on a bundle that is at hand, if it asks for that."""
        primary = bundle.primary
        part = primary.part and Part(primary.part.offset, len(bundle.payload))
        identity = identity_of(primary)
        self.report(identity, primary.flags, primary.report_to, assertion, reason, part)

    def deleted(self, bundle: Bundle, reason: ReportReason) -> None:
        """Say that a bundle was deleted: in the log always, to others if they asked for it."""
        primary = bundle.primary
        _REPORT_LOG.warning(
            "bundle %s to %s deleted: %s", identity_of(primary), primary.destination, reason.name
        )
        self.about(bundle, Assertion.DELETED, reason)

    def heed(self, bundle: Bundle) -> None:
        """Read an administrative record that was sent to this node."""
        try:
            report = decode_report(bundle.payload)
        except DecodeError as error:
            _REPORT_LOG.warning("malformed report from %s: %s", bundle.primary.source, error)
            return
        if report is None or node_of(report.source) != self._settings.node:
            return
        identity = BundleId(report.source, report.creation)
        if report.says(Assertion.DELIVERED) and not report.part:
            self._outbox.remove(self._outbox.ids(identity))
            self._notify(Notice(identity, DeliveryStatus.DELIVERED))
        elif report.says(Assertion.DELETED):
            _REPORT_LOG.warning("bundle %s deleted by %s", identity, bundle.primary.source)
            self._notify(Notice(identity, DeliveryStatus.DELETED))


_LOG = logging.getLogger(__name__)
_ADMINISTRATIVE = int(Flag.ADMINISTRATIVE)
_KEPT_FLAGS = REPORTS | int(Flag.REPORT_TIMES)


class Receiving:
    """Takes bundles in: for the application, to be forwarded, or to be deleted with a reason.

    Attributes:
        malformed: how many could not be read.
    """

    def __init__(
        self,
        settings: NodeSettings,
        database: Database,
        inbox: Inbox,
        outbox: Outbox,
        reporting: Reporting,
        utc_ms: Callable[[], int],
    ) -> None:
        """Take bundles in for a node."""
        self._settings = settings
        self._database = database
        self._inbox = inbox
        self._outbox = outbox
        self._reporting = reporting
        self._utc_ms = utc_ms
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
        primary, now_utc_ms = bundle.primary, self._utc_ms()
        local = node_of(primary.destination) == self._settings.node
        if local and primary.flags & _ADMINISTRATIVE:
            self._reporting.heed(bundle)
            return
        if local and self._inbox.has_seen(identity_of(primary)):
            self._take_again(primary)
            return
        if self._database.full:
            raise self._database.no_room()
        expires_utc_ms = _expires_utc_ms(bundle, now_utc_ms)
        self._reporting.about(bundle, Assertion.RECEIVED)
        expired = expires_utc_ms <= now_utc_ms
        if (reason := self._refusal(bundle, expired, neighbour)) is not None:
            self._reporting.deleted(bundle, reason)
        elif local:
            self._keep(bundle, expires_utc_ms)
        else:
            self._forward(bundle, encoded, now_utc_ms, expires_utc_ms)

    def _take_again(self, primary: Primary) -> None:
        """Say once more that a bundle was delivered: it came again because nobody heard it."""
        identity = identity_of(primary)
        if not self._inbox.holds(identity):
            self._reporting.report(identity, primary.flags, primary.report_to, Assertion.DELIVERED)

    def _refusal(self, bundle: Bundle, expired: bool, neighbour: str) -> ReportReason | None:
        primary, settings = bundle.primary, self._settings
        if has_unsupported_block(bundle):
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
        return ReportReason.HOP_LIMIT_EXCEEDED if hops_exceeded(bundle) else None

    def _keep(self, bundle: Bundle, expires_utc_ms: int) -> None:
        primary = bundle.primary
        identity, payload = identity_of(primary), bundle.payload
        if primary.part is not None:
            whole = self._inbox.add_fragment(identity, primary.part, payload, expires_utc_ms)
            if whole is None:
                return
            payload = whole
        self._inbox.add(
            Arrival(
                identity,
                primary.destination,
                primary.report_to,
                primary.flags & _KEPT_FLAGS,
                expires_utc_ms,
                payload,
            )
        )

    def _forward(
        self, bundle: Bundle, encoded: bytes, now_utc_ms: int, expires_utc_ms: int
    ) -> None:
        destination = bundle.primary.destination
        self._outbox.add(
            identity_of(bundle.primary),
            destination,
            self._settings.neighbour_of(destination) or "",
            encoded,
            own=False,
            confirm=False,
            now_utc_ms=now_utc_ms,
            expires_utc_ms=expires_utc_ms,
        )


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
