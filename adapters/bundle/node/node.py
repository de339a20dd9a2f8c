"""A bundle node without its links: the store, and what goes in and out of it.

It reads no clock and touches no network. Nothing counts before `commit`.
"""

import logging
from collections import deque
from collections.abc import Callable
from typing import Final

from adapters.bundle.codec.bundle import Bundle, BundleId, Flag, decode_bundle
from adapters.bundle.codec.eid import Eid, is_null, node_of
from adapters.bundle.codec.report import Assertion, ReportReason
from adapters.bundle.node.database import Database
from adapters.bundle.node.inbox import Arrival
from adapters.bundle.node.receiving import Receiving
from adapters.bundle.node.reporting import DeliveryStatus, NodeState, Notice, Reporting
from adapters.bundle.node.sending import Sending
from adapters.bundle.node.settings import LONGEST_LIFETIME_S, NodeSettings

_LOG: Final = logging.getLogger(__name__)
_FETCHED: Final = 32
_ENDED_AT_ONCE: Final = 500
_CONFIRM: Final = int(Flag.REPORT_DELIVERY | Flag.REPORT_DELETION)


class Node(NodeState):
    """A bundle node, for applications and for links; made as a `NodeState`.

    Attributes:
        receiving: where links put what has arrived.
        sending: where links get what is to go out.
        expired: how many bundles ended here with their lifetime, ever.
    """

    def __init__(
        self,
        settings: NodeSettings,
        database: Database,
        utc_ms: Callable[[], int],
        on_status: Callable[[Notice], None],
    ) -> None:
        super().__init__(settings, database, utc_ms, on_status)
        self._reporting = Reporting(self)
        self.receiving = Receiving(self, self._reporting)
        self.sending = Sending(self, self._reporting)
        self.expired = database.count("expired")
        self._fetched: deque[Arrival] = deque()
        self._last_fetched = 0
        self.outbox.reroute(lambda destination: settings.neighbour_of(destination) or "")
        if stranded := self.outbox.depth(""):
            _LOG.warning("%d bundles are for nodes that no neighbour reaches now", stranded)

    def put(
        self, destination: Eid, payload: bytes, lifetime_s: float | None = None,
        confirm: bool = False,
    ) -> BundleId:  # fmt: skip
        """Queue application data, within the transaction.

        Raises:
            StoreFull: there is no room.
            StoreError: the store cannot be written.
            ValueError: no neighbour reaches the destination, or nothing that goes there is
                confirmed.
        """
        settings = self.settings
        neighbour = settings.neighbour_of(destination)
        if is_null(destination) or neighbour is None or node_of(destination) == settings.node:
            raise ValueError(f"no neighbour reaches {destination}")
        if confirm and not settings.confirms(neighbour):
            raise ValueError(f"the daemon that reaches {destination} confirms nothing")
        self.database.require_room()
        lifetime_s = settings.lifetime_s if lifetime_s is None else lifetime_s
        return self.add_own(
            destination,
            neighbour,
            settings.sender,
            payload,
            lifetime_ms=round(1000 * min(lifetime_s, LONGEST_LIFETIME_S)),
            flags=_CONFIRM if confirm else 0,
            confirm=confirm,
        )

    def fetch(self) -> Arrival | None:
        """Return the next unit for the application, of those that are committed."""
        if not self._fetched and not self.database.gathering:
            self._fetched.extend(self.inbox.arrivals(self._last_fetched, _FETCHED))
            if self._fetched:
                self._last_fetched = self._fetched[-1].id
        return self._fetched.popleft() if self._fetched else None

    def give_back(self, arrival: Arrival) -> None:
        """Fetch this unit again, before all others."""
        self._fetched.appendleft(arrival)

    def delivered(self, arrival: Arrival) -> None:
        """Note that the application has a unit."""

        def write() -> None:
            self.inbox.remove([arrival.id])
            self._reporting.report(
                arrival.identity, arrival.flags, arrival.report_to, Assertion.DELIVERED
            )

        self.transaction.mark(write)

    def tick(self) -> None:
        """Delete what has expired, and requeue what was not confirmed; once a second.

        It also looks whether there is room again, for which nothing else might ever do.

        Raises:
            StoreError: the store cannot be written.
        """
        self.database.look_for_room()
        now_utc_ms = self.utc_ms()
        if self.outbox.unconfirmed(now_utc_ms):
            self.sending.rewind()
        outgoing = self.outbox.expired(now_utc_ms, _ENDED_AT_ONCE)
        for _, identity, octets in outgoing:
            self._end(identity, decode_bundle(octets))
        if outgoing:
            self.outbox.remove(row_id for row_id, *_ in outgoing)
        arrived = [
            row for row in self.inbox.expired(now_utc_ms, _ENDED_AT_ONCE)
            if row[0] > self._last_fetched
        ]  # fmt: skip
        if arrived:
            self.inbox.remove(row_id for row_id, _ in arrived)
        incomplete = self.inbox.forget(now_utc_ms)
        for identity in [*(identity for _, identity in arrived), *incomplete]:
            _LOG.warning("bundle %s, received, ended with its lifetime", identity)
        if ended := len(outgoing) + len(arrived) + len(incomplete):
            self.expired += ended
            self.database.set_count("expired", self.expired)

    def _end(self, identity: BundleId, bundle: Bundle) -> None:
        self._reporting.deleted(bundle, ReportReason.LIFETIME_EXPIRED)
        if bundle.primary.source == self.settings.sender:
            self.notify(identity, DeliveryStatus.EXPIRED)
