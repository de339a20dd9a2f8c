"""Status reports on bundles (RFC 9171, 6.1.1): ours on those of others, and theirs on ours."""

import logging
from collections.abc import Callable

from adapters.bundle.codec import encode_bundle
from adapters.bundle.eid import Eid, is_null, node_of
from adapters.bundle.errors import DecodeError
from adapters.bundle.identity import BundleId, identity_of
from adapters.bundle.making import report_bundle, status_report
from adapters.bundle.numbering import Numbering
from adapters.bundle.outbox import Outbox
from adapters.bundle.port import Fate, Notice
from adapters.bundle.report import Assertion, ReportReason, decode_report
from adapters.bundle.settings import NodeSettings
from adapters.bundle.values import DTN_EPOCH_UTC_MS, Bundle, Flag, Part

_LOG = logging.getLogger(__name__)
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
        _LOG.warning(
            "bundle %s to %s deleted: %s", identity_of(primary), primary.destination, reason.name
        )
        self.about(bundle, Assertion.DELETED, reason)

    def heed(self, bundle: Bundle) -> None:
        """Read an administrative record that was sent to this node."""
        try:
            report = decode_report(bundle.payload)
        except DecodeError as error:
            _LOG.warning("malformed report from %s: %s", bundle.primary.source, error)
            return
        if report is None or node_of(report.source) != self._settings.node:
            return
        identity = BundleId(report.source, report.creation)
        if report.says(Assertion.DELIVERED) and not report.part:
            self._outbox.remove(self._outbox.ids(identity))
            self._notify(Notice(identity, Fate.DELIVERED))
        elif report.says(Assertion.DELETED):
            _LOG.warning("bundle %s deleted by %s", identity, bundle.primary.source)
            self._notify(Notice(identity, Fate.DELETED))
